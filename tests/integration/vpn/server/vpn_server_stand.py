"""The server of the VPN on a machine of systemd: an authority, the role as Ansible runs it, real clients around it."""

import hashlib
import json
import os
import re
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import preforked
import pytest
from cryptography.hazmat.primitives import serialization
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
from debian_trees import GATEWAY
from waiting import wait_until

from atlantis_netcfg.core.secret import Secret
from atlantis_netcfg.emulator.lab import Lab, Machine, build_rootfs, open_lab, why_not
from atlantis_netcfg.emulator.lab.hosts import BRIDGE, add_namespace, connect_veth, delete_namespace
from atlantis_netcfg.inventory import Inventory, load
from atlantis_netcfg.runs import write_atomically
from atlantis_netcfg.vpn import pki
from atlantis_netcfg.vpn.authority.authority import Authority, unseal_ca
from atlantis_netcfg.vpn.authority.model import EnrolmentFile, EnrolmentRequest
from atlantis_netcfg.vpn.enrolment_package.profile import profile
from atlantis_netcfg.vpn.identity import Identity, MemberKind, MemberLink
from atlantis_netcfg.vpn.members import server_names

ROOT = Path(__file__).resolve().parents[4]
NAME = "scc-vpn"
ADDRESS, ROUTER = "10.64.0.10", "10.64.0.1"
FOLDER = "/etc/openvpn/atlantis"
TUNNEL = "openvpn-server@atlantis.service"
_PASSPHRASE = Secret("six words that a die has chosen")
_CONNECTED = "Initialization Sequence Completed"
_CONSOLE = {"name": "Role", "ansible.builtin.import_role": {"name": "openvpn_server", "rolespec_validate": False}}


def below(pid: int) -> list[int]:
    """The processes that a process has started, and those that they have."""
    started = Path(f"/proc/{pid}/task/{pid}/children").read_text().split()
    return [process for child in map(int, started) for process in (child, *below(child))]


@dataclass
class Client:
    """A computer in the LAN of the server with one profile."""

    namespace: str
    folder: Path
    profile: str
    _process: subprocess.Popen[bytes] | None = None

    @property
    def log(self) -> str:
        path = self.folder / "log"
        return path.read_text(errors="replace") if path.exists() else ""

    def inside(self, *words: str) -> tuple[str, ...]:
        return ("ip", "netns", "exec", self.namespace, *words)

    def start(self) -> None:
        config = self.folder / "client.ovpn"
        config.touch(mode=0o600)
        text = re.sub(r"(?m)^remote .*$", f"remote {ADDRESS} 1194", self.profile)
        config.write_text(re.sub(r"(?m)^dev .*$", "dev tun0", text))
        (self.folder / "log").unlink(missing_ok=True)
        words = ("openvpn", "--config", str(config), "--log", str(self.folder / "log"), "--connect-retry", "1", "1")
        self._process = subprocess.Popen(
            self.inside(*words), stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        )

    def connect(self) -> "Client":
        self.start()
        self.connected()
        return self

    def connected(self, times: int = 1) -> None:
        wait_until(
            lambda: self.log.count(_CONNECTED) >= times,
            lambda: f"{self.namespace} does not connect:\n{self.log[-3000:]}",
        )

    def pings(self, address: str = "10.80.0.1") -> bool:
        done = subprocess.run(
            self.inside("ping", "-q", "-c", "2", "-i", "0.2", "-W", "1", address), capture_output=True, check=False
        )
        return done.returncode == 0

    def end(self) -> None:
        if self._process is not None:
            self._process.terminate()
            self._process.wait()
            self._process = None


@dataclass
class Stand:
    """A server that runs, and the laptop of the operator."""

    ground: Lab
    machine: Machine
    key: Path
    public: str
    folder: Path
    inventory: Path
    ca: pki.Ca
    stack: ExitStack
    profiles: dict[str, str] = field(default_factory=dict)
    secrets: set[str] = field(default_factory=set)
    """Lines that may stand nowhere but in the files of their owners."""
    clients: int = 0

    @property
    def declaration(self) -> Inventory:
        return load(self.inventory, decrypt=lambda _sealed: "a-real-word-long-enough")

    @property
    def vpn(self) -> Path:
        """The authority's folder."""
        return self.folder / "state" / "vpn"

    @property
    def authority(self) -> Authority:
        return Authority.open(self.vpn)

    @property
    def said(self) -> str:
        """What Ansible has printed."""
        return (self.folder / "said").read_text()

    def issue(self, *wishes: EnrolmentRequest) -> None:
        def deliver(identity: Identity) -> EnrolmentFile:
            return self._keep(identity)

        with self.authority._open_for_signing(self.ca, "tester") as signer:
            signer.issue(wishes, deliver)

    def _keep(self, identity: Identity) -> EnrolmentFile:
        text = profile(self.declaration, identity).reveal()
        self.profiles[identity.certificate.common_name] = text
        self.secrets |= _lines(identity.key.reveal()) | _lines(identity.wrap_key.reveal())
        path = self.folder / f"{identity.certificate.common_name}.ovpn"
        write_atomically(path, text.encode())
        return EnrolmentFile(str(path), hashlib.sha256(text.encode()).hexdigest())

    def laptop(self, device: str, partner: str = "inesc", link: MemberLink = MemberLink.FIBRE) -> str:
        """A device of a partner; gives its name."""
        pool = self.declaration.partners[partner].vpn_pool
        wish = EnrolmentRequest(f"{partner}-{device}", MemberKind.LAPTOP, partner, device, pool=pool, link=link)
        self.issue(wish)
        return wish.name

    def revoke(self, name: str) -> None:
        with self.authority._open_for_signing(self.ca, "tester") as signer:
            signer.revoke([name], "lost")

    def client(self, name: str, profile: str | None = None) -> Client:
        """A computer with the profile of a member; it ends with the stand."""
        self.clients += 1
        namespace = f"{self.ground.name}-c{self.clients}"
        add_namespace(namespace)
        self.stack.callback(delete_namespace, namespace)
        port = f"{self.ground.name.rpartition('-')[2]}c{self.clients}"
        connect_veth(self.ground.name, BRIDGE, port, namespace, "eth0", bytes([2, 0, 0, 0, 7, self.clients]).hex(":"))
        for words in (
            ("-n", namespace, "address", "add", f"10.64.0.{200 + self.clients}/24", "dev", "eth0"),
            ("-n", namespace, "link", "set", "eth0", "up"),
            ("-n", self.ground.name, "link", "set", port, "up"),
        ):
            subprocess.run(["ip", *words], check=True)
        folder = self.folder / f"client-{self.clients}"
        folder.mkdir()
        made = Client(namespace, folder, profile or self.profiles[name])
        self.stack.callback(made.end)
        return made

    def journal(self) -> str:
        """What the server has said."""
        return self.machine.run(f"journalctl -u {TUNNEL} -o cat --no-pager").stdout

    def pid(self) -> str:
        """Of the server: another one after each restart."""
        return self.machine.run(f"systemctl show -p MainPID --value {TUNNEL}").stdout.strip()

    def read(self, path: str) -> str:
        return self.machine.run(f"cat {path}").stdout

    def run(self, *words: str) -> dict[str, Any]:
        """Run the role; `words` are for ansible-playbook."""
        read, write = os.pipe()
        with os.fdopen(read) as lines:
            with os.fdopen(write, "w"):
                process = preforked.play(self._command(write, words), self.folder, pass_fds=[write])
            told = [json.loads(line) for line in lines]
            process.wait()
        results = [line["devices"][NAME] for line in told if line.get("devices")]
        assert len(results) == 1, f"{self.said[-3000:]}\n{told}"
        result: dict[str, Any] = results[0]
        return result

    @contextmanager
    def starting(self) -> Iterator[subprocess.Popen[bytes]]:
        """Run the role by the program itself, which may be killed."""
        with (self.folder / "events").open("wb") as events, (self.folder / "said").open("wb") as said:
            words = [preforked.PLAYBOOK, *self._command(events.fileno(), ())]
            env = os.environ | preforked.settings(self.folder)
            with subprocess.Popen(
                words,
                cwd=self.folder,
                env=env,
                pass_fds=[events.fileno()],
                stdin=subprocess.DEVNULL,
                stdout=said,
                stderr=subprocess.STDOUT,
            ) as process:
                yield process

    def _command(self, events: int, words: Sequence[str]) -> list[str]:
        known = self.folder / "known"
        known.write_text(f"{NAME} {self.machine.host_key}\n")
        variables = {
            "ansible_host": "127.0.0.1",
            "ansible_port": self.machine.port,
            "ansible_user": "root",
            "ansible_ssh_private_key_file": str(self.key),
            "ansible_ssh_common_args": f"-o HostKeyAlias={NAME} -o UserKnownHostsFile={known}",
            "atlantis_request": {"state": str(self.folder / "state"), "rehearsed": True, "events_fd": events},
        }
        play = [{"hosts": "vpn_servers", "gather_facts": False, "tasks": [_CONSOLE]}]
        (self.folder / "play.yml").write_text(json.dumps(play))
        (self.folder / "variables.json").write_text(json.dumps(variables))
        return ["-i", str(self.inventory), "play.yml", "-e", "@variables.json", "--limit", NAME, *words]

    def provision(self, *words: str) -> dict[str, Any]:
        """Type it where the operator's laptop stands: in the LAN of the server."""
        typed = [*words, f"inventory={self.inventory}", "--json"]
        known = self.folder / "known-typed"
        known.write_text(f"{NAME} {self.machine.host_key}\n")
        more = {
            "ATLANTIS_STATE": str(self.folder / "state"),
            "ANSIBLE_HOME": str(self.folder / "ansible"),
            "ANSIBLE_SSH_CONTROL_PATH_DIR": str(self.folder / "kept"),
            "ANSIBLE_VAULT_PASSWORD_FILE": str(self.folder / "vault-password"),
            "ANSIBLE_SSH_EXTRA_ARGS": f"-F none -i {self.key} -o IdentitiesOnly=yes -o UserKnownHostsFile={known}",
        }
        server = preforked.server(sys.executable).fileno()
        done = subprocess.run(
            [*self.ground.prefix(), *preforked.client(server), *typed],
            cwd=ROOT,
            pass_fds=[server],
            env=os.environ | more,
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.stdout.startswith("{"), f"{done.stdout[:2000]}\n{done.stderr[-2000:]}"
        told: dict[str, Any] = json.loads(done.stdout)
        return told


def _lines(pem: str) -> set[str]:
    """The lines of a key that are like no other text."""
    return {line for line in pem.splitlines() if len(line) >= 32 and not line.startswith("-----")}


def _key(folder: Path) -> tuple[Path, str]:
    made = Ed25519PrivateKey.generate()
    private = made.private_bytes(
        serialization.Encoding.PEM, serialization.PrivateFormat.OpenSSH, serialization.NoEncryption()
    )
    public = made.public_key().public_bytes(serialization.Encoding.OpenSSH, serialization.PublicFormat.OpenSSH)
    file = folder / "id_ed25519"
    file.touch(mode=0o600)
    file.write_bytes(private)
    return file, public.decode()


@pytest.fixture(scope="module")
def stand(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Stand]:
    """One machine for the tests of a file: each leaves it as the record says."""
    if (reason := why_not()) is not None:
        pytest.skip(reason)
    from bench.declared import Declared  # noqa: PLC0415 - after the skip

    folder = tmp_path_factory.mktemp("vpn")
    real = Declared.make(folder)
    key, public = _key(folder)
    with ExitStack() as stack:
        ground = stack.enter_context(open_lab(folder / "yard"))
        machine = ground.start(NAME, build_rootfs(GATEWAY), address=f"{ADDRESS}/24", gateway=ROUTER, keys=(public,))
        vpn = folder / "state" / "vpn"
        vpn.parent.mkdir(mode=0o700)
        Authority.init(vpn, _PASSPHRASE, server_names(real.declaration), "founder", "vault")
        ca = unseal_ca(vpn, _PASSPHRASE)
        made = Stand(ground, machine, key, public, folder, real.inventory, ca, stack)
        for path in (vpn / "server").iterdir():
            if path.suffix == ".key":
                made.secrets |= _lines(path.read_text())
        yield made
