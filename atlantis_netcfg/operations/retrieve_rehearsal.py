"""A rehearsed transfer of recordings: the programs of both ends over an emulated link that is interrupted.

Both ends are installed in one folder, as the role installs them in `/`. The gateway's program sends by rsync to the
control centre's program; ssh, sshd and systemd are replaced by substitutes (`emulator/ssh.py`), and a relay has the
behaviour of the site's link in the inventory. The recordings are random data, as much as the link carries in seconds.
"""

from __future__ import annotations

import hashlib
import json
import os
import re
import shlex
import shutil
import socket
import sys
import time
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final

from atlantis_netcfg.computers.retrieval import PROGRAM, retrieval
from atlantis_netcfg.core import errors, temporary
from atlantis_netcfg.core.messages import arg, msg
from atlantis_netcfg.emulator import ssh
from atlantis_netcfg.emulator.lab.relay import Relay, RelayLink
from atlantis_netcfg.inventory import model
from atlantis_netcfg.links.cost import size
from atlantis_netcfg.operations import retrieve
from atlantis_netcfg.operations.common.link_shapes import link_shapes

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator
    from pathlib import Path

    from atlantis_netcfg.inventory import Host, Inventory

GAP_S: Final = 20.0
"""Maximum gap instead of 70 s: the link is restored as soon as the connection is lost."""
SILENCE_S: Final = 3
"""Maximum silence of a connection in seconds, instead of 120 s."""
NOT_REHEARSED: Final = (
    msg(
        f"an outage of 70 s: the link is cut until the connection is lost, which takes up to {arg(SILENCE_S)} s here, "
        "not 120 s"
    ),
    "SSH with keys and accounts, and the VPN: the two programs are connected without them",
    "the router, and a change of link meanwhile; the link behaves as set under `rate`",
    "reaching the link's data limit, systemd, a restart of the gateway, a full disk",
    "real recordings: these are random data, as much as the link carries in some seconds",
)
ROBOT_NOT_REHEARSED: Final = "the robot: its recordings are in a folder of this computer, without SSH or LAN"
_SECONDS: Final = 12
_LEAST_BYTES, _MOST_BYTES = 20_000, 3_000_000
_LOOK_S: Final = 0.2
_BUFFER: Final = 16384
_EXAMPLE_KEY: Final = "ssh-ed25519 AAAAC3NzaC1lZDI1NTE5AAAAIOzMkrV3HHY+skvjB+3Dgsy6+gi2Qp9FkJyNvsHCouP1"
"""Key of no computer; it is never used."""


def with_example(inventory: Inventory, site: str) -> tuple[Inventory, str | None]:
    """Return the inventory, and the example added if it has no recordings; raise NoMatchError."""
    if inventory.pilot.retrieval is not None or site not in inventory.sites:
        return inventory, None
    gateway = _first_vpn_host(inventory.site_hosts(site), model.Gateway)
    centre = _first_vpn_host(inventory.hosts.values(), model.ControlCentre)
    if gateway is None or centre is None:
        raise errors.NoMatchError(
            f"{arg(site)} has no gateway in the VPN, or the pilot has no control centre there",
            hint="docs/gateways.md describes the requirements for transferring recordings",
        )
    hosts = dict(inventory.hosts)
    for name in (gateway, centre):
        device = hosts[name].device
        assert isinstance(device, model.ServerComputer)  # noqa: S101 - `_first_vpn_host` has looked
        ssh_settings = device.ssh.model_copy(update={"host_key": device.ssh.host_key or _EXAMPLE_KEY})
        hosts[name] = replace(hosts[name], device=device.model_copy(update={"ssh": ssh_settings}))
    example = model.Retrieval.model_validate({"to": centre, "budget_mb": 1000, "sources": [{"host": gateway}]})
    pilot = inventory.pilot.model_copy(update={"retrieval": example})
    words = msg(
        f"the inventory has no recordings to retrieve: this is an example, from {arg(gateway)} to {arg(centre)}"
    )
    return replace(inventory, hosts=hosts, pilot=pilot), words


def _first_vpn_host(hosts: Iterable[Host], kind: type[model.ServerComputer]) -> str | None:
    in_vpn = (host for host in hosts if isinstance(host.device, kind) and host.device.vpn_address is not None)
    return next((host.name for host in in_vpn), None)


@dataclass(slots=True)
class RehearsedTransfer:
    """Both ends of a rehearsed transfer, and the link between them."""

    program: retrieve.RetrievalProgram
    recordings: Path
    target_folder: Path
    _relay: Relay
    _way: RelayLink
    cut_s: float = 0.0
    is_lost: bool = False
    """Whether the connection was lost in the gap."""

    @property
    def sent_bytes(self) -> int:
        """Bytes that the gateway has sent over the link."""
        return self._relay.traffic.up_bytes

    @property
    def recorded_bytes(self) -> int:
        """Size of all recordings in bytes."""
        return sum(path.stat().st_size for path in self.recordings.rglob("*") if path.is_file())

    def run(self, plan: retrieve.RetrievalPlan) -> retrieve.RetrievalStatus:
        """Send, interrupt the link once halfway, and wait for the end; raise NotBegun or GatewayAway."""
        job = plan.job(retrieve.RetrievalSelection(), retrieve.new_number())
        # A relay takes more than a link does before the gap, which is lost in it and counted.
        self.program.start({**job, "silence_s": SILENCE_S, "cap_bytes": None})
        while (status := self.program.status()).runs:
            if not self.cut_s and self.sent_bytes > self.recorded_bytes / 2:
                self._cut()
            time.sleep(_LOOK_S)
        return status

    def _cut(self) -> None:
        """Interrupt the link until the gateway waits for the control centre."""
        began = time.monotonic()
        self._relay.set(replace(self._way, up=False))
        while not self.is_lost and time.monotonic() < began + GAP_S:
            time.sleep(_LOOK_S)
            self.is_lost = self.program.status().state == "waiting"
        self._relay.set(self._way)
        self.cut_s = time.monotonic() - began

    def lines(self, *, same: bool) -> list[str]:
        """Return the final lines in addition to the transfer's status."""
        seconds = f"{self.cut_s:.0f}"
        cut = "the link was not interrupted"
        if self.cut_s:
            cut = msg(f"the link was interrupted for {arg(seconds)} s, and the connection survived")
        if self.is_lost:
            cut = msg(f"the link was interrupted for {arg(seconds)} s, and the connection was lost")
        return [
            msg(
                f"{arg(size(self.sent_bytes))} were sent over the emulated link for {arg(size(self.recorded_bytes))} "
                "of recordings"
            ),
            cut,
            "this computer compared both folders: they are identical"
            if same
            else "this computer compared both folders: they differ",
        ]

    def same(self) -> bool:
        """Return whether both folders have identical files, as read by this computer."""
        return _digests(self.recordings) == _digests(self.target_folder)


@contextmanager
def rehearsed_transfer(inventory: Inventory, source: retrieve.Source, link: model.Link) -> Iterator[RehearsedTransfer]:
    """Install and connect both ends until the context ends; raise UsageError."""
    if shutil.which("rsync") is None:
        raise errors.UsageError(
            "rsync is not installed on this computer, and the rehearsal needs it",
            hint="run `sudo apt install rsync`, then the same command again",
        )
    settings = inventory.pilot.retrieval
    assert settings is not None  # noqa: S101 - the source is of it
    with temporary.folder("retrieve") as root:
        for name in (source.host, settings.to):
            for file in retrieval(inventory, inventory.hosts[name], is_rehearsal=True).files:
                place = root / file.path.lstrip("/")
                place.parent.mkdir(parents=True, exist_ok=True)
                place.write_text(file.content)
        recordings = root / "recordings"
        _record(
            recordings, round(retrieve.SHARES[source.priority] * link.rate.up_kbps * 125 * _SECONDS / retrieve.WIRE)
        )
        environment = _environment(root, recordings)
        server = ssh.CommandServer(_receiver(root, source.host), environment)
        relay = Relay(socket.socket, server.address, buffer=_BUFFER)
        way = RelayLink(shapes=link_shapes(link))
        relay.set(way)
        _settle(root, source, recordings, relay.port)
        words = [f"{name}={value}" for name, value in environment.items()]
        program = retrieve.RetrievalProgram(
            inventory, source, lambda verb: ["env", "-i", *words, *_program_command(root, PROGRAM), verb]
        )
        target_folder = root / settings.folder.lstrip("/") / source.name
        try:
            yield RehearsedTransfer(program, recordings, target_folder, relay, way)
        finally:
            with suppress(errors.NetcfgError):
                program.stop()
            relay.close()
            server.close()


def _program_command(root: Path, program: str) -> list[str]:
    return [sys.executable, "-I", f"{root}{program}"]


def _environment(root: Path, robot: Path) -> dict[str, str]:
    """Return the environment of the programs, with the substitutes first in their PATH."""
    folder = root / "stand-ins"
    folder.mkdir()
    for name in ("ssh", "systemctl"):
        program = folder / name
        program.write_text(f'#!/bin/sh\nexec {shlex.join([sys.executable, "-I", ssh.__file__, name])} "$@"\n')
        program.chmod(0o755)
    return {
        "PATH": f"{folder}:{os.environ['PATH']}",
        "HOME": str(root),
        ssh.ROBOT: str(robot),
        ssh.UNIT: shlex.join([*_program_command(root, PROGRAM), "run"]),
        ssh.LOCK: str(root / "unit"),
    }


def _receiver(root: Path, gateway: str) -> list[str]:
    """Return the command that sshd would run for the gateway's key, with its paths below `root`."""
    lines = (root / "etc/atlantis/retrieval.keys").read_text()
    match = re.search(rf'command="([^"]*)" .* {gateway}$', lines, re.MULTILINE)
    assert match is not None  # noqa: S101 - `gateway/retrieval.py` writes it
    _, _, program, names, folder, budget = match[1].split(" ")
    (root / folder.lstrip("/")).mkdir(parents=True)
    return [*_program_command(root, program), names, f"{root}{folder}", budget]


def _settle(root: Path, source: retrieve.Source, recordings: Path, port: int) -> None:
    """Configure the gateway's program for the generated recordings and the relay."""
    path = root / "etc/atlantis/retrieval.json"
    settings = json.loads(path.read_text())
    settings.update({"from": "127.0.0.1", "address": "127.0.0.1", "port": port})
    row = settings["sources"][source.name]
    row["folder"] = f"{root}{row['folder']}" if isinstance(source, model.RetrievalRobot) else str(recordings)
    path.write_text(json.dumps(settings))
    (root / "var/lib/atlantis/retrieval").mkdir(parents=True)


def _record(folder: Path, size: int) -> None:
    """Write three finished files of random data."""
    whole = min(_MOST_BYTES, max(_LEAST_BYTES, size))
    for name, part in (("bag-1/bag-1_0.db3", 0.6), ("bag-1/metadata.yaml", 0.01), ("bag-2/bag-2_0.db3", 0.39)):
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(os.urandom(int(whole * part)))
        os.utime(path, (time.time() - 3600,) * 2)


def _digests(folder: Path) -> dict[str, str]:
    files = [path for path in folder.rglob("*") if path.is_file()]
    return {str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest() for path in files}
