"""One machine: a Debian with systemd that has the declared address, and a port here that leads to its sshd."""

from __future__ import annotations

import shlex
import uuid
from contextlib import suppress
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from typing import TYPE_CHECKING

from cryptography.hazmat.primitives import serialization
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

from atlantis_netcfg.emulator.lab._container import Container, entering, wait
from atlantis_netcfg.emulator.lab._errors import MachineFailed
from atlantis_netcfg.emulator.lab._namespaces import Inside, add_namespace, delete_namespace, join
from atlantis_netcfg.emulator.lab._overlay import Disk
from atlantis_netcfg.emulator.lab._programs import asked, program
from atlantis_netcfg.emulator.lab.relay import Relay, Traffic, Way

if TYPE_CHECKING:
    import subprocess
    from collections.abc import Sequence
    from ipaddress import IPv4Interface

__all__ = ["Machine", "MachineSpec"]

_SSH = 22
_PATIENCE_S = 60.0
_ENVIRONMENT = ("PATH=/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin", "HOME=/root", "LANG=C.UTF-8")


@dataclass(frozen=True)
class MachineSpec:
    """What a machine is; `address` with its prefix, `gateway` is the yard's own end."""

    name: str
    tree: Path
    address: IPv4Interface
    gateway: str
    keys: Sequence[str] = ()
    disk_mb: int | None = None
    interface: str = "eth0"
    spare: str | None = None
    """A second interface on the same cable, without an address."""


class Machine:
    """Made by `Yard.start`; ends with its yard."""

    def __init__(self, spec: MachineSpec, unique: str, lab: str, inside: Inside, folder: Path, log: Path) -> None:  # noqa: PLR0913, PLR0917 - where it stands
        self.spec = spec
        self._unique, self._yard, self._inside, self._log = unique, lab, inside, log
        self._ports: list[str] = []
        self._container: Container | None = None
        self._disk = Disk(folder, spec.tree, spec.disk_mb)
        self.host_key = _card(self._disk.root, spec)
        self._relay = Relay(inside.socket, (str(spec.address.ip), _SSH))

    @property
    def name(self) -> str:
        """Its host name."""
        return self.spec.name

    @property
    def address(self) -> str:
        """Its declared address, without the prefix; it is reached there from inside the yard only."""
        return str(self.spec.address.ip)

    @property
    def port(self) -> int:
        """The port of 127.0.0.1 that leads to its sshd."""
        return self._relay.port

    @property
    def traffic(self) -> Traffic:
        """What has passed through `port` since the start; connections from inside the yard do not."""
        return self._relay.traffic

    @property
    def runs(self) -> bool:
        """Whether it has power and has not ended by itself (`poweroff`, `reboot`)."""
        return self._container is not None and self._container.runs

    def link(
        self,
        *,
        delay_s: float = 0.0,
        rate_up_bps: float | None = None,
        rate_down_bps: float | None = None,
        up: bool = True,
    ) -> None:
        """Make the way through `port` such; what is left out is as good as can be. See `Way`."""
        self._relay.set(Way(delay_s, rate_up_bps, rate_down_bps, up))

    def power_on(self, *, configured: bool = True, wait_s: float | None = _PATIENCE_S) -> None:
        """Boot it and wait for its sshd.

        `configured`: its interface has the declared address and a default route, as if its own configuration had set
        them; False leaves that to the configuration on its disk. `wait_s`: None returns at once.
        """
        if self.runs:
            raise MachineFailed(f"{self.name} runs already")
        self._off()
        self._plug(configured=configured)
        self._container = Container(self._unique, self.name, self._disk.root, self._log)
        if wait_s is not None:
            self.wait_until_up(wait_s)

    def power_cut(self) -> None:
        """Take its power away: no process ends in an orderly way, and no peer is told. Its disk is kept."""
        self._off()

    def stop(self) -> None:
        """Take it down for good, with its port; its disk goes with the yard."""
        self._relay.close()
        self._off()

    def wait_until_up(self, timeout_s: float = _PATIENCE_S) -> None:
        """Wait until its sshd answers and lets in who may log in; MachineFailed with its last words otherwise."""
        wait(lambda: not self.runs or self._greets(), timeout_s, lambda: self._said("does not answer SSH"))
        if not self.runs:
            raise MachineFailed(self._said("ended while it booted"))

    def state(self, *, settled: bool = False) -> str:
        """What systemd says of itself: `running`, `degraded`, `starting`, …; `settled`: once the boot has ended."""
        wait_words = ("--wait",) if settled else ()
        return self.run(shlex.join(("systemctl", "is-system-running", *wait_words)), check=False).stdout.strip()

    def run(
        self,
        command: str,
        *,
        input: str | None = None,  # noqa: A002 - as subprocess.run has it
        check: bool = True,
        timeout_s: float | None = None,
    ) -> subprocess.CompletedProcess[str]:
        """Run a line of shell inside as root, without SSH; `check`: MachineFailed unless it ends with 0."""
        wait(lambda: not self.runs or self._leader(), _PATIENCE_S, lambda: self._said("does not boot"))
        leader = self._leader()
        if leader is None:
            raise MachineFailed(f"{self.name} is off")
        done = asked(
            (*entering(leader), "env", "-i", *_ENVIRONMENT, "/bin/sh", "-c", command), text=input, timeout_s=timeout_s
        )
        if check and done.returncode:
            raise MachineFailed(f"{self.name}: {command}: ended with {done.returncode}: {done.stderr.strip()}")
        return done

    def put(self, path: str, text: str, *, mode: str = "0644") -> None:
        """Write a file inside, and the folders above it; works also while it is off."""
        name = shlex.quote(path)
        folder = shlex.quote(str(Path(path).parent))
        command = f"mkdir -p {folder} && cat > {name} && chmod {mode} {name}"
        if self.runs:
            self.run(command, input=text)
            return
        done = asked(("chroot", str(self._disk.root), "/bin/sh", "-c", command), text=text)
        if done.returncode:
            raise MachineFailed(f"{self.name}: {path} cannot be written: {done.stderr.strip()}")

    def fill_disk(self, *, leave_kb: int = 0) -> None:
        """Make its disk full; what is running inside goes on and meets ENOSPC."""
        self._disk.fill(leave_kb)

    def free_disk(self) -> None:
        """Undo `fill_disk`."""
        self._disk.free()

    def _plug(self, *, configured: bool) -> None:
        """Give it a namespace with its interfaces, which have the same addresses of Ethernet each time."""
        add_namespace(self._unique)
        for interface in filter(None, (self.spec.interface, self.spec.spare)):
            port = f"{self._unique.rpartition('-')[2]}-{len(self._ports)}"
            mac = bytes([2, *sha256(f"{self._unique} {interface}".encode()).digest()[:5]]).hex(":")
            join(self._yard, port, self._unique, interface, mac)
            self._ports.append(port)
        near = self.spec.interface
        if configured:
            self._ip("address", "add", str(self.spec.address), "dev", near)
            self._ip("link", "set", near, "up")
        for port in self._ports:
            program("ip", "-n", self._yard, "link", "set", port, "up")
        if configured:
            self._ip("route", "add", "default", "via", self.spec.gateway)

    def _ip(self, *words: str) -> None:
        program("ip", "-n", self._unique, *words)

    def _off(self) -> None:
        """Cut its cables first, so that no peer hears of its end."""
        while self._ports:
            program("ip", "-n", self._yard, "link", "delete", self._ports.pop())
        if self._container is not None:
            self._container.kill()
            self._container = None
        delete_namespace(self._unique)

    def _leader(self) -> int | None:
        return None if self._container is None else self._container.leader()

    def _greets(self) -> bool:
        """Whether sshd says its name, and the boot has come so far that ordinary users may log in."""
        leader = self._leader()
        if leader is None or Path(f"/proc/{leader}/root/run/nologin").exists():
            return False
        with suppress(OSError), self._inside.socket() as caller:
            caller.settimeout(1.0)
            caller.connect((self.address, _SSH))
            return caller.recv(4) == b"SSH-"
        return False

    def _said(self, what: str) -> str:
        words = self._container.last_words() if self._container is not None else ""
        return f"machine {self.name} {what}; its console ({self._log}):\n{words}"


def _card(root: Path, spec: MachineSpec) -> str:
    """Write what a card of this one host holds beyond the tree; give its public host key."""
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
