"""The gateways of a rehearsal: real Debian computers with systemd, where this computer can run them."""

from __future__ import annotations

from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from ipaddress import IPv4Interface
from typing import TYPE_CHECKING

from cryptography.hazmat.primitives import serialization
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

from atlantis_netcfg import machine
from atlantis_netcfg.events import Event, Stage
from atlantis_netcfg.operations.gateways._access import is_gateway
from atlantis_netcfg.operations.request import Target
from atlantis_netcfg.site.model import Gateway

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence
    from pathlib import Path

    from atlantis_netcfg.events import Subscriber
    from atlantis_netcfg.routeros.estimate import Bearer
    from atlantis_netcfg.site import Declaration, Host

__all__ = ["TREE", "RehearsedGateways", "rehearsed_gateways"]

TREE = machine.TreeSpec(
    packages=(
        "ca-certificates",
        "cmake",
        "colcon",
        "g++",
        "git",
        "gnupg",
        "libyaml-cpp-dev",
        "locales",
        "make",
        "nftables",
    )
)
"""Debian's own packages that gateways ask for: a rehearsal has no network to fetch them from."""
_STATE = (
    "find /etc /opt /usr/local /var/lib/atlantis /var/lib/dpkg -xdev -type f -printf '%p %s %T@\\n' 2>/dev/null | sort"
)
_KEYS = serialization.Encoding.OpenSSH


@dataclass(frozen=True, slots=True)
class RehearsedGateways:
    """What stands for the gateways of a rehearsal."""

    machines: Mapping[str, machine.Machine] = field(default_factory=dict)
    targets: Mapping[str, Target] = field(default_factory=dict)
    left_out: Mapping[str, str] = field(default_factory=dict)
    """Host name to why nothing stands for it."""
    not_rehearsed: tuple[str, ...] = ()

    def export(self, name: str) -> str:
        """What the computer's configuration and its packages look like now: name, size and time of every file."""
        return self.machines[name].run(_STATE).stdout

    def relink(self, name: str, bearer: Bearer) -> None:
        """Put the computer behind another bearer."""
        self.machines[name].link(
            delay_s=bearer.rtt_s / 2, rate_up_bps=bearer.rate_up_bps, rate_down_bps=bearer.rate_down_bps
        )


@contextmanager
def rehearsed_gateways(
    declaration: Declaration, hosts: Sequence[Host], folder: Path, notify: Subscriber
) -> Iterator[RehearsedGateways]:
    """Start a computer for each gateway among `hosts`; they end with the context. Raises MachineFailed."""
    gateways = [host for host in hosts if is_gateway(host)]
    if not gateways:
        yield RehearsedGateways()
        return
    if why := machine.why_not():
        yield RehearsedGateways(left_out={host.name: why for host in gateways})
        return
    for host in gateways:
        notify(Event(host.name, Stage.CONNECTING, "a Debian is made for it; the first time that takes two minutes"))
    root = machine.tree(TREE)
    folder.mkdir(mode=0o700, exist_ok=True)
    public = _key(folder / "key")
    with ExitStack() as stack:
        ground = stack.enter_context(machine.yard(folder))
        machines = {host.name: _started(ground, declaration, host, root, public) for host in gateways}
        targets = {name: _target(one, folder) for name, one in machines.items()}
        yield RehearsedGateways(machines, targets, not_rehearsed=machine.NOT_REHEARSED)


def _started(ground: machine.Yard, declaration: Declaration, host: Host, root: Path, public: str) -> machine.Machine:
    device, lan = host.device, declaration.sites[host.site].lan
    assert isinstance(device, Gateway)  # noqa: S101 - `is_gateway` has said so
    own = IPv4Interface(f"{device.address}/{lan.network.prefixlen}")
    return ground.start(host.name, root, address=str(own), gateway=str(lan.gateway), keys=(public,))


def _target(one: machine.Machine, folder: Path) -> Target:
    known = folder / f"{one.name}.known"
    known.write_text(f"{one.name} {one.host_key}\n", encoding="utf-8")
    return Target(host="127.0.0.1", port=one.port, known_hosts=str(known), identity=str(folder / "key"))


def _key(path: Path) -> str:
    """Make the technician's key of this rehearsal; give its public half."""
    key = Ed25519PrivateKey.generate()
    private = key.private_bytes(_KEYS.PEM, serialization.PrivateFormat.OpenSSH, serialization.NoEncryption())
    path.touch(mode=0o600)
    path.write_bytes(private)
    return key.public_key().public_bytes(_KEYS, serialization.PublicFormat.OpenSSH).decode() + " rehearsal"
