"""Two commands configure a router from its box: `provision device adopt ...`, `provision site=...`."""

import importlib
import json
import os
import signal
import socket
import subprocess
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import preforked
import pytest
from quay import _VAULT, PROVISION, _inventory, _namespace, _pump

from atlantis_netcfg.emulator.routeros import SiteSpec, SpawnedSite
from atlantis_netcfg.inventory import load
from atlantis_netcfg.operations.common.rehearsal import factory_spec

pytestmark = [pytest.mark.slow, pytest.mark.namespace]

ROUTER = "scc-router"
MANAGEMENT, FACTORY = "10.64.100.1", "192.168.88.1"
ADOPT = ("device", "adopt", "site=scc", f"device={ROUTER}", "--yes")
RUN = ("site=scc", f"device={ROUTER}")


@dataclass(slots=True)
class Bench:
    """A router in its box, on a bench where both of its addresses lead to it."""

    inventory: Path
    state: Path
    twins: SpawnedSite

    @property
    def environment(self) -> dict[str, str]:
        return {
            **os.environ,
            "ATLANTIS_STATE": str(self.state),
            "ANSIBLE_VAULT_PASSWORD_FILE": str(self.inventory.parent / "vault-password"),
        }

    def start(self, *typed: str) -> subprocess.Popen[str]:
        return subprocess.Popen(
            [PROVISION, *typed, f"inventory={self.inventory}"],
            env=self.environment,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )

    def run(self, *typed: str, code: int) -> subprocess.CompletedProcess[str]:
        done = preforked.run([*typed, f"inventory={self.inventory}"], env=self.environment)
        assert done.returncode == code, f"exit {done.returncode}\n{done.stdout}\n{done.stderr}"
        return done

    def provision(self, *typed: str, code: int) -> str:
        done = self.run(*typed, code=code)
        return done.stdout + done.stderr

    def json(self, *typed: str, code: int) -> dict[str, Any]:
        told: dict[str, Any] = json.loads(self.run(*typed, "--json", code=code).stdout)
        return told

    def export(self) -> str:
        return str(self.twins.do(ROUTER, "export", header=False))

    def via(self, serial: bool) -> tuple[str, ...]:  # noqa: FBT001 - a parameter of tests
        return (f"via=serial:{self.twins.do(ROUTER, 'info')['serial']}",) if serial else ()


@contextmanager
def bench(folder: Path) -> Iterator[Bench]:
    root = _inventory(folder)
    declaration = load(root, decrypt=lambda text: str(_VAULT.decrypt(text.encode()).decode()))
    spec = factory_spec(declaration, declaration.hosts[ROUTER], serial=True)
    router = spec.router.model_copy(update={"unroll_delay_s": 0.05, "silent_timeout_s": 2.0})
    site = SiteSpec(name="scc", emulators=(spec.model_copy(update={"router": router}),))
    with ExitStack() as stack:
        stack.enter_context(_namespace())
        for address in (MANAGEMENT, FACTORY):
            subprocess.run(["ip", "address", "add", f"{address}/32", "dev", "lo"], check=True)
        twins = stack.enter_context(preforked.spawn(site, folder / "twins"))
        ready = twins.ready[ROUTER]
        for address, doors in ((MANAGEMENT, ready["ports"]), (FACTORY, ready["first_contact"]["ports"])):
            for port in (22, 8729):
                stack.enter_context(led((address, port), int(doors[str(port)])))
        yield Bench(root, folder / "state", twins)


@contextmanager
def led(address: tuple[str, int], loopback: int) -> Iterator[None]:
    """Pass every byte that comes to an address of the bench on to the twin."""
    with socket.create_server(address) as door:

        def serve() -> None:
            while True:
                try:
                    client, _ = door.accept()
                except OSError:
                    return
                threading.Thread(target=pass_on, args=(client,), daemon=True).start()

        def pass_on(client: socket.socket) -> None:
            with client, socket.create_connection(("127.0.0.1", loopback)) as twin:
                back = threading.Thread(target=_pump, args=(twin, client), daemon=True)
                back.start()
                _pump(client, twin)
                back.join()

        thread = threading.Thread(target=serve, daemon=True)
        thread.start()
        try:
            yield
        finally:
            door.shutdown(socket.SHUT_RDWR)
            thread.join()


@pytest.fixture
def at(tmp_path: Path) -> Iterator[Bench]:
    with bench(tmp_path) as opened:
        yield opened


@pytest.mark.smoke("ssh")
@pytest.mark.parametrize("serial", [False, True], ids=["ssh", "serial"])
def test_factory_router_reaches_the_desired_state_in_two_commands(at: Bench, serial: bool) -> None:  # noqa: FBT001
    adopted = at.json(*ADOPT, *at.via(serial), code=0)
    assert (adopted["status"], adopted["standing"]) == ("changed", "factory-fresh")
    assert "defconf" not in at.export()

    first = at.json(*RUN, "--yes", code=0)
    assert first["devices"][ROUTER]["status"] == "changed"

    after = at.export()
    assert at.json(*RUN, "--yes", code=0)["devices"][ROUTER]["status"] == "unchanged"
    assert at.json("plan", *RUN, code=0)["devices"][ROUTER]["planned"] == 0
    at.provision("report", "drift", *RUN, code=0)
    assert at.json(*ADOPT, *at.via(serial), code=0)["status"] == "unchanged"
    assert at.export() == after


@pytest.mark.parametrize("serial", [False, True], ids=["ssh", "serial"])
def test_killed_adoption_can_be_repeated(at: Bench, serial: bool) -> None:  # noqa: FBT001
    via = at.via(serial)
    process = at.start(*ADOPT, *via)
    journal = at.state / "real" / "scc" / "runs"
    while '"step":"clear"' not in "".join(path.read_text() for path in journal.glob("*/journal.jsonl")):
        assert process.poll() is None, process.communicate()
        time.sleep(0.01)
    process.send_signal(signal.SIGKILL)
    process.communicate()
    assert "provision device adopt" in at.provision("recover", "resume", "site=scc", code=3)
    at.provision(*ADOPT, *via, code=0)
    assert "defconf" not in at.export()
    assert at.json(*ADOPT, *via, code=0)["status"] == "unchanged"
    at.provision(*RUN, "--yes", code=0)


def test_adopted_router_can_be_upgraded_with_stored_credentials(at: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    """The vaulted password, the certificate and the host key of first contact serve the next command."""
    monkeypatch.syspath_prepend(Path(__file__).parents[2] / "routeros" / "upgrade")
    npk_files = importlib.import_module("npk_files")
    at.provision(*ADOPT, code=0)
    file = npk_files.write(at.state, "routeros", "7.21.5", "arm64")
    typed = ("device", "upgrade", "site=scc", f"device={ROUTER}", f"packages={file}", "--plan")
    assert "planned: RouterOS 7.18.2 -> 7.21.5" in at.provision(*typed, code=2)


def test_without_consent_nothing_is_changed(at: Bench) -> None:
    before = at.export()
    assert "no terminal to confirm" in at.provision(*ADOPT[:-1], code=3)
    assert at.export() == before
    shown = at.provision(*ADOPT[:-1], "--plan", code=2)
    assert "1. set the clock" in shown
    assert "create certificate atlantis-api on the device" in shown
    assert at.export() == before


def test_unreachable_address_is_reported(at: Bench) -> None:
    said = at.provision(*ADOPT, "address=127.0.0.9", code=4)
    assert "127.0.0.9: no response on the SSH port" in said
