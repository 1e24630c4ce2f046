"""Lab: containers in an isolated network of this computer.

The module also checks whether machines can run here, and installs missing packages.
"""

from __future__ import annotations

import fcntl
import functools
import itertools
import os
import shutil
import socket
import subprocess
import sys
import threading
from contextlib import ExitStack, contextmanager
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from ipaddress import IPv4Interface
from pathlib import Path
from typing import TYPE_CHECKING

from atlantis_netcfg.core.messages import arg, msg
from atlantis_netcfg.emulator.lab import hosts, reaper
from atlantis_netcfg.emulator.lab.rootfs import in_use

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence

OFF = "ATLANTIS_NO_MACHINES"
"""Environment variable that disables machines, whatever its value."""
_PROGRAMS = {
    "mmdebstrap": "mmdebstrap",
    "systemd-nspawn": "systemd-container",
    "ip": "iproute2",
    "nsenter": "util-linux",
    "setpriv": "util-linux",
    "unshare": "util-linux",
    "mount": "mount",
    "git": "git",
    "gpg": "gnupg",
    "nft": "nftables",
    "conntrack": "conntrack",
    "openvpn": "openvpn",
}
"""Program to the Debian package that provides it; stub packages are served from signed repositories."""
_KEYRING = Path("/usr/share/keyrings/debian-archive-keyring.gpg")


def why_not(environ: Mapping[str, str] | None = None) -> str | None:
    """Return why no machine can run here, in a few words, or None."""
    if why := _disabled_reason(environ):
        return why
    packages = missing_packages()
    return msg(f"missing: apt install {arg(' '.join(packages))}") if packages else _forbidden()


def provide(tell: Callable[[str], None], environ: Mapping[str, str] | None = None) -> None:
    """Install missing packages if this is Debian and the user is root; otherwise do nothing.

    `why_not` then lists what could not be installed.
    """
    packages = () if _disabled_reason(environ) else missing_packages()
    if not packages or shutil.which("apt-get") is None:
        return
    tell(msg(f"installing {arg(' '.join(packages))}"))
    quiet = ("env", "DEBIAN_FRONTEND=noninteractive", "apt-get", "-qq", "-o", "DPkg::Lock::Timeout=300")
    install = (*quiet, "install", "-y", "--no-install-recommends", *packages)
    if hosts.output_of(install).returncode:
        hosts.output_of((*quiet, "update"))
        hosts.output_of(install)


def _disabled_reason(environ: Mapping[str, str] | None) -> str | None:
    if (os.environ if environ is None else environ).get(OFF) is not None:
        return msg(f"{arg(OFF)} is set")
    if sys.platform != "linux":
        return "not Linux"
    return "not root" if os.geteuid() != 0 else None


def missing_packages() -> tuple[str, ...]:
    """Return the Debian packages that machines need and this computer lacks."""
    packages = {package for name, package in _PROGRAMS.items() if shutil.which(name) is None}
    if not _KEYRING.exists():
        packages.add("debian-archive-keyring")
    return tuple(sorted(packages))


def _forbidden() -> str | None:
    """Return which kernel feature is missing or forbidden here (for example in a container), or None."""
    if not _has_overlays():
        return "the kernel has no overlay file system"
    if hosts.output_of(("unshare", "--net", "--mount", "--pid", "--fork", "true")).returncode:
        return "this computer may not make namespaces"
    return None


def _has_overlays() -> bool:
    file_systems = Path("/proc/filesystems").read_text(encoding="ascii").split()
    return "overlay" in file_systems or (
        shutil.which("modprobe") is not None and not hosts.output_of(("modprobe", "overlay")).returncode
    )


_NUMBERS = itertools.count()
_POLL_S = 0.05
"""Interval in seconds at which a server checks whether to stop."""


class Lab:
    """Machines on one network, with this computer's end of it; made by `open_lab`."""

    def __init__(self, name: str, folder: Path, stack: ExitStack) -> None:
        self.name = name
        self.folder = folder
        self.machines: dict[str, hosts.Machine] = {}
        self._stack = stack
        self._addresses: list[str] = []
        hosts.add_namespace(name)
        hosts.program("ip", "-n", name, "link", "add", hosts.BRIDGE, "type", "bridge")
        hosts.program("ip", "-n", name, "link", "set", hosts.BRIDGE, "up")
        self.command(("sysctl", "-qw", "net.ipv4.ip_forward=1"))
        self._inside = hosts.NamespaceSockets(name)
        stack.callback(self._inside.close)

    @property
    def address(self) -> str:
        """Address of the lab's own end: the gateway of the first machine, where servers for machines listen."""
        if not self._addresses:
            raise hosts.MachineError("a yard has an address once it has a machine or was told one (`add_address`)")
        return self._addresses[0]

    def add_address(self, address: str) -> None:
        """Add an address with prefix length, such as 10.64.1.1/24, to the lab's end; several are allowed."""
        new = IPv4Interface(address)
        if str(new.ip) not in self._addresses:
            hosts.program("ip", "-n", self.name, "address", "add", str(new), "dev", hosts.BRIDGE)
            self._addresses.append(str(new.ip))

    def start(  # noqa: PLR0913 - what a machine is
        self,
        name: str,
        tree: Path,
        *,
        address: str,
        gateway: str,
        keys: Sequence[str] = (),
        disk_mb: int | None = None,
        interface: str = "eth0",
        spare: str | None = None,
        is_configured: bool = True,
        wait_s: float | None = 60.0,
    ) -> hosts.Machine:
        """Boot a machine from a tree, which is not modified; wait for its sshd unless `wait_s` is None.

        `address` has a prefix length; `gateway` becomes an address of the lab's end. `keys`: public keys of root.
        `disk_mb`: room for what the machine writes, in this computer's memory; default: half of it. `spare`: name of a
        second interface without an address. `is_configured`: see `Machine.power_on`.
        """
        if name in self.machines:
            raise hosts.MachineError(f"{name} stands in this yard already")
        spec = hosts.MachineSpec(name, tree, IPv4Interface(address), gateway, tuple(keys), disk_mb, interface, spare)
        self.add_address(f"{gateway}/{spec.address.network.prefixlen}")
        unique = f"{self.name}-m{len(self.machines)}"
        self._stack.enter_context(in_use(tree))
        result = hosts.Machine(
            spec, unique, self.name, self._inside, reaper.YARDS / self.name / unique, self.folder / f"{name}.log"
        )
        self.machines[name] = result
        self._stack.callback(result.stop)
        result.power_on(is_configured=is_configured, wait_s=wait_s)
        return result

    def listen(self, port: int = 0, address: str | None = None) -> socket.socket:
        """Return a listening socket at the lab's end, for a server in this process; 0: any free port."""
        result = self._inside.socket()
        result.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        result.bind((address or self.address, port))
        result.listen(64)
        return result

    def serve(self, folder: Path, port: int = 0) -> str:
        """Serve a folder by HTTP at the lab's end until the lab ends; return its URL, http://…:port."""
        handler = functools.partial(_Quiet, directory=str(folder))
        server = ThreadingHTTPServer((self.address, port), handler, bind_and_activate=False)
        server.socket.close()
        server.socket = self.listen(port)
        thread = threading.Thread(target=server.serve_forever, args=(_POLL_S,), name=f"http-{self.name}", daemon=True)
        thread.start()
        for end in (server.server_close, thread.join, server.shutdown):
            self._stack.callback(end)
        return f"http://{self.address}:{server.socket.getsockname()[1]}"

    def command(
        self,
        words: Sequence[str],
        *,
        input: str | None = None,  # noqa: A002 - as subprocess.run has it
        check: bool = True,
        timeout_s: float | None = None,
    ) -> subprocess.CompletedProcess[str]:
        """Run a local program with its normal rights in the lab's network; `check`: see `Machine.run`."""
        result = hosts.output_of((*self.prefix(), *words), text=input, timeout_s=timeout_s)
        if check and result.returncode:
            raise hosts.MachineError(f"{' '.join(words)}: ended with {result.returncode}: {result.stderr.strip()}")
        return result

    def prefix(self) -> tuple[str, ...]:
        """Return the command prefix that runs a program in the lab's network."""
        return ("ip", "netns", "exec", self.name)


class _Quiet(SimpleHTTPRequestHandler):
    """HTTP handler without log output."""

    def log_message(self, format: str, *args: object) -> None:  # noqa: A002 - as the class above has it
        """Ignore log messages."""


@contextmanager
def open_lab(folder: Path) -> Iterator[Lab]:
    """Open a lab for machines; consoles are logged to `folder`. Everything is removed at the end.

    Raises MachineError if no machine can run (`why_not`). Leftovers of killed processes are removed first.
    """
    if (reason := why_not()) is not None:
        raise hosts.MachineError(f"no machine can be run here: {reason}")
    folder.mkdir(parents=True, exist_ok=True)
    with reserve_name() as name, ExitStack() as stack:
        yield Lab(name, folder, stack)


def why_no_namespace(environ: Mapping[str, str] | None = None) -> str | None:
    """Return why no network namespace with a firewall can be made here, in a few words, or None."""
    missing = {"ip": "iproute2", "nft": "nftables", "bridge": "iproute2", "sysctl": "procps"}
    packages = sorted({package for name, package in missing.items() if shutil.which(name) is None})
    if why := _disabled_reason(environ):
        return why
    if packages:
        return f"missing: apt install {' '.join(packages)}"
    return "this computer may not make namespaces" if hosts.output_of(("unshare", "--net", "true")).returncode else None


@contextmanager
def reserve_name() -> Iterator[str]:
    """Reserve a lab name, with a keeper process that removes everything with that name after this process."""
    reaper.YARDS.mkdir(parents=True, exist_ok=True)
    reaper.sweep()
    name = f"{reaper.PREFIX}{os.getpid()}-{next(_NUMBERS)}"
    newborn = reaper.YARDS / f".{name}"  # nobody's to sweep until its owner holds the lock
    newborn.mkdir(exist_ok=True)
    with (newborn / "owner").open("wb") as owner:
        fcntl.flock(owner, fcntl.LOCK_EX)
        newborn.rename(reaper.YARDS / name)
        popen = subprocess.Popen(  # noqa: S603 - our own interpreter and program
            (sys.executable, "-I", str(Path(reaper.__file__)), name, str(os.getpid())),
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            cwd="/",
            start_new_session=True,
        )
        try:
            yield name
        finally:
            popen.communicate()
