"""One lab machine: Debian with systemd in systemd-nspawn, its disk, network and local port for sshd."""

from __future__ import annotations

import ctypes
import os
import shlex
import signal
import socket
import subprocess
import time
import uuid
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

from cryptography.hazmat.primitives import serialization
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

from atlantis_netcfg.core.errors import NetcfgError
from atlantis_netcfg.emulator.lab import reaper, relay

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence
    from ipaddress import IPv4Interface

    from atlantis_netcfg.emulator.udp_link import LinkShape


class MachineError(NetcfgError):
    """A lab machine could not be built, started or queried; nothing beyond this computer was touched."""


def output_of(
    words: Sequence[str], *, text: str | None = None, timeout_s: float | None = None, keep: Sequence[int] = ()
) -> subprocess.CompletedProcess[str]:
    """Run a program and return its result, even after failure; `keep`: inherited file descriptors."""
    return subprocess.run(  # noqa: S603 - a program of the system, and arguments that are ours
        words,
        input="" if text is None else text,
        capture_output=True,
        text=True,
        errors="replace",
        check=False,
        timeout=timeout_s,
        pass_fds=keep,
    )


def program(*words: str) -> str:
    """Run a program and return its output. Raises MachineError if it fails."""
    result = output_of(words)
    if result.returncode:
        raise MachineError(f"{' '.join(words)}: {result.stderr.strip() or f'ended with {result.returncode}'}")
    return result.stdout


_PAUSE_S = 0.02
_END_S = 20.0
# The clock is not namespaced: with CAP_SYS_TIME a machine would set this computer's.
_OPTIONS = (
    *("--quiet", "--boot", "--register=no", "--keep-unit", "--settings=no", "--link-journal=no"),
    *("--console=read-only", "--resolv-conf=off", "--timezone=off"),
    *("--capability=CAP_NET_ADMIN,CAP_NET_RAW", "--drop-capability=CAP_SYS_TIME"),
)
_INTO_GROUPS = 'for group in $ATLANTIS_GROUPS; do echo $$ > "$group/cgroup.procs"; done; exec "$@"'


def wait(until: Callable[[], object], timeout_s: float, otherwise: Callable[[], str]) -> None:
    """Wait until a condition is true. Raises MachineError with the given text after a timeout."""
    end = time.monotonic() + timeout_s
    while not until():
        if time.monotonic() > end:
            raise MachineError(otherwise())
        time.sleep(_PAUSE_S)


class Container:
    """One power-on of a machine; `name` is also its network namespace and cgroup."""

    def __init__(self, name: str, hostname: str, root: Path, log: Path) -> None:
        self._name = name
        self._log = log
        # Two containers in one control group would stop each other's services: each gets its own.
        self._groups = [hierarchy / name for hierarchy in reaper.control_groups()]
        for group in self._groups:
            group.mkdir(exist_ok=True)
        tun = ("--bind=/dev/net/tun",) if Path("/dev/net/tun").exists() else ()
        place = (f"--directory={root}", f"--network-namespace-path=/run/netns/{name}")
        names = (f"--machine={name}", f"--hostname={hostname}")
        with log.open("ab") as console:
            self._nspawn = subprocess.Popen(  # noqa: S603 - a program of the system, and arguments that are ours
                ("/bin/sh", "-c", _INTO_GROUPS, "sh", "systemd-nspawn", *_OPTIONS, *place, *names, *tun),
                stdin=subprocess.DEVNULL,
                stdout=console,
                stderr=console,
                cwd="/",
                start_new_session=True,
                env={
                    "PATH": os.environ.get("PATH", os.defpath),
                    "ATLANTIS_GROUPS": " ".join(map(str, self._groups)),
                    "SYSTEMD_NSPAWN_API_VFS_WRITABLE": "network",
                },
            )

    @property
    def runs(self) -> bool:
        """Whether the container is still running."""
        return self._nspawn.poll() is None

    def leader(self) -> int | None:
        """Return the PID of the systemd inside; None before it starts (no isolation yet) and after it ends."""
        first = self._first()
        with suppress(OSError):
            if first is not None and not _is_same_program(first, self._nspawn.pid):
                return first
        return None

    def _first(self) -> int | None:
        """Return the process with PID 1 inside, whatever it runs."""
        tasks = Path("/proc", str(self._nspawn.pid), "task", str(self._nspawn.pid), "children")
        with suppress(OSError):
            for child in tasks.read_text(encoding="ascii").split():
                if _is_first_in_namespace(child):
                    return int(child)
        return None

    def kill(self) -> None:
        """Kill the container and everything in it, like a power cut."""
        while self.runs and (first := self._first()) is not None:
            with suppress(ProcessLookupError):
                os.kill(first, signal.SIGKILL)
            with suppress(subprocess.TimeoutExpired):
                self._nspawn.wait(_PAUSE_S)
        if self.runs:
            self._nspawn.kill()
        self._nspawn.wait(_END_S)
        for group in self._groups:
            reaper.remove_group(group)
        reaper.remove(Path("/run/systemd/nspawn/propagate", self._name))

    def console_tail(self) -> str:
        """Return the end of the console log."""
        lines = self._log.read_text(encoding="utf-8", errors="replace").splitlines()[-5:]
        return "\n".join(f"  {line}" for line in lines)


def nsenter_prefix(leader: int) -> tuple[str, ...]:
    """Return the command prefix that runs a program inside, with root's capabilities there.

    The bounding set of the container's init is applied: otherwise the program would keep this computer's capabilities,
    such as setting its clock.
    """
    status = Path("/proc", str(leader), "status").read_text(encoding="utf-8")
    mask = int(next(line.split()[1] for line in status.splitlines() if line.startswith("CapBnd:")), 16)
    current = ",".join(["-all", *(f"+cap_{number}" for number in range(mask.bit_length()) if mask >> number & 1)])
    confinement = ("setpriv", f"--bounding-set={current}", "--inh-caps=-all")
    return (*confinement, "nsenter", "--target", str(leader), "--all", "--")


def _is_same_program(item: int, other: int) -> bool:
    return Path(f"/proc/{item}/exe").samefile(f"/proc/{other}/exe")


def _is_first_in_namespace(process: str) -> bool:
    with suppress(OSError):
        for line in Path("/proc", process, "status").read_text(encoding="utf-8").splitlines():
            if line.startswith("NSpid:"):
                return line.split()[-1] == "1"
    return False


BRIDGE = "br0"
_CLONE_NEWNET = 0x40000000
_LIBC = ctypes.CDLL(None, use_errno=True)


def add_namespace(name: str) -> None:
    """Create a network namespace with its loopback up."""
    program("ip", "netns", "add", name)
    program("ip", "-n", name, "link", "set", "lo", "up")


def delete_namespace(name: str) -> None:
    """Delete a namespace with its links; open sockets keep it alive without a name."""
    if Path("/run/netns", name).exists():
        program("ip", "netns", "delete", name)


def run_in_namespace(name: str, *words: str, text: str | None = None) -> str:
    """Run a program in a namespace and return its output. Raises MachineError if it fails."""
    result = output_of(("ip", "netns", "exec", name, *words), text=text)
    if result.returncode:
        raise MachineError(f"{' '.join(words)}: {result.stderr.strip() or f'ended with {result.returncode}'}")
    return result.stdout


def ip_batch(name: str, lines: Iterable[str], *, force: bool = False) -> None:
    """Give lines to `ip` in a namespace. Raises MachineError for the first that fails, unless `force`."""
    if text := "".join(f"{line}\n" for line in lines):
        result = output_of(("ip", "-n", name, *(("-force",) if force else ()), "-batch", "-"), text=text)
        if result.returncode and not force:
            raise MachineError(f"{name}: {result.stderr.strip()}")


def connect_veth(lab: str, bridge: str, port: str, machine: str, interface: str, mac: str) -> None:  # noqa: PLR0913, PLR0917 - two ends
    """Connect a machine's interface to a port of a bridge; the port is down."""
    program(
        *("ip", "link", "add", interface, "netns", machine, "address", mac, "type", "veth"),
        *("peer", "name", port, "netns", lab),
    )
    program("ip", "-n", lab, "link", "set", port, "master", bridge)


_Result = TypeVar("_Result")


class NamespaceSockets:
    """Creates sockets in a network namespace, by threads in it; a socket stays in its namespace."""

    def __init__(self, namespace: str) -> None:
        self._pool = ThreadPoolExecutor(4, namespace, initializer=_enter, initargs=(namespace,))

    def socket(self, kind: int = socket.SOCK_STREAM, family: int = socket.AF_INET, protocol: int = 0) -> socket.socket:
        """Return a socket that any thread can use."""
        return self._pool.submit(socket.socket, family, kind, protocol).result()

    def call(self, function: Callable[[str], _Result], name: str) -> _Result:
        """Call a function in the namespace."""
        return self._pool.submit(function, name).result()

    def close(self) -> None:
        """Stop the threads."""
        self._pool.shutdown()


def _enter(namespace: str) -> None:
    with Path("/run/netns", namespace).open("rb") as door:
        if _LIBC.setns(door.fileno(), _CLONE_NEWNET):
            code = ctypes.get_errno()
            raise OSError(code, os.strerror(code), namespace)


_MB = 1024 * 1024


class Disk:
    """Disk mounted at `root` until it is discarded; data survive a power cut, but not the end of the lab.

    The shared tree is the lower layer; changes are in an upper layer in memory, with its own size limit.
    """

    def __init__(self, folder: Path, tree: Path, size_mb: int | None) -> None:
        self.root = folder / "root"
        self._memory = folder / "disk"
        self._size = "50%" if size_mb is None else f"{size_mb * _MB}"
        for directory in (self.root, self._memory):
            directory.mkdir(parents=True)
        program("mount", "-t", "tmpfs", "-o", f"size={self._size},mode=0755", "atlantis", str(self._memory))
        upper, work = self._memory / "upper", self._memory / "work"
        upper.mkdir()
        work.mkdir()
        layers = f"lowerdir={tree.resolve()},upperdir={upper},workdir={work}"
        program("mount", "-t", "overlay", "-o", layers, "atlantis", str(self.root))

    def fill(self, leave_kb: int) -> None:
        """Shrink the disk to its contents plus `leave_kb`."""
        there = os.statvfs(self._memory)
        used = (there.f_blocks - there.f_bfree) * there.f_frsize
        self._resize(f"{used + leave_kb * 1024}")

    def free(self) -> None:
        """Restore the original size."""
        self._resize(self._size)

    def _resize(self, size: str) -> None:
        program("mount", "-o", f"remount,size={size}", str(self._memory))


_SSH = 22
_PATIENCE_S = 60.0
_ENVIRONMENT = ("PATH=/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin", "HOME=/root", "LANG=C.UTF-8")


@dataclass(frozen=True)
class MachineSpec:
    """Settings of a machine; `address` has a prefix length, `gateway` is the lab's own address."""

    name: str
    tree: Path
    address: IPv4Interface
    gateway: str
    keys: Sequence[str] = ()
    disk_mb: int | None = None
    interface: str = "eth0"
    spare: str | None = None
    """Name of a second interface on the same cable, without an address; None: there is none."""


class Machine:
    """A lab machine, made by `Yard.start`; it ends with the lab."""

    def __init__(  # noqa: PLR0913, PLR0917 - where it is in the lab, and where its files are
        self, spec: MachineSpec, unique: str, lab: str, inside: NamespaceSockets, folder: Path, log: Path
    ) -> None:
        self.spec = spec
        self._unique, self._lab, self._bridge, self._inside, self._log = unique, lab, BRIDGE, inside, log
        self._ports: list[str] = []
        self._container: Container | None = None
        self._disk = Disk(folder, spec.tree, spec.disk_mb)
        self.host_key = _card(self._disk.root, spec)
        self._relay = relay.Relay(inside.socket, (str(spec.address.ip), _SSH))

    @property
    def name(self) -> str:
        """Its host name."""
        return self.spec.name

    @property
    def address(self) -> str:
        """Inventory address without prefix length; reachable only from inside the lab network."""
        return str(self.spec.address.ip)

    @property
    def port(self) -> int:
        """Port of 127.0.0.1 that is forwarded to the machine's sshd."""
        return self._relay.port

    @property
    def traffic(self) -> relay.RelayTraffic:
        """Traffic through `port` since the start; connections inside the lab are not counted."""
        return self._relay.traffic

    @property
    def runs(self) -> bool:
        """Whether the machine is on; it also ends after `poweroff` or `reboot`."""
        return self._container is not None and self._container.runs

    def link(
        self,
        *,
        delay_s: float = 0.0,
        rate_up_bps: float | None = None,
        rate_down_bps: float | None = None,
        up: bool = True,
        shapes: tuple[LinkShape, LinkShape] | None = None,
    ) -> None:
        """Set the properties of the link through `port`; an omitted one means no limit. See `RelayLink`."""
        self._relay.set(relay.RelayLink(delay_s, rate_up_bps, rate_down_bps, up, shapes))

    def move_cable(self, namespace: str, bridge: str, inside: NamespaceSockets) -> tuple[str, str, NamespaceSockets]:
        """Plug the machine's cable into another bridge; `port` then leads there, by sockets of that namespace.

        Returns where it was before, as arguments to move it back.
        """
        before = self._lab, self._bridge, self._inside
        for port in self._ports:
            program("ip", "-n", self._lab, "link", "set", port, "netns", namespace)
            program("ip", "-n", namespace, "link", "set", port, "master", bridge)
            program("ip", "-n", namespace, "link", "set", port, "up")
        self._lab, self._bridge, self._inside = namespace, bridge, inside
        self._relay.lead(inside.socket)
        return before

    @property
    def namespace(self) -> str:
        """Its network namespace, while it is on."""
        return self._unique

    def power_on(self, *, is_configured: bool = True, wait_s: float | None = _PATIENCE_S) -> None:
        """Boot the machine and wait for its sshd.

        `is_configured`: its interface gets the inventory address and a default route, as if its own configuration had
        set them; False leaves that to the configuration on its disk. `wait_s`: None returns at once.
        """
        if self.runs:
            raise MachineError(f"{self.name} runs already")
        self._off()
        self._plug(is_configured=is_configured)
        self._container = Container(self._unique, self.name, self._disk.root, self._log)
        if wait_s is not None:
            self.wait_until_up(wait_s)

    def power_cut(self) -> None:
        """Cut the power: no process can shut down, and peers are not notified. The disk is kept."""
        self._off()

    def stop(self) -> None:
        """Stop the machine permanently and close its port; its disk is removed with the lab."""
        self._relay.close()
        self._off()

    def wait_until_up(self, timeout_s: float = _PATIENCE_S) -> None:
        """Wait until sshd accepts logins. Raises MachineError with the last console lines after a timeout."""
        wait(lambda: not self.runs or self._is_ready(), timeout_s, lambda: self._console_message("does not answer SSH"))
        if not self.runs:
            raise MachineError(self._console_message("ended while it booted"))

    def state(self, *, wait_for_boot: bool = False) -> str:
        """Return systemd's state: `running`, `degraded`, `starting`, …; `wait_for_boot`: wait until it has booted."""
        wait_words = ("--wait",) if wait_for_boot else ()
        return self.run(shlex.join(("systemctl", "is-system-running", *wait_words)), check=False).stdout.strip()

    def run(
        self,
        command: str,
        *,
        input: str | None = None,  # noqa: A002 - as subprocess.run has it
        check: bool = True,
        timeout_s: float | None = None,
    ) -> subprocess.CompletedProcess[str]:
        """Run a shell command inside as root, without SSH; `check`: raises MachineError unless it ends with 0."""
        wait(lambda: not self.runs or self._leader(), _PATIENCE_S, lambda: self._console_message("does not boot"))
        leader = self._leader()
        if leader is None:
            raise MachineError(f"{self.name} is off")
        result = output_of(
            (*nsenter_prefix(leader), "env", "-i", *_ENVIRONMENT, "/bin/sh", "-c", command),
            text=input,
            timeout_s=timeout_s,
        )
        if check and result.returncode:
            raise MachineError(f"{self.name}: {command}: ended with {result.returncode}: {result.stderr.strip()}")
        return result

    def put(self, path: str, text: str, *, mode: str = "0644") -> None:
        """Write a text file and its parent folders; also works while the machine is off."""
        name = shlex.quote(path)
        folder = shlex.quote(str(Path(path).parent))
        command = f"mkdir -p {folder} && cat > {name} && chmod {mode} {name}"
        if self.runs:
            self.run(command, input=text)
            return
        result = output_of(("chroot", str(self._disk.root), "/bin/sh", "-c", command), text=text)
        if result.returncode:
            raise MachineError(f"{self.name}: {path} cannot be written: {result.stderr.strip()}")

    def put_bytes(self, path: str, data: bytes) -> None:
        """Write a binary file directly to the disk, whether the machine is on or off."""
        place = self._disk.root / path.lstrip("/")
        place.parent.mkdir(parents=True, exist_ok=True)
        place.write_bytes(data)

    def fill_disk(self, *, leave_kb: int = 0) -> None:
        """Fill the disk; running programs get ENOSPC."""
        self._disk.fill(leave_kb)

    def free_disk(self) -> None:
        """Undo `fill_disk`."""
        self._disk.free()

    def _plug(self, *, is_configured: bool) -> None:
        """Create the network namespace and its interfaces; MAC addresses are the same each time."""
        add_namespace(self._unique)
        for interface in filter(None, (self.spec.interface, self.spec.spare)):
            port = f"{self._unique.rpartition('-')[2]}-{len(self._ports)}"
            mac = bytes([2, *sha256(f"{self._unique} {interface}".encode()).digest()[:5]]).hex(":")
            connect_veth(self._lab, self._bridge, port, self._unique, interface, mac)
            self._ports.append(port)
        near = self.spec.interface
        if is_configured:
            self._ip("address", "add", str(self.spec.address), "dev", near)
            self._ip("link", "set", near, "up")
        for port in self._ports:
            program("ip", "-n", self._lab, "link", "set", port, "up")
        if is_configured:
            self._ip("route", "add", "default", "via", self.spec.gateway)

    def _ip(self, *words: str) -> None:
        program("ip", "-n", self._unique, *words)

    def _off(self) -> None:
        """Power off; interfaces are removed first, so that peers are not notified."""
        while self._ports:
            program("ip", "-n", self._lab, "link", "delete", self._ports.pop())
        if self._container is not None:
            self._container.kill()
            self._container = None
        delete_namespace(self._unique)

    def _leader(self) -> int | None:
        return None if self._container is None else self._container.leader()

    def _is_ready(self) -> bool:
        """Return whether sshd sends its banner and the boot has reached the point where users may log in."""
        leader = self._leader()
        if leader is None or Path(f"/proc/{leader}/root/run/nologin").exists():
            return False
        with suppress(OSError), self._inside.socket() as caller:
            caller.settimeout(1.0)
            caller.connect((self.address, _SSH))
            return caller.recv(4) == b"SSH-"
        return False

    def _console_message(self, what: str) -> str:
        words = self._container.console_tail() if self._container is not None else ""
        return f"machine {self.name} {what}; its console ({self._log}):\n{words}"


def _card(root: Path, spec: MachineSpec) -> str:
    """Write the host-specific files of a card; return the public host key."""
    key = Ed25519PrivateKey.generate()
    private = key.private_bytes(
        serialization.Encoding.PEM, serialization.PrivateFormat.OpenSSH, serialization.NoEncryption()
    )
    public = key.public_key().public_bytes(serialization.Encoding.OpenSSH, serialization.PublicFormat.OpenSSH)
    _file(root / "etc/ssh/ssh_host_ed25519_key", private.decode(), 0o600)
    _file(root / "etc/ssh/ssh_host_ed25519_key.pub", public.decode() + "\n", 0o644)
    _file(root / "etc/hostname", f"{spec.name}\n", 0o644)
    _file(root / "etc/hosts", f"127.0.0.1 localhost\n127.0.1.1 {spec.name}\n::1 localhost\n", 0o644)
    _file(root / "etc/machine-id", f"{uuid.uuid4().hex}\n", 0o444)
    (root / "root/.ssh").mkdir(mode=0o700, exist_ok=True)
    _file(root / "root/.ssh/authorized_keys", "".join(f"{line.strip()}\n" for line in spec.keys), 0o600)
    return public.decode()


def _file(path: Path, text: str, mode: int) -> None:
    path.write_text(text, encoding="utf-8")
    path.chmod(mode)


NOT_REHEARSED = (
    "the clock: it is this computer's and cannot be set; chrony does not start",
    "the kernel: it is this computer's, with its modules and processor, not the board's; no module can be loaded",
    "kernel settings: those outside net.* cannot be written, nor those of net.* that a namespace lacks",
    "reboot: a machine that reboots stops; its power can be cut and restored",
    "the watchdog, the eMMC and the card, U-Boot, serial ports, GPS: not present",
    "the effect of a power cut: all written data are kept, including data that were never fsynced",
    "Ubuntu: the machine runs Debian",
    "memory and processor limits of a service: they are accepted, but only work if this computer delegates them",
    "the network beyond the rehearsal: there is none",
)
"""Limits of a rehearsal with machines; printed in the rehearsal's report."""
