"""What our own run costs on the wire in each scenario, exactly: the engine against one emulated router, and a proxy.

A round trip is a flight that the next one depends on: TCP's handshake, and each time that the router answers what we
have said since it was last heard (TLS takes two of them). Without a limit of the rate their number times the delay is
the wall time of a run, as far as the router answers at once; the end of a session counts where it is waited for. Bytes
are TCP's payload in both directions. `docs/engineers/benchmarks.md` has the figures, and a test compares.
"""

from __future__ import annotations

import asyncio
import re
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import TYPE_CHECKING

from atlantis_netcfg.core.events import ignore
from atlantis_netcfg.emulator.routeros import EmulatedRouter, RouterLink
from atlantis_netcfg.operations import Request
from atlantis_netcfg.operations.common.jobs import device_job
from atlantis_netcfg.operations.common.request import LinkOrder, Target
from atlantis_netcfg.routeros import converge
from atlantis_netcfg.routeros.link_use import SETTLED_S
from atlantis_netcfg.runs import RunStart, Store
from bench.declared import ROUTER, SITE, Declared
from bench.edits import FILTER, damage
from bench.job import Scenario
from bench.proxy import Count, Proxy, Shape

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from atlantis_netcfg.routeros import DeviceResult
    from bench.figures import Figure

__all__ = ["SATELLITE", "WireFigure", "measured", "part", "published", "replaced"]

SATELLITE = Shape.read("700/352/704")
"""Iridium Certus: 700 ms, 352 kbit/s up, 704 down."""
_USE = LinkOrder(
    link="4g", since_uptime_s=1, until_uptime_s=SETTLED_S + 1800, until=datetime(2030, 1, 1, 12, 30, tzinfo=UTC)
)
_TITLE = "## Our own run on the wire\n"
_WORDS = """\
What the command that a technician types sends and receives, exactly, on whatever link. Handshakes of TCP and TLS are
counted, and of `use` the look at the links that comes before it. A test types the command again, and fails where its
bytes are 2 % from these.
"""
_ROW = re.compile(r"^\| ([a-z-]+) \| (\d+) \| (\d+) \| (\d+) \|$", re.MULTILINE)


@dataclass(frozen=True, slots=True)
class WireFigure:
    """One run: what it said of itself, what the proxy has counted, and how long it took."""

    result: DeviceResult
    count: Count
    wall_s: float


async def measured(folder: Path, shape: Shape) -> dict[Scenario, WireFigure]:
    """Configure a router that was just adopted, find nothing to do on it, put its firewall right, use another link."""
    declared = Declared.make(folder)
    twin = declared.twin
    router = EmulatedRouter(
        twin.router, state_dir=folder / "flash", link=RouterLink(), knobs=twin.knobs, ports=twin.ports
    )
    figures = {}
    for scenario in Scenario:
        # Started anew, so that its history is short, as that of the bench's routers.
        async with router:
            if scenario is Scenario.FIREWALL:
                await _damage(router)
                await router.restart()
            if scenario is Scenario.USE:
                await asyncio.sleep(SETTLED_S)
            async with Proxy("127.0.0.1", 0, (router.host, router.ports["api-ssl"]), shape) as proxy:
                figures[scenario] = await _run(
                    declared, router, proxy, folder / "state", _USE if scenario is Scenario.USE else None
                )
    return figures


async def _run(
    declared: Declared, router: EmulatedRouter, proxy: Proxy, state: Path, use: LinkOrder | None
) -> WireFigure:
    host, port = proxy.address
    target = Target(host=host, port=port, pin=router.pin or "", host_key=router.host_key)
    request = Request(state=state, rehearsed=True, targets={ROUTER: target}, use=use)
    run = RunStart(site=SITE, revision="", tool="", hosts=(ROUTER,), rehearsed=True, command="make bench")
    clock = asyncio.get_running_loop().time
    with Store(state, is_rehearsal=True).start(run) as journal:
        job = device_job(declared.declaration, declared.declaration.hosts[ROUTER], request, journal, ignore)
        begun = clock()
        result = await converge(job)
        return WireFigure(result, proxy.count, clock() - begun)


async def _damage(router: EmulatedRouter) -> None:
    """Take the firewall back to the state before the change."""
    rules = [[answer.kind, *answer.words] for answer in await router.console([f"{FILTER}/print"])]
    edits: list[Sequence[str]] = []

    def ask(words: Sequence[str]) -> list[list[str]]:
        if words[0].endswith("/print"):
            return rules
        edits.append(words)
        return []

    damage(ask)
    for words in edits:
        await router.console(list(words))


def part(figures: Sequence[Figure]) -> str:
    """Return the part of the page."""
    rows = (
        f"| {each.scenario.value} | {each.samples[0].count.connections} | {each.round_trips} | {each.bytes} |\n"
        for each in figures
    )
    head = "| Scenario | Sessions | Round trips | Bytes |\n|---|---|---|---|\n"
    return f"{_TITLE}\n{_WORDS}\n{head}{''.join(rows)}"


def replaced(page: str, figures: Sequence[Figure]) -> str:
    """Return the page with this part made anew."""
    before, found, rest = page.partition(_TITLE)
    if not found:
        before, found, rest = page.partition("## Marks\n")
        return f"{before}{part(figures)}\n{found}{rest}"
    _, end, after = rest.partition("\n## ")
    return f"{before}{part(figures)}{end}{after}"


def published(page: str) -> dict[Scenario, tuple[int, int, int]]:
    """Sessions, round trips and bytes of each scenario, as the page has them."""
    _, _, rest = page.partition(_TITLE)
    rows = _ROW.findall(rest.partition("\n## ")[0])
    return {Scenario(name): (int(a), int(b), int(c)) for name, a, b, c in rows}
