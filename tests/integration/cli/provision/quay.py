"""A quay for tests: a network namespace in which the coastal router's declared address leads to a twin.

The twin outlives the commands, so that real runs (without `--rehearse`) have something to change.
"""

import ctypes
import json
import os
import re
import shutil
import socket
import socketserver
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import preforked
import pytest
from ansible.parsing.vault import VaultLib, VaultSecret

from atlantis_netcfg.emulator.routeros import SiteSpec, SpawnedSite, User
from atlantis_netcfg.inventory import load
from atlantis_netcfg.operations.apply import perform
from atlantis_netcfg.operations.common.rehearsal import site_spec
from atlantis_netcfg.runs import Store

CHECKOUT = Path(__file__).resolve().parents[4]
ROUTER = "coastal-router"
ADDRESS = ("10.64.101.1", 8729)
PROVISION = str(Path(sys.executable).with_name("provision"))
_VAULT_PASSWORD = b"the word of the quay"
_VAULT = VaultLib([("default", VaultSecret(_VAULT_PASSWORD))])
_NEW_NETWORK = 0x40000000
"""CLONE_NEWNET, see unshare(2)."""


@dataclass(slots=True)
class Quay:
    inventory: Path
    state: Path
    spec: SiteSpec
    twins: SpawnedSite
    door: "Door"
    stack: ExitStack
    alone: bool = True
    """Only the router stands here; the ends of the Wi-Fi bridge do not."""
    twin: str = ROUTER
    """The emulated router that stands at the address now."""
    program: bool = False
    """Start the program itself, instead of a process that has imported what it needs."""

    def do(self, command: str, **arguments: Any) -> Any:  # noqa: ANN401 (JSON of any shape)
        """Command the twin that stands at the address."""
        return self.twins.do(self.twin, command, **arguments)

    def export(self) -> str:
        lines = str(self.do("export")).splitlines(keepends=True)
        return "".join(line for line in lines if not line.startswith("#"))

    def replace(self, name: str, **box: Any) -> None:  # noqa: ANN401 (fields of RouterSpec)
        """Put another box in the router's place: fresh from `provision device adopt`, with a certificate of its own."""
        (twin,) = self.spec.emulators
        router = twin.router.model_copy(update={"name": name, "serial_number": name.upper(), **box})
        spec = SiteSpec(name=self.spec.name, emulators=(twin.model_copy(update={"router": router}),))
        self.twins = self.stack.enter_context(preforked.spawn(spec, self.inventory.parent / name))
        self.twin = name
        self.door.port = self.twins.ready[name]["api_ssl"]

    def adopt(self) -> None:
        """Pin what `provision device adopt` would pin."""
        self._pin(self.state)

    def laptop(self, name: str) -> dict[str, str]:
        """Environment of another laptop: it shares nothing with the first one, and its owner trusts the router too."""
        state = self.state.with_name(name)
        self._pin(state)
        return {**self.environment(), "ATLANTIS_STATE": str(state)}

    def _pin(self, state: Path) -> None:
        Store(state).pins.change(ROUTER, self.twins.ready[self.twin]["pin"])

    def environment(self) -> dict[str, str]:
        return {
            **os.environ,
            "ATLANTIS_STATE": str(self.state),
            "ANSIBLE_VAULT_PASSWORD_FILE": str(self.inventory.parent / "vault-password"),
        }

    def provision(self, *typed: str, code: int) -> subprocess.CompletedProcess[str]:
        """Type a command; `inventory=` is added, and `only=`: nothing but the router stands at this quay."""
        done = self.start([*typed, *self.only(typed), *self._inventory(typed)])
        assert done.returncode == code, f"exit {done.returncode}\n{done.stdout}\n{done.stderr}"
        return done

    def start(
        self,
        words: list[str],
        *,
        stdin: int = subprocess.DEVNULL,
        stderr: int = subprocess.PIPE,
        pass_fds: tuple[int, ...] = (),
    ) -> subprocess.CompletedProcess[str]:
        """Type these words as they are."""
        if not self.program:
            return preforked.run(words, env=self.environment(), stdin=stdin, stderr=stderr, pass_fds=pass_fds)
        return subprocess.run(
            [PROVISION, *words],
            env=self.environment(),
            stdin=stdin,
            stdout=subprocess.PIPE,
            stderr=stderr,
            pass_fds=pass_fds,
            text=True,
            check=False,
        )

    def playbook(self, *words: str) -> subprocess.CompletedProcess[str]:
        """Run the playbook for the router without `provision`."""
        return subprocess.run(
            [
                *(sys.executable, "-m", "ansible", "playbook", "-i", str(self.inventory)),
                *("--limit", ROUTER, *words, str(CHECKOUT / "playbooks" / "site.yml")),
            ],
            env={**self.environment(), "ANSIBLE_CONFIG": str(CHECKOUT / "ansible.cfg")},
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            check=False,
        )

    def configure(self) -> None:
        """Do what `provision site=coastal device=coastal-router --yes` does, without its command line and Ansible.

        For tests of what comes after a run: recorded, confirmed and pinned it is all the same, in a fifth of the time.
        """
        request = {"state": str(self.state)}
        outcome = perform(self.inventory, [ROUTER], request, plan_only=False, decrypt=_opened)
        told = outcome["per_host"][ROUTER]
        assert told["exit"] == 0, told["message"]

    def typed(self, *typed: str, answer: str, code: int) -> str:
        """Type a command at a terminal, and an answer to its question, as above; give all that it prints."""
        ours, theirs = os.openpty()
        with os.fdopen(ours, "wb", buffering=0) as keyboard:
            keyboard.write(f"{answer}\n".encode())
            words = [*typed, *self.only(typed), *self._inventory(typed)]
            done = self.start(words, stdin=theirs, stderr=subprocess.STDOUT)
            os.close(theirs)
        assert done.returncode == code, f"exit {done.returncode}\n{done.stdout}"
        return done.stdout

    def _inventory(self, typed: tuple[str, ...]) -> tuple[str, ...]:
        return () if any(word.startswith("inventory=") for word in typed) else (f"inventory={self.inventory}",)

    def only(self, typed: tuple[str, ...]) -> tuple[str, ...]:
        """Leave the bridge alone where a command is about the site; the engine's runs, which take `device=`."""
        runs = {"report drift", "device backup", "recover rollback", "plan site=coastal"}
        named = any(word.startswith("device=") for word in typed)
        return (
            ()
            if (typed[0] != "site=coastal" and " ".join(typed[:2]) not in runs) or named or not self.alone
            else (f"device={ROUTER}",)
        )

    def json(self, *typed: str, code: int) -> dict[str, Any]:
        told: dict[str, Any] = json.loads(self.provision(*typed, "--json", code=code).stdout)
        assert told["exit"] == code
        return told

    def runs(self) -> list[dict[str, Any]]:
        done = self.start(["report", "runs", "site=coastal", "--json"])
        assert done.returncode == 0, done.stderr
        listed: list[dict[str, Any]] = json.loads(done.stdout)["runs"]
        return listed


@dataclass(slots=True)
class Door:
    """Where the router's declared address leads to."""

    port: int


def _opened(text: str) -> str:
    return str(_VAULT.decrypt(text.encode()).decode())


@contextmanager
def quay(folder: Path, *others: User, seed: str = "") -> Iterator[Quay]:
    """One adopted twin of the coastal router, in a network namespace where it stands at its declared address.

    `others` have accounts on it besides us; `seed` is what it has been configured with.
    """
    root = _inventory(folder)
    declaration = load(root, decrypt=_opened)
    spec = site_spec(declaration, [declaration.hosts[ROUTER]])
    (twin,) = spec.emulators
    users = (*twin.router.users, *others)
    router = twin.router.model_copy(
        update={"unroll_delay_s": 0.05, "silent_timeout_s": 2.0, "users": users, "seed": seed}
    )
    spec = spec.model_copy(update={"emulators": (twin.model_copy(update={"router": router}),)})
    with ExitStack() as stack:
        stack.enter_context(_namespace())
        twins = stack.enter_context(preforked.spawn(spec, folder / "twins"))
        door = Door(twins.ready[ROUTER]["api_ssl"])
        stack.enter_context(forwarded(door))
        opened = Quay(root, folder / "state", spec, twins, door, stack)
        opened.adopt()
        yield opened


def fresh_quay(tmp_path: Path) -> Iterator[Quay]:
    """What a fixture gives to tests that want no more than the router and its laptop."""
    with quay(tmp_path) as opened:
        yield opened


def _inventory(folder: Path) -> Path:
    """A copy of the shipped inventory in which nothing is an example any more, and secrets are vaulted."""
    root = folder / "inventory"
    (folder / "vault-password").write_bytes(_VAULT_PASSWORD)
    shutil.copytree(CHECKOUT / "inventory", root)
    for path in root.rglob("*.yml"):
        text = path.read_text(encoding="utf-8")
        path.write_text(_real(text), encoding="utf-8")
    return root


def _real(text: str) -> str:
    for documentation, real in (("203.0.113.", "10.99.3."), ("198.51.100.", "10.99.2."), ("192.0.2.", "10.99.1.")):
        text = text.replace(documentation, real)
    text = re.sub(r" #.*\bEXAMPLE\b(?!-).*", "", text)
    text = text.replace("example_values: true", "example_values: false").replace("example.org", "atlantis.internal")
    text = text.replace("internet.example", "internet.atlantis.internal")
    for named in ("ssid", "revision", "name"):
        text = text.replace(f"{named}: EXAMPLE-", f"{named}: ")
    text = text.replace(" EXAMPLE technician", " technician")
    return re.sub(r"EXAMPLE-([a-z0-9-]+)", lambda found: _vaulted(f"a-real-{found[1]}"), text)


@cache
def _vaulted(secret: str) -> str:
    """As `ansible-vault encrypt_string` has it, on one line."""
    return f"!vault {json.dumps(_VAULT.encrypt(secret.encode()).decode())}"


@contextmanager
def _namespace() -> Iterator[None]:
    """Move this thread, and all processes that it starts, into a network of their own."""
    if os.geteuid() != 0:
        pytest.skip("making a network namespace needs root")
    libc = ctypes.CDLL(None, use_errno=True)
    before = os.open("/proc/thread-self/ns/net", os.O_RDONLY | os.O_CLOEXEC)
    try:
        assert libc.unshare(_NEW_NETWORK) == 0, os.strerror(ctypes.get_errno())
        for command in ("link set lo up", f"address add {ADDRESS[0]}/32 dev lo"):
            subprocess.run(["ip", *command.split()], check=True)
        yield
    finally:
        assert libc.setns(before, _NEW_NETWORK) == 0, os.strerror(ctypes.get_errno())
        os.close(before)


@contextmanager
def forwarded(door: Door, port: int = ADDRESS[1]) -> Iterator[None]:
    """Stand at the router's declared address and pass every byte to the twin; drop who comes when there is none."""

    class Visit(socketserver.BaseRequestHandler):
        def handle(self) -> None:
            if not door.port:
                return
            with socket.create_connection(("127.0.0.1", door.port)) as twin:
                back = threading.Thread(target=_pump, args=(twin, self.request), daemon=True)
                back.start()
                _pump(self.request, twin)
                back.join()

    class Doors(socketserver.ThreadingTCPServer):
        allow_reuse_address = True
        daemon_threads = True
        block_on_close = False

    with Doors((ADDRESS[0], port), Visit) as server:
        thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.05})
        thread.start()
        try:
            yield
        finally:
            server.shutdown()
            thread.join()


def _pump(source: socket.socket, sink: socket.socket) -> None:
    with suppress(OSError):
        while data := source.recv(65536):
            sink.sendall(data)
    with suppress(OSError):
        sink.shutdown(socket.SHUT_WR)
