"""Where clients that we did not write meet the coastal router: a twin in a process, our engine, their programs.

Their programs stand in `clients/` and run in `.venv-strangers` (`make test` makes it): they know nothing of us but a
JSON object given as argument, and answer one on their standard output.
"""

import asyncio
import json
import os
import ssl
import subprocess
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import pytest
from waiting import HANG_S

from atlantis_netcfg.core.secret import Secret
from atlantis_netcfg.emulator.routeros import RouterLink, SiteSpec, SpawnedSite, User, WireBehaviour, spawn
from atlantis_netcfg.inventory import Inventory, load
from atlantis_netcfg.operations.common.rehearsal import site_spec
from atlantis_netcfg.routeros import DeviceJob, DeviceResult, Endpoint, JobMode, Status, converge, desired
from atlantis_netcfg.routeros.apply import SshEndpoint
from atlantis_netcfg.routeros.render import router

ROOT = Path(__file__).resolve().parents[2]
STRANGERS = ROOT / ".venv-strangers"
CLIENTS = Path(__file__).with_name("clients")
ROUTER = "coastal-router"
STRANGER = User(name="stranger", password="as they come")
PRESENT = pytest.mark.skipif(
    not (STRANGERS / "stamp").exists(), reason="no .venv-strangers here: `tools/strangers` makes it"
)


@cache
def declaration() -> Inventory:
    """The shipped inventory."""
    return load(ROOT / "inventory")


@cache
def text() -> str:
    """What `provision` wants of the coastal router."""
    return router(declaration(), declaration().hosts[ROUTER])


@dataclass(frozen=True, slots=True)
class Stand:
    """A running twin; `provision` brings it to the declared state, `ask` lets a client of others speak with it."""

    folder: Path
    twins: SpawnedSite
    version: str

    @property
    def ready(self) -> dict[str, Any]:
        """Where the twin is to be found."""
        return dict(self.twins.ready[ROUTER])

    def provision(self, mode: JobMode = JobMode.APPLY, **changes: Any) -> DeviceResult:  # noqa: ANN401 - fields of DeviceJob
        """Run our engine on it, in the technician's name."""
        spec = site_spec(declaration(), [declaration().hosts[ROUTER]]).emulators[0].router
        user = spec.users[0]
        endpoint = Endpoint(
            host="127.0.0.1",
            port=self.ready["api_ssl"],
            user=user.name,
            password=Secret(user.password),
            pin=self.ready["pin"],
        )
        job = {
            "name": ROUTER,
            "site": "coastal",
            "address": spec.management.local,
            "endpoint": endpoint,
            "desired_state": desired.read(text()),
            "ssh": SshEndpoint(
                "127.0.0.1", self.ready["ssh"], user.name, Secret(user.password), self.ready["host_key"]
            ),
        }
        return asyncio.run(converge(DeviceJob(**{**job, **changes}), mode=mode))

    def drift(self) -> str:
        """What our plan would change, as the technician reads it."""
        return self.provision(JobMode.PLAN).diff

    def put_right(self) -> None:
        """Run, and run again: the second run finds nothing to do."""
        assert self.provision().status is Status.CHANGED
        assert self.provision().status is Status.UNCHANGED

    def job(self, **more: Any) -> dict[str, Any]:  # noqa: ANN401 - JSON of any shape
        """What every client is told."""
        return {
            "host": "127.0.0.1",
            "port": self.ready["api_ssl"],
            "plain": self.ready["api"],
            "ssh": self.ready["ssh"],
            "user": STRANGER.name,
            "password": STRANGER.password,
            "ca": str(self.folder / "router.pem"),
            **more,
        }

    def ask(self, client: str, **more: Any) -> Any:  # noqa: ANN401 - JSON of any shape
        """Run a client and return what it tells."""
        return run(client, self.job(**more), self.folder)

    def export(self) -> str:
        """The twin's own export without its header, whose clock moves."""
        lines = str(self.twins.do(ROUTER, "export", show_sensitive=True)).splitlines(keepends=True)
        return "".join(line for line in lines if not line.startswith("#"))


def run(client: str, job: Mapping[str, Any], folder: Path) -> Any:  # noqa: ANN401 - JSON of any shape
    """Run `clients/NAME.py` or `.js` with a job; a program that fails, or says anything on stderr, fails the test."""
    program = "node" if client.endswith(".js") else str(STRANGERS / "bin" / "python")
    done = subprocess.run(
        [program, str(CLIENTS / client), json.dumps(job)],
        env=environment(folder),
        cwd=folder,
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        timeout=HANG_S,
        check=False,
    )
    assert (done.returncode, done.stderr) == (0, ""), f"exit {done.returncode}\n{done.stdout}\n{done.stderr}"
    return json.loads(done.stdout)


def environment(folder: Path) -> dict[str, str]:
    """That of a stranger: his own programs first, a home of his own, nothing of our Python's."""
    kept = {name: value for name, value in os.environ.items() if not name.startswith(("PYTHON", "ANSIBLE", "VIRTUAL"))}
    path = f"{STRANGERS / 'bin'}{os.pathsep}{os.environ['PATH']}"
    return {**kept, "PATH": path, "HOME": str(folder), "NODE_PATH": str(STRANGERS / "node_modules")}


@contextmanager
def stand(folder: Path, *, version: str = "7.18.2", knobs: WireBehaviour | None = None, **box: Any) -> Iterator[Stand]:  # noqa: ANN401
    """Start the coastal router as `provision device adopt` leaves it; `box`: fields of its spec."""
    (twin,) = site_spec(declaration(), [declaration().hosts[ROUTER]]).emulators
    wanted = {"version": version, "users": (*twin.router.users, STRANGER), **box}
    changes = {"link": RouterLink(), "router": twin.router.model_copy(update=wanted)}
    twin = twin.model_copy(update=changes if knobs is None else {**changes, "knobs": knobs})
    with ExitStack() as stack:
        twins = stack.enter_context(spawn(SiteSpec(name="coastal", emulators=(twin,)), folder))
        stood = Stand(folder, twins, version)
        certificate = ssl.get_server_certificate(("127.0.0.1", stood.ready["api_ssl"]))
        (folder / "router.pem").write_text(certificate, encoding="ascii")
        yield stood
