"""The control centre's server in one namespace, partners' devices in another: the product's own files on both sides.

    devices 203.0.113.10 ---- 203.0.113.2 router's address, forwarded in the same namespace to 10.64.0.10: OpenVPN

A third one, `alone`, leads nowhere. The server runs what `openvpn_server` renders, in another folder; the firewall is
the one that it loads.
"""

import itertools
import os
import re
import shutil
import subprocess
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta
from ipaddress import IPv4Address
from pathlib import Path

import pytest
from waiting import wait_until

from atlantis_netcfg.inventory import Inventory, load
from atlantis_netcfg.vpn import pki, server
from atlantis_netcfg.vpn.enrolment_package.profile import server_name
from atlantis_netcfg.vpn.identity import (
    Certificate,
    CertificateStatus,
    Identity,
    KeyType,
    Member,
    MemberKind,
    MemberLink,
    MembershipList,
    Wrap,
)

NOW = datetime.now(UTC)
_NUMBERS = itertools.count()
_FORWARD = """\
table ip forwarded {
  chain there { type nat hook prerouting priority dstnat; ip daddr 203.0.113.2 udp dport 1194 dnat to 10.64.0.10; }
  chain in { type filter hook input priority 0; udp dport 1197 counter drop; }
}
"""
SILENT_PORT = 1197
CLOSED_PORT = 1198
REFUSED_PORT = 1196
"""At which nobody listens; what goes there, the devices' own computer refuses."""


@dataclass(frozen=True)
class Wanted:
    """A device to be issued."""

    name: str
    kind: MemberKind = MemberKind.LAPTOP
    link: MemberLink = MemberLink.FIBRE
    wrap: Wrap = Wrap.TLS_CRYPT_V2
    key: KeyType = KeyType.EC
    admitted: bool = True
    """Whether the server has a file for it."""
    revoked: bool = False
    """Whether its serial number is on the list."""


@dataclass
class Office:
    """An authority in memory: issues, and knows what the server has to hold."""

    declaration: Inventory
    ca: pki.Ca = field(default_factory=lambda: pki.new_ca("Example CA", NOW))
    identities: dict[str, Identity] = field(default_factory=dict)
    wanted: dict[str, Wanted] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.wrapping, self.shared = pki.server_key(), pki.shared_key()
        self._keys = {kind: pki.new_key(kind) for kind in KeyType}

    def issue(self, wanted: Wanted) -> Identity:
        key = self._keys[wanted.key]
        made = pki.new_client(self.ca, key.public_key(), wanted.name, pki.new_serial(), 397, NOW)
        certificate = Certificate(
            common_name=wanted.name,
            serial=made.serial_number,
            sha256=pki.sha256(made),
            not_before=made.not_valid_before_utc,
            not_after=made.not_valid_after_utc,
            wrap=wanted.wrap,
            key=wanted.key,
            standing=CertificateStatus.ISSUED,
        )
        two = wanted.wrap is Wrap.TLS_CRYPT_V2
        self.wanted[wanted.name] = wanted
        self.identities[wanted.name] = Identity(
            member=self._member(wanted, certificate),
            certificate=certificate,
            ca=pki.cert_pem(self.ca.certificate),
            cert=pki.cert_pem(made),
            key=pki.key_pem(key),
            wrap_key=pki.client_key(self.wrapping, f"cn={wanted.name}".encode()) if two else self.shared,
        )
        return self.identities[wanted.name]

    def _member(self, wanted: Wanted, certificate: Certificate) -> Member:
        partner, _, device = wanted.name.partition("-")
        pool = self.declaration.partners[partner].vpn_pool
        return Member(
            name=wanted.name,
            kind=wanted.kind,
            partner=partner,
            device=device,
            address=IPv4Address(int(pool.network_address) + 1 + len(self.identities)),
            link=wanted.link,
            vehicle=None,
            certificates=(certificate,),
        )

    def membership(self) -> MembershipList:
        admitted = {name: one.member for name, one in self.identities.items() if self.wanted[name].admitted}
        return MembershipList(admitted, 1, "", NOW + timedelta(days=90), ())

    def crl(self) -> bytes:
        serials = [one.certificate.serial for name, one in self.identities.items() if self.wanted[name].revoked]
        return pki.new_crl(self.ca, [pki.RevokedSerial(serial, NOW) for serial in serials], 1, NOW)

    def furnish(self, folder: Path) -> Path:
        """Lay what the server's computer would hold into a folder; give its configuration."""
        shutil.rmtree(folder, ignore_errors=True)
        (folder / "ccd").mkdir(parents=True)
        host = self.declaration.hosts[self.declaration.pilot.vpn.server]
        key = self._keys[KeyType.EC]
        addresses = (self.declaration.pilot.vpn.endpoint, IPv4Address("10.64.0.10"))
        made = pki.new_server(
            self.ca, key.public_key(), server_name(self.declaration), (), addresses, pki.new_serial(), NOW
        )
        files = {
            "ca.crt": pki.cert_pem(self.ca.certificate),
            "server.crt": pki.cert_pem(made),
            "server.key": pki.key_pem(key).reveal(),
            "tls-crypt-v2.key": self.wrapping.reveal(),
            "tls-crypt.key": self.shared.reveal(),
            "server.conf": server.server_conf(self.declaration, host)
            .replace(server.FOLDER, str(folder))
            .replace("/run/atlantis-vpn", str(folder)),
        }
        for file in server.live_files(self.declaration, self.membership(), self.crl()):
            files[file.path.removeprefix(f"{server.FOLDER}/").replace(server.FIREWALL, "vpn.nft")] = file.content
        for name, text in files.items():
            (folder / name).write_text(text)
            (folder / name).chmod(0o600)
        return folder / "server.conf"


class Stand:
    """Two namespaces and what runs in them."""

    def __init__(self, stack: ExitStack) -> None:
        self.stack = stack
        self.running: list[subprocess.Popen[bytes]] = []
        self.prefix = f"vpc{os.getpid()}-{next(_NUMBERS)}"
        for who in ("server", "devices", "alone"):
            subprocess.run(["ip", "netns", "add", self.name(who)], check=True)
            stack.callback(subprocess.run, ["ip", "netns", "delete", self.name(who)], check=True)
            self.run(who, "ip", "link", "set", "lo", "up")
        stack.callback(self.end)
        ends = ["netns", self.name("devices"), "type", "veth", "peer", "name", "eth0", "netns", self.name("server")]
        subprocess.run(["ip", "link", "add", "eth0", *ends], check=True)
        self.run("server", "ip", "address", "add", "10.64.0.10/32", "dev", "lo")
        for who, address in (("server", "203.0.113.2"), ("devices", "203.0.113.10")):
            self.run(who, "ip", "address", "add", f"{address}/24", "dev", "eth0")
            self.run(who, "ip", "link", "set", "eth0", "up")
        subprocess.run(self.inside("server", "nft", "-f", "-"), input=_FORWARD, text=True, check=True)

    def name(self, who: str) -> str:
        return f"{self.prefix}-{who}"

    def inside(self, who: str, *command: str) -> list[str]:
        return ["ip", "netns", "exec", self.name(who), *command]

    def run(self, who: str, *command: str) -> str:
        done = subprocess.run(self.inside(who, *command), capture_output=True, text=True, check=False)
        assert done.returncode == 0, f"{command}: {done.stdout}{done.stderr}"
        return done.stdout

    def start(
        self, who: str, command: Sequence[str], log: Path, environment: Mapping[str, str] | None = None
    ) -> subprocess.Popen[bytes]:
        """Start a program whose words go to a file; it is ended with the stand."""
        with log.open("wb") as out:
            process = subprocess.Popen(
                self.inside(who, *command),
                stdin=subprocess.DEVNULL,
                stdout=out,
                stderr=subprocess.STDOUT,
                env={**os.environ, **(environment or {})},
            )
        self.running.append(process)
        return process

    def end(self) -> None:
        """End all together, without farewells that the server would wait for."""
        for process in self.running:
            process.kill()
        for process in self.running:
            process.wait()

    def serve(self, conf: Path) -> None:
        log = conf.with_name("log")
        self.run("server", "nft", "-f", str(conf.with_name("vpn.nft")))
        self.start("server", ["openvpn", "--config", str(conf)], log)
        await_words(log, "Initialization Sequence Completed")


def await_words(log: Path, words: str) -> None:
    wait_until(lambda: words in log.read_text(errors="replace"), lambda: log.read_text(errors="replace")[-2000:])


def device_of(log: Path) -> str:
    """The interface that openvpn has made."""
    found = re.search(r"TUN/TAP device (\S+) opened", log.read_text())
    assert found is not None
    return found[1]


def declared() -> Inventory:
    return load(Path(__file__).parents[4] / "inventory")


def made_stand(stack: ExitStack) -> Stand:
    if os.geteuid() != 0:
        pytest.skip("making a network namespace needs root")
    return Stand(stack)
