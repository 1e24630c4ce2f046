"""Wrapping keys and certificates as the OpenVPN of Debian takes them: a handshake on loopback, without a tunnel."""

import base64
import hmac
import re
import shutil
import socket
import subprocess
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path

import pytest
from cryptography.hazmat.primitives.ciphers import Cipher
from cryptography.hazmat.primitives.ciphers.algorithms import AES
from cryptography.hazmat.primitives.ciphers.modes import CTR
from pki_made import NAME, crl, entity

from atlantis_netcfg.core.secret import Secret
from atlantis_netcfg.vpn import pki
from atlantis_netcfg.vpn.identity import KeyType

OPENVPN = shutil.which("openvpn") or "/usr/sbin/openvpn"
UP = "Initialization Sequence Completed"
V2 = ("--tls-crypt-v2", "server.v2"), ("--tls-crypt-v2", "client.v2")
SHARED = ("--tls-crypt", "shared"), ("--tls-crypt", "shared")


def inside(pem: Secret) -> bytes:
    return base64.b64decode("".join(pem.reveal().splitlines()[1:-1]))


def test_wrapped_key_matches_the_specification() -> None:
    server = pki.server_key()
    data = inside(pki.client_key(server, b"cn=iqua-sparus2"))
    key, tag, sealed, length = data[:256], data[256:288], data[288:-2], data[-2:]
    assert int.from_bytes(length, "big") == len(data) - 256
    decryptor = Cipher(AES(inside(server)[:32]), CTR(tag[:16])).decryptor()
    plain = decryptor.update(sealed) + decryptor.finalize()
    assert plain == key + b"\x00cn=iqua-sparus2"
    assert hmac.digest(inside(server)[64:96], length + plain, "sha256") == tag


def test_metadata_has_a_limit() -> None:
    server = pki.server_key()
    assert len(inside(pki.client_key(server, bytes(pki.METADATA_MAX)))) == 256 + 1024
    with pytest.raises(ValueError, match="733"):
        pki.client_key(server, bytes(pki.METADATA_MAX + 1))


@pytest.mark.parametrize("change", [("server key", "client key"), ("=", ""), ("\n", "\n!")])
def test_invalid_server_key_is_refused(change: tuple[str, str]) -> None:
    with pytest.raises(pki.CorruptKeyError, match="not a tls-crypt-v2 server key"):
        pki.client_key(Secret(pki.server_key().reveal().replace(*change)), b"")


def test_generated_keys_are_unique() -> None:
    server = pki.server_key()
    assert len({pki.client_key(server, b"").reveal() for _ in range(20)}) == 20
    assert len({pki.shared_key().reveal() for _ in range(20)}) == 20
    assert re.fullmatch(
        r"(#.*\n){3}-----BEGIN .*-----\n([0-9a-f]{32}\n){16}-----END .*-----\n", pki.shared_key().reveal()
    )


class Stand:
    """A folder of an authority, and the OpenVPN processes that were started in it."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.started: list[subprocess.Popen[str]] = []
        self.ca = pki.new_ca(NAME, datetime.now(UTC))
        (folder / "ca.crt").write_text(pki.cert_pem(self.ca.certificate))
        entity(folder, self.ca, "scc", serves=True)
        server = pki.server_key()
        self.write("server.v2", server)
        self.write("client.v2", pki.client_key(server, b"cn=member"))
        self.write("shared", pki.shared_key())
        self.publish()

    def write(self, name: str, key: Secret) -> None:
        (self.folder / name).write_text(key.reveal())

    def publish(self, *serials: int) -> None:
        now = datetime.now(UTC)
        pki.publish(
            self.folder / "crl.pem", crl(self.ca, 1, now, serials=serials), self.ca.certificate, above=None, now=now
        )

    def start(self, name: str, *options: str) -> subprocess.Popen[str]:
        fixed = ("--dev", "null", "--ca", "ca.crt", "--cert", f"{name}.crt", "--key", f"{name}.key", "--tls-exit")
        rest = ("--tls-version-min", "1.2", "--verb", "3", "--cd", str(self.folder))
        command = [OPENVPN, *rest, *fixed, *options]
        made = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
        self.started.append(made)
        return made

    def shake(self, name: str, wraps: tuple[tuple[str, str], tuple[str, str]] = V2) -> str:
        """What the server says of that client, until it is up or has refused."""
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            probe.bind(("127.0.0.1", 0))
            port = str(probe.getsockname()[1])
        ours, theirs = wraps
        listen = ("--local", "127.0.0.1", "--lport", port, "--dh", "none", "--remote-cert-tls", "client")
        server = self.start("scc", "--tls-server", *listen, "--crl-verify", "crl.pem", *ours)
        said = until(server, r"UDPv4 link remote")
        reach = ("--remote", "127.0.0.1", port, "--nobind", "--remote-cert-tls", "server")
        self.start(name, "--tls-client", *reach, "--verify-x509-name", "scc", "name", *theirs)
        return said + until(server, rf"{UP}|VERIFY.* ERROR|TLS Error")

    def end(self) -> None:
        for process in self.started:
            process.kill()
            process.communicate()


def until(process: subprocess.Popen[str], pattern: str) -> str:
    assert process.stdout is not None
    said = ""
    for line in process.stdout:
        said += line
        if re.search(pattern, line):
            return said
    raise AssertionError(said)


@pytest.fixture
def stand(tmp_path: Path) -> Iterator[Stand]:
    made = Stand(tmp_path)
    yield made
    made.end()


@pytest.mark.parametrize(("kind", "wraps"), [(KeyType.EC, V2), (KeyType.RSA, SHARED)])
def test_openvpn_admits_a_member(stand: Stand, kind: KeyType, wraps: tuple[tuple[str, str], tuple[str, str]]) -> None:
    entity(stand.folder, stand.ca, "member", kind)
    assert UP in stand.shake("member", wraps)


def test_openvpn_refuses_a_revoked_member(stand: Stand) -> None:
    stand.publish(entity(stand.folder, stand.ca, "member").serial_number)
    assert "certificate revoked" in stand.shake("member")


def test_openvpn_refuses_a_member_of_a_namesake_ca(stand: Stand) -> None:
    entity(stand.folder, pki.new_ca(NAME, datetime.now(UTC)), "member")
    assert "VERIFY ERROR" in stand.shake("member")


def test_openvpn_refuses_a_server_certificate_as_a_client(stand: Stand) -> None:
    entity(stand.folder, stand.ca, "member", serves=True)
    assert "unsuitable certificate purpose" in stand.shake("member")


def test_openvpn_refuses_a_wrapping_key_for_another_server(stand: Stand) -> None:
    entity(stand.folder, stand.ca, "member")
    stand.write("client.v2", pki.client_key(pki.server_key(), b"cn=member"))
    assert "client key authentication error" in stand.shake("member")
