"""The computers of a rehearsal: real Debian systems with systemd, where this computer can run them.

The VPN authority of a rehearsal is created in its folder, encrypted with a passphrase that is never shown.
"""

from __future__ import annotations

import base64
import hashlib
import secrets
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from ipaddress import IPv4Interface
from typing import TYPE_CHECKING

from cryptography.hazmat.primitives import serialization
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

from atlantis_netcfg.computers.base import gateway_base
from atlantis_netcfg.computers.containers import IMAGES
from atlantis_netcfg.computers.interop import gateway_interop
from atlantis_netcfg.computers.recording import packages as recorder
from atlantis_netcfg.computers.retrieval import PACKAGES as RETRIEVAL
from atlantis_netcfg.computers.ros1_bridge import packages as bridge
from atlantis_netcfg.core import events
from atlantis_netcfg.core.secret import Secret
from atlantis_netcfg.emulator import lab
from atlantis_netcfg.emulator.lab import stubs
from atlantis_netcfg.emulator.lab.stubs.image import NOT_REHEARSED as NO_IMAGES
from atlantis_netcfg.emulator.lab.stubs.interop import NOT_REHEARSED as NO_LIBRARY
from atlantis_netcfg.emulator.lab.stubs.interop import InteropProjects, serve_git
from atlantis_netcfg.inventory import model
from atlantis_netcfg.operations.common.request import StandIns, Target
from atlantis_netcfg.operations.computers._access import is_computer, is_server
from atlantis_netcfg.runs import write_atomically
from atlantis_netcfg.vpn import requests
from atlantis_netcfg.vpn.authority.authority import Authority
from atlantis_netcfg.vpn.authority.model import EnrolmentFile
from atlantis_netcfg.vpn.enrolment_package.profile import identity_file
from atlantis_netcfg.vpn.members import server_names
from atlantis_netcfg.vpn.server import PACKAGES as VPN

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence
    from pathlib import Path

    from atlantis_netcfg.inventory import Host, Inventory
    from atlantis_netcfg.vpn.identity import Identity


_CODENAME = lab.TreeSpec().release
_STATE = (
    "find /etc /opt /usr/local /var/lib/atlantis /var/lib/dpkg -xdev -path /var/lib/atlantis/tool -prune"
    " -o -type f -printf '%p %s %T@\\n' 2>/dev/null | sort"
)
"""Command that lists files with size and time; without the toolkit's own program, which a plan sends as well."""
_KEYS = serialization.Encoding.OpenSSH


@dataclass(frozen=True, slots=True)
class RehearsedComputers:
    """The emulated computers of a rehearsal."""

    machines: Mapping[str, lab.Machine] = field(default_factory=dict)
    targets: Mapping[str, Target] = field(default_factory=dict)
    left_out: Mapping[str, str] = field(default_factory=dict)
    """Reason why a host has no emulator, by host name."""
    stubs: StandIns | None = None
    images: dict[str, dict[str, str]] = field(default_factory=dict)
    """SHA-256 of the archive that replaces a service's image, by host name and service."""
    authority: Path | None = None
    """Folder of the VPN authority that was created for the rehearsal."""
    not_rehearsed: tuple[str, ...] = ()

    def export(self, name: str) -> str:
        """Return the current configuration files and packages: name, size and time of every file."""
        return self.machines[name].run(_STATE).stdout


@contextmanager
def rehearsed_computers(
    inventory: Inventory, hosts: Sequence[Host], folder: Path, notify: events.Subscriber
) -> Iterator[RehearsedComputers]:
    """Start an emulated computer for each computer among `hosts` until the context ends; raise MachineError."""
    computers = [host for host in hosts if is_computer(host)]
    if not computers:
        yield RehearsedComputers()
        return
    lab.provide(lambda words: notify(events.Event(computers[0].name, events.Stage.CONNECTING, words)))
    if why := lab.why_not():
        yield RehearsedComputers(left_out={host.name: why for host in computers})
        return
    for host in computers:
        notify(
            events.Event(
                host.name, events.Stage.CONNECTING, "a Debian is made for it; the first time that takes two minutes"
            )
        )
    root = lab.build_rootfs(tree_spec(inventory))
    folder.mkdir(mode=0o700, exist_ok=True)
    public = _key(folder / "key")
    with ExitStack() as stack:
        ground = stack.enter_context(lab.open_lab(folder))
        machines = {host.name: _boot_machine(ground, inventory, host, root, public) for host in computers}
        targets = {name: _target(machine, folder) for name, machine in machines.items()}
        serving = [host.device for host in computers if isinstance(host.device, model.ServerComputer)]
        servers = any(map(is_server, computers))
        images = {host.name: _provide_images(machines[host.name], host.device, root) for host in computers}
        stand_ins = (
            _serve_stand_ins(stack, ground, inventory, folder) if any(device.has_ros2 for device in serving) else None
        )
        authority, untold = (
            _server_authority(inventory, folder) if servers else _client_identities(inventory, computers, folder)
        )
        with ThreadPoolExecutor(len(computers)) as pool:  # all have booted meanwhile
            list(pool.map(_prepare_machine, machines.values(), (host.device for host in computers)))
        result = (
            *((_CLOCK,) if serving else ()),
            *((_NETWORK,) if any(map(_declares_network, computers)) else ()),
            *(line for line in lab.NOT_REHEARSED if not line.startswith("the clock:")),
            *((*stubs.NOT_REHEARSED, *NO_LIBRARY) if stand_ins is not None else ()),
            *((_SERVICES,) if any(map(_service_programs, serving)) else ()),
            *(NO_IMAGES if any(images.values()) else ()),
            *untold,
        )
        yield RehearsedComputers(
            machines, targets, stubs=stand_ins, images=images, authority=authority, not_rehearsed=result
        )


def _server_authority(inventory: Inventory, folder: Path) -> tuple[Path, tuple[str, ...]]:
    """Create an authority for the server; return its folder and the limits of the rehearsal."""
    return create_authority(inventory, folder / "vpn"), NOT_REHEARSED


def _client_identities(inventory: Inventory, hosts: Sequence[Host], folder: Path) -> tuple[Path, tuple[str, ...]]:
    """Create identities for gateways that no server of this rehearsal knows; return folder and limits."""
    from atlantis_netcfg.vpn import rehearsal  # noqa: PLC0415 - as above

    return rehearsal.identities(inventory, hosts, folder / "vpn"), rehearsal.NOT_REHEARSED


def tree_spec(inventory: Inventory) -> lab.TreeSpec:
    """Return the Debian packages of the pilot's computers: a rehearsal has no network to download them.

    The list covers all sites, so that one tree is enough. ROS packages come from substitutes, at their place in the
    run.
    """
    package_names = {"colcon", "gnupg", "python3-colcon-cmake", "python3-colcon-recursive-crawl", *VPN, *RETRIEVAL}
    for host in inventory.hosts.values():
        if isinstance(host.device, model.ServerComputer):
            package_names |= {item.name for item in gateway_base(inventory, host).packages}
            package_names |= {package.name for package in gateway_interop(inventory, host).packages}
    return lab.TreeSpec(packages=tuple(sorted(package_names)))


def _serve_stand_ins(stack: ExitStack, ground: lab.Lab, inventory: Inventory, folder: Path) -> StandIns | None:
    """Serve substitutes for the ROS archive and the partners' repositories; None if the inventory has no ROS."""
    pilot = inventory.pilot
    if pilot.dds is None or pilot.gateways.ros2 is None:
        return None
    release = pilot.dds.distribution.value
    packages = stubs.ros_packages(release, more=(*pilot.gateways.ros2.packages, *recorder(release), *bridge(release)))
    archive = stubs.publish(folder / "archive", packages, codename=_CODENAME)
    repositories = ""
    if (interop := pilot.gateways.interop) is not None:
        projects = InteropProjects(folder / "git")
        projects.release(interop.library.revision)
        if interop.examples is not None:
            projects.release_examples(interop.examples.revision)
        token = interop.library.token.reveal() if interop.library.token is not None else None
        repositories = stack.enter_context(serve_git(folder / "git", ground.listen(), token)).url
    return StandIns(
        archive=ground.serve(archive.folder),
        key=base64.b64encode(archive.key).decode(),
        fingerprint=archive.fingerprint,
        codename=_CODENAME,
        distribution="debian",
        repositories=repositories,
    )


_NETWORK = "the declared network of the computers: a machine keeps the one that it was started with"
_SERVICES = "services: the partners' programs; in their places stand-ins listen at the declared ports"
_CLOCK = "the clock: chrony runs and leaves it alone, for it is this computer's"


def _declares_network(host: Host) -> bool:
    return isinstance(host.device, model.SiteComputer) and host.device.network is not None


def _boot_machine(ground: lab.Lab, inventory: Inventory, host: Host, root: Path, public: str) -> lab.Machine:
    device, lan = host.device, inventory.sites[host.site].lan
    assert isinstance(device, model.SshHost)  # noqa: S101 - `is_computer` has said so
    interface = IPv4Interface(f"{device.address}/{lan.network.prefixlen}")
    gateway = str(lan.gateway)
    return ground.start(host.name, root, address=str(interface), gateway=gateway, keys=(public,), wait_s=None)


def _prepare_machine(machine: lab.Machine, device: model.Model) -> None:
    """Wait until a machine accepts SSH, and let chrony and the services start in it."""
    machine.wait_until_up()
    if not isinstance(device, model.ServerComputer):
        return
    machine.put("/etc/systemd/system/chrony.service.d/rehearsal.conf", "[Unit]\nConditionCapability=\n")
    machine.put("/etc/default/chrony", 'DAEMON_OPTS="-F 1 -x"\n')
    machine.run("systemctl daemon-reload")
    for service, program in _service_programs(device):
        machine.put(program.path, stubs.service_program(service.transport.value, service.port or 0), mode="0755")


def _provide_images(machine: lab.Machine, device: model.Model, root: Path) -> dict[str, str]:
    """Copy substitute container images to the folder where a person places the real ones."""
    if not isinstance(device, model.ServerComputer):
        return {}
    containers: dict[str, tuple[model.ServiceContainer | model.Ros1Bridge | None, str, int]] = {
        each.name: (each.container, each.transport.value, each.port or 0) for each in device.services
    }
    containers[model.ROS1_BRIDGE] = (device.ros1_bridge, "tcp", 0)
    images = {}
    for name, (box, kind, port) in containers.items():
        if box is not None and box.archive is not None:
            archive = stubs.service_image(root, kind, port)
            images[name] = hashlib.sha256(archive).hexdigest()
            machine.put_bytes(f"{IMAGES}/{images[name]}.tar", archive)
    for path, text in stubs.PODMAN_IN_A_MACHINE.items() if images else ():
        machine.put(path, text)
    return images


def _service_programs(device: model.ServerComputer) -> list[tuple[model.HostedService, model.ServiceProgram]]:
    """Return the services of a computer that start a program, with their programs."""
    return [(service, service.program) for service in device.services if service.program is not None]


def _target(machine: lab.Machine, folder: Path) -> Target:
    known_hosts = folder / f"{machine.name}.known"
    write_atomically(known_hosts, f"{machine.name} {machine.host_key}\n".encode())
    return Target(host="127.0.0.1", port=machine.port, known_hosts=str(known_hosts), identity=str(folder / "key"))


def _key(path: Path) -> str:
    """Create the technician's SSH key of this rehearsal; return the public key."""
    key = Ed25519PrivateKey.generate()
    private = key.private_bytes(_KEYS.PEM, serialization.PrivateFormat.OpenSSH, serialization.NoEncryption())
    write_atomically(path, private)
    return key.public_key().public_bytes(_KEYS, serialization.PublicFormat.OpenSSH).decode() + " rehearsal"


NOT_REHEARSED = (
    "the VPN: its authority, its keys and its members are made for the rehearsal; partners' devices are not among them",
    "the VPN's server: the port that its own router forwards, and the internet before it",
    "the VPN's server: its own firewall besides the VPN's, and whatever else runs on the real computer",
)
_WHO = "rehearsal"


def create_authority(inventory: Inventory, folder: Path) -> Path:
    """Create the rehearsal's authority, with an identity for every VPN client host; return the folder."""
    passphrase = Secret(secrets.token_urlsafe(24))
    authority = Authority.init(folder, passphrase, server_names(inventory), _WHO)
    hosts = folder / "hosts"
    hosts.mkdir(mode=0o700, exist_ok=True)

    def deliver(identity: Identity) -> EnrolmentFile:
        path, data = hosts / f"{identity.member.name}.identity", identity_file(identity).reveal().encode()
        write_atomically(path, data)
        return EnrolmentFile(str(path), hashlib.sha256(data).hexdigest())

    with authority.unlock(lambda: passphrase, _WHO) as signer:
        signer.issue(
            [
                requests.request_of(inventory, requests.DeviceWords(device=name))
                for name in requests.computers(inventory)
            ],
            deliver,
        )
    return folder
