"""A laptop in a network namespace, and a router at the other end of its cable in another; nothing leads further.

    with laptop(tmp_path) as at:
        at.cable("eth0")
        printed = at.doctor(code=6)

The tests are marked `namespace`. What a doctor advises is typed there as it was printed, without `sudo`.
"""

import json
import os
import shlex
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta
from hashlib import sha256
from pathlib import Path
from typing import Any

import preforked
import pytest
from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import NameOID
from quay import _inventory
from waiting import HANG_S

SITE, ROUTER = "coastal", "coastal-router"
ADDRESS, MINE = "10.64.101.1", "10.64.101.10/24"
SERVER = str(Path(__file__).with_name("silent_router.py"))


@dataclass
class LaptopStand:
    """The laptop, the far end, and what is typed on the laptop."""

    name: str
    far: str
    folder: Path
    inventory: Path
    servers: list[subprocess.Popen[str]] = field(default_factory=list)

    def ip(self, *words: str, far: bool = False) -> None:
        """Change the network of the laptop, or of the far end."""
        subprocess.run(["ip", "-n", self.far if far else self.name, *words], check=True, capture_output=True)

    def cable(self, port: str, *, up: bool = True, address: str | None = None) -> None:
        """A port whose cable leads to the far end, where the router's address is at the first of them."""
        self.ip("link", "add", port, "type", "veth", "peer", "name", port, "netns", self.far)
        self.ip("link", "set", port, "up", far=True)
        if up:
            self.ip("link", "set", port, "up")
        if address is not None:
            self.ip("address", "add", address, "dev", port)

    def unplug(self, port: str) -> None:
        """Take the carrier away."""
        self.ip("link", "set", port, "down", far=True)

    def serve(self, port: str) -> str:
        """The router at the end of that cable answers with a certificate; its SHA-256."""
        self.ip("address", "add", f"{ADDRESS}/24", "dev", port, far=True)
        pem, digest = certificate()
        file = self.folder / "router.pem"
        file.write_bytes(pem)
        words = ["ip", "netns", "exec", self.far, sys.executable, "-I", "-S", SERVER, str(file), ADDRESS, "8729"]
        self.servers.append(subprocess.Popen(words, stdout=subprocess.PIPE, text=True))
        stdout = self.servers[-1].stdout
        assert stdout is not None
        assert stdout.readline() == "listens\n"
        return digest

    def heard(self) -> list[str]:
        """What the router was told over its connections, one text each; it ends with that."""
        (server,) = self.servers
        self.servers.clear()
        server.terminate()
        out, _ = server.communicate(timeout=HANG_S)
        return out.splitlines()

    def type(self, *words: str) -> subprocess.CompletedProcess[str]:
        """Type something on the laptop."""
        environment = {
            "PATH": os.environ["PATH"],
            "HOME": str(self.folder / "home"),
            "LANG": "C.UTF-8",
            "ATLANTIS_STATE": str(self.folder / "state"),
            "ATLANTIS_NO_MACHINES": "tests",
            "ANSIBLE_VAULT_PASSWORD_FILE": str(self.folder / "vault-password"),
        }
        return subprocess.run(
            ["ip", "netns", "exec", self.name, *words],
            env=environment,
            pass_fds=[_server()],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            check=False,
        )

    def provision(self, *words: str, program: bool = False) -> subprocess.CompletedProcess[str]:
        """Type `provision WORDS`, into the prepared process or, with `program`, as the program itself."""
        itself = (sys.executable, "-P", "-m", "atlantis_netcfg")
        first = itself if program else preforked.client(_server())
        return self.type(*first, *words, f"inventory={self.inventory}")

    def look(self, *words: str) -> dict[str, dict[str, Any]]:
        """The items about the way to the site, by their names."""
        done = self.provision("inventory", "doctor", f"site={SITE}", "--json", *words)
        document = json.loads(done.stdout)
        return {item["name"]: item for item in document["items"] if item["section"] == "way"}

    def obey(self, item: dict[str, Any]) -> None:
        """Type what is advised about an item."""
        assert item["commands"] != []
        for command in item["commands"]:
            words = shlex.split(command)
            assert words[0] == "sudo"
            done = self.type(*words[1:])
            assert done.returncode == 0, f"{command}\n{done.stdout}"


def _server() -> int:
    return preforked.server(sys.executable).fileno()


def certificate() -> tuple[bytes, str]:
    """A key and a certificate of its own, as RouterOS makes them; PEM, and its SHA-256."""
    key = ec.generate_private_key(ec.SECP256R1())
    name = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, "atlantis-api")])
    now = datetime.now(UTC)
    made = (
        x509.CertificateBuilder()
        .subject_name(name)
        .issuer_name(name)
        .public_key(key.public_key())
        .serial_number(x509.random_serial_number())
        .not_valid_before(now - timedelta(days=1))
        .not_valid_after(now + timedelta(days=3650))
        .sign(key, hashes.SHA256())
    )
    private = key.private_bytes(
        serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, serialization.NoEncryption()
    )
    digest = sha256(made.public_bytes(serialization.Encoding.DER)).hexdigest()
    return private + made.public_bytes(serialization.Encoding.PEM), digest


@contextmanager
def laptop(folder: Path) -> Iterator[LaptopStand]:
    """Both namespaces, with the shipped inventory in which nothing is an example any more."""
    if os.geteuid() != 0:
        pytest.skip("making a network namespace needs root")
    (folder / "home").mkdir()
    stand = LaptopStand(f"dl-{os.getpid()}", f"df-{os.getpid()}", folder, _inventory(folder))
    try:
        for name in (stand.name, stand.far):
            subprocess.run(["ip", "netns", "add", name], check=True)
            subprocess.run(["ip", "-n", name, "link", "set", "lo", "up"], check=True)
        yield stand
    finally:
        for server in stand.servers:
            server.kill()
            server.communicate()
        for name in (stand.name, stand.far):
            subprocess.run(["ip", "netns", "del", name], check=False)
