"""Where contenders meet the router: its state before each scenario, the proxies before it, and what became of it."""

from __future__ import annotations

import asyncio
import difflib
import shutil
import ssl
import threading
from concurrent.futures import Future
from contextlib import AsyncExitStack, ExitStack, contextmanager
from dataclasses import dataclass
from itertools import count, groupby
from typing import TYPE_CHECKING, Any, Self

from atlantis_netcfg.emulator.routeros import RouterLink, SiteSpec, SpawnedSite, spawn
from atlantis_netcfg.routeros.link_use import SETTLED_S
from atlantis_netcfg.routeros.menus import MENUS
from atlantis_netcfg.routeros.rsc import parse, print_statement
from bench import edits, measure, namespace
from bench.contenders.ours import Ours
from bench.declared import ROUTER, Declared
from bench.job import Job, Scenario
from bench.proxy import Count, Proxy, Shape

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

__all__ = ["Stage", "World"]

_STARTS = {
    Scenario.FIRST: "adopted",
    Scenario.NOTHING: "finished",
    Scenario.FIREWALL: "edited",
    Scenario.USE: "finished",
}
_API_SSL, _SSH = 8729, 22
_PATIENCE_S = 30.0


class Proxies:
    """Proxies in a thread of their own, so that contenders can be waited for; a context manager."""

    def __init__(self, doors: list[tuple[str, int, int]], shape: Shape) -> None:
        """Each door: where to listen (port 0: any), and the loopback port behind it."""
        self.proxies = [Proxy(host, port, ("127.0.0.1", target), shape) for host, port, target in doors]
        self._ready: Future[None] = Future()
        self._thread = threading.Thread(target=lambda: asyncio.run(self._live()), daemon=True)
        self._loop: asyncio.AbstractEventLoop
        self._end: asyncio.Event

    def __enter__(self) -> Self:
        self._thread.start()
        self._ready.result(_PATIENCE_S)
        return self

    def __exit__(self, *_: object) -> None:
        self._loop.call_soon_threadsafe(self._end.set)
        self._thread.join(_PATIENCE_S)

    async def _live(self) -> None:
        self._loop, self._end = asyncio.get_running_loop(), asyncio.Event()
        async with AsyncExitStack() as stack:
            try:
                for proxy in self.proxies:
                    await stack.enter_async_context(proxy)
            except OSError as problem:
                self._ready.set_exception(problem)
                return
            self._ready.set_result(None)
            await self._end.wait()

    def count(self) -> Count:
        """What has crossed all of them."""
        total = Count()
        for proxy in self.proxies:
            total.add(proxy.count)
        return total


@dataclass(frozen=True, slots=True)
class Stage:
    """One router, ready for one contender."""

    job: Job
    proxies: Proxies
    twins: SpawnedSite
    expected: str

    def differences(self) -> tuple[str, ...]:
        """Lines of the router's export that are not as after our own run: `+` only here, `-` only after ours."""
        lines = difflib.unified_diff(self.expected.splitlines(), _export(self.twins).splitlines(), lineterm="", n=0)
        return tuple(line for line in lines if line[:2] not in ("--", "++", "@@"))


class World:
    """Made once for a bench: the declared state and the router in each state that a scenario begins with."""

    def __init__(self, folder: Path) -> None:
        self.declared = Declared.make(folder)
        self._folder = folder
        self._numbers = count(1)
        self.excuse = namespace.enter(self._address)
        """Why the router does not stand at its declared address; None if it does."""
        self._expected = ""
        self._text = ""
        self._make_states()

    @contextmanager
    def stage(self, scenario: Scenario, shape: Shape) -> Iterator[Stage]:
        """Start a router in the state in which the scenario begins, behind a link of this shape."""
        folder = self._folder / f"run-{next(self._numbers)}"
        shutil.copytree(self._state(_STARTS[scenario]), folder / "twins")
        with ExitStack() as stack:
            twins = stack.enter_context(self._twins(folder / "twins"))
            ready = twins.ready[ROUTER]
            if scenario is Scenario.USE:
                twins.do(ROUTER, "wait", seconds=SETTLED_S)
            proxies = stack.enter_context(Proxies(self._doors(ready), shape))
            yield Stage(self._job(scenario, folder, ready, proxies), proxies, twins, self._expected)

    def _job(self, scenario: Scenario, folder: Path, ready: dict[str, Any], proxies: Proxies) -> Job:
        host, port = proxies.proxies[0].address
        ca = folder / "router.pem"
        ca.write_text(ssl.get_server_certificate(("127.0.0.1", ready["api_ssl"])), encoding="ascii")
        repair = scenario is Scenario.FIREWALL
        script = edits.repair_script(self.declared) if repair else edits.first_script(self.declared.text, self._address)
        return Job(
            scenario=scenario,
            folder=folder,
            host=host,
            port=port,
            ssh_port=proxies.proxies[1].address[1] if len(proxies.proxies) > 1 else None,
            pin=ready["pin"],
            ca=ca,
            declared=self.declared,
            script=tuple(script),
            export=self._text,
            real=self.excuse is None,
        )

    @property
    def _address(self) -> str:
        return self.declared.access[0]

    def _doors(self, ready: dict[str, Any]) -> list[tuple[str, int, int]]:
        """Declared address and ports, or any on loopback."""
        host = "127.0.0.1" if self.excuse else self._address
        doors = [(host, 0 if self.excuse else _API_SSL, ready["api_ssl"])]
        if ready.get("ssh"):
            doors.append((host, 0 if self.excuse else _SSH, ready["ssh"]))
        return doors

    def _twins(self, folder: Path) -> SpawnedSite:
        twin = self.declared.twin.model_copy(update={"link": RouterLink()})
        folder.mkdir(parents=True, exist_ok=True)
        return spawn(SiteSpec(name="bench", emulators=(twin,)), folder)

    def _state(self, name: str) -> Path:
        return self._folder / "states" / name

    def _make_states(self) -> None:
        with self._twins(self._state("adopted")):
            pass
        with self.stage(Scenario.FIRST, Shape()) as stage:
            ran = measure.run_command(Ours().command(stage.job), stage.job.folder)
            if ran.code != 0:
                raise RuntimeError(f"our own first configuration failed:\n{ran.output}")
            self._expected = _export(stage.twins)
            self._text = str(stage.twins.do(ROUTER, "export"))
        shutil.copytree(stage.job.folder / "twins", self._state("finished"))
        shutil.copytree(self._state("finished"), self._state("edited"))
        with self._twins(self._state("edited")) as twins:
            edits.damage(lambda words: list(twins.do(ROUTER, "console", words=list(words))))


def _export(twins: SpawnedSite) -> str:
    """The twin's own export, one row a line; rows whose order means nothing are sorted."""
    statements = parse(str(twins.do(ROUTER, "export", show_sensitive=True)), "export").statements
    lines: list[str] = []
    for menu, rows in groupby(statements, key=lambda statement: statement.menu):
        printed = [print_statement(row, path=True) for row in rows]
        lines += printed if menu in MENUS and MENUS[menu].is_ordered else sorted(printed)
    return "\n".join(lines)
