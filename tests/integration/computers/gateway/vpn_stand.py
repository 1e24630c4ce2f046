"""A real OpenVPN server at the yard's end, and identities that it knows, for the tests of the role `openvpn_client`."""

import subprocess
from dataclasses import dataclass, field
from datetime import UTC, datetime
from ipaddress import IPv4Address
from pathlib import Path

from atlantis_netcfg.core.secret import Secret
from atlantis_netcfg.emulator.lab import Lab
from atlantis_netcfg.vpn import pki
from atlantis_netcfg.vpn.enrolment_package.profile import identity_file
from atlantis_netcfg.vpn.identity import (
    Certificate,
    CertificateStatus,
    Identity,
    KeyType,
    Member,
    MemberKind,
    MemberLink,
    Wrap,
)

ENDPOINT = "203.0.113.2"
SERVER = "scc-vpn"
HOST, ADDRESS = "coastal-gateway", "10.80.0.21"

_CONF = """\
mode server
tls-server
proto udp4
local {endpoint}
port 1194
dev tun-scc
dev-type tun
topology subnet
ifconfig 10.80.0.1 255.255.0.0
push "topology subnet"
client-config-dir {folder}/ccd
ccd-exclusive
ca {folder}/ca.crt
cert {folder}/server.crt
key {folder}/server.key
dh none
tls-crypt {folder}/tls-crypt.key
tls-crypt-v2 {folder}/tls-crypt-v2.key
remote-cert-tls client
keepalive 2 8
explicit-exit-notify 1
management {folder}/management.sock unix
verb 3
log {folder}/server.log
"""


@dataclass
class Vpn:
    """The server's folder; `admit` and `refuse` write what it reads at the next handshake."""

    ground: Lab
    folder: Path
    ca: pki.Ca = field(default_factory=lambda: pki.new_ca("test", datetime.now(UTC)))
    running: subprocess.Popen[bytes] | None = None
    _keys: dict[Wrap, Secret] = field(default_factory=dict)

    def start(self) -> None:
        """Make the server's own files and run it in the yard's network."""
        (self.folder / "ccd").mkdir(parents=True)
        key, now = pki.new_key(KeyType.EC), datetime.now(UTC)
        made = pki.new_server(self.ca, key.public_key(), SERVER, [], [IPv4Address(ENDPOINT)], pki.new_serial(), now)
        self._keys = {Wrap.TLS_CRYPT: pki.shared_key(), Wrap.TLS_CRYPT_V2: pki.server_key()}
        texts = {
            "ca.crt": pki.cert_pem(self.ca.certificate),
            "server.crt": pki.cert_pem(made),
            "server.key": pki.key_pem(key).reveal(),
            "tls-crypt.key": self._keys[Wrap.TLS_CRYPT].reveal(),
            "tls-crypt-v2.key": self._keys[Wrap.TLS_CRYPT_V2].reveal(),
            "server.conf": _CONF.format(endpoint=ENDPOINT, folder=self.folder),
        }
        for name, text in texts.items():
            (self.folder / name).write_text(text)
            (self.folder / name).chmod(0o600)
        self.ground.add_address(f"{ENDPOINT}/32")
        self.running = subprocess.Popen(
            [*self.ground.prefix(), "openvpn", "--config", str(self.folder / "server.conf")]
        )

    def stop(self) -> None:
        if self.running is not None:
            self.running.terminate()
            self.running.wait()

    def admit(self, name: str = HOST, address: str = ADDRESS) -> None:
        (self.folder / "ccd" / name).write_text(f"ifconfig-push {address} 255.255.0.0\n")

    def refuse(self, name: str = HOST) -> None:
        (self.folder / "ccd" / name).unlink()

    def identity(self, days: int = 397, wrap: Wrap = Wrap.TLS_CRYPT_V2) -> str:
        """A gateway's identity, as the authority would write it."""
        key, now = pki.new_key(KeyType.EC), datetime.now(UTC)
        made = pki.new_client(self.ca, key.public_key(), HOST, pki.new_serial(), days, now)
        certificate = Certificate(
            common_name=HOST,
            serial=made.serial_number,
            sha256=pki.sha256(made),
            not_before=made.not_valid_before_utc,
            not_after=made.not_valid_after_utc,
            wrap=wrap,
            key=KeyType.EC,
            standing=CertificateStatus.ISSUED,
        )
        member = Member(HOST, MemberKind.HOST, None, HOST, IPv4Address(ADDRESS), MemberLink.FIBRE, None, (certificate,))
        shared = self._keys[wrap]
        wrapped = shared if wrap is Wrap.TLS_CRYPT else pki.client_key(shared, b"cn=" + HOST.encode())
        ca = pki.cert_pem(self.ca.certificate)
        return identity_file(Identity(member, certificate, ca, pki.cert_pem(made), pki.key_pem(key), wrapped)).reveal()
