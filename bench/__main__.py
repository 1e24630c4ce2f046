"""`python -m bench`: measure us and our peers, print the figures as they come, write `docs/engineers/benchmarks.md`."""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from pathlib import Path
from typing import TYPE_CHECKING

from atlantis_netcfg import __version__
from bench import wire
from bench.contenders import ALL
from bench.crowd import crowds
from bench.declared import CHECKOUT
from bench.job import RACES, Scenario
from bench.onboarding import EASY_RSA, OURS, easy_rsa_version, onboardings
from bench.page import page
from bench.proxy import Shape
from bench.race import LONG_MS, SHORT_S, Plan, line, race
from bench.runs import kept_runs

if TYPE_CHECKING:
    from bench.figures import Figure, Onboarding

_CROWD, _RUNS, _VPN = "crowd", "runs", "vpn"
_SILENT = (50, 2)
_CALLS = 5
"""Of a command that takes less than a second."""
_BESIDE = (
    f"from {LONG_MS} ms on the peers run side by side and over all links at once, each with a router of its own, since"
    " they do little but wait; we run alone"
)


def main() -> int:
    """Measure what is asked for; 1 if somebody who was there has failed."""
    given = _parser().parse_args()
    if given.wire is not None:
        return _wire(given.wire, given.link[-1])
    begun = time.monotonic()
    links = [Shape()] if given.smoke else given.link
    sizes = [(1, 0), (2, 0)] if given.smoke else [*((size, 0) for size in given.crowd), _SILENT]
    runs, devices = (1, 2) if given.smoke else (given.runs, given.devices)
    only = set(given.only) or {contender.name for contender in ALL} | {_CROWD, _RUNS, _VPN}
    contenders = [contender for contender in ALL if contender.name in only]
    with tempfile.TemporaryDirectory(prefix="bench-") as place:
        folder = Path(place)
        plan = Plan(contenders, given.scenario or RACES, links, runs)
        figures: list[Figure] = []

        def tell(figure: Figure) -> None:
            print(line(figure), flush=True)
            figures.append(figure)

        excuse = race(folder, plan, tell) if contenders else None
        figures.sort(key=lambda row: (links.index(row.link), [each.name for each in ALL].index(row.contender)))
        many = []
        for crowd in crowds(sizes, folder) if _CROWD in only else ():
            of_them = f"{crowd.silent} silent"
            print(f"{crowd.routers:>5} routers  {of_them:<9}  {crowd.cost.wall_s:8.2f} s  {crowd.failure}", flush=True)
            many.append(crowd)
        kept = []
        for figure in (
            kept_runs((10, 20 if given.smoke else 1000), 1 if given.smoke else _CALLS, folder) if _RUNS in only else ()
        ):
            print(f"{figure.runs:>5} runs  {figure.command:<9}  {figure.wall_s:8.2f} s  {figure.failure}", flush=True)
            kept.append(figure)
        batches = _batches(devices, runs, folder) if _VPN in only else []
        exact = [figure for figure in figures if (figure.contender, figure.link) == (OURS, links[-1])]
        if exact:
            (ours,) = (contender for contender in contenders if contender.name == OURS)
            (folder / Scenario.USE).mkdir()
            race(folder / Scenario.USE, Plan([ours], [Scenario.USE], [links[-1]], 1), exact.append)
    versions = {contender.name: contender.version() for contender in contenders if contender.missing() is None}
    versions |= {OURS: f"provision {__version__}", EASY_RSA: easy_rsa_version() or "none"} if batches else {}
    notes = [f"not the real command: {excuse}"] if excuse else []
    notes += [_BESIDE] if max(link.rtt_ms for link in links) >= LONG_MS and len(contenders) > 1 else []
    notes += [f"all of this took {(time.monotonic() - begun) / 60:.0f} min"]
    text = page(figures, many, kept, batches, exact, versions, notes)
    if given.write is not None:
        given.write.write_text(text, encoding="utf-8")
    print(text[text.index("## Marks") :])
    failed = [figure.failure for figure in (*figures, *exact) if figure.samples]
    failed += [entry.failure for entry in many] + [item.failure for item in kept]
    failed += [batch.failure for batch in batches if batch.costs]
    return 1 if any(failed) else 0


def _wire(page_: Path, link: Shape) -> int:
    """Measure our own run on the wire, and write that part of the page anew."""
    (ours,) = (contender for contender in ALL if contender.name == OURS)
    figures: list[Figure] = []
    with tempfile.TemporaryDirectory(prefix="bench-") as place:
        excuse = race(Path(place), Plan([ours], list(Scenario), [link], 1), figures.append)
    if failed := "\n".join(filter(None, [excuse, *(each.failure for each in figures)])):
        print(failed, file=sys.stderr)
        return 1
    page_.write_text(wire.replaced(page_.read_text(encoding="utf-8"), figures), encoding="utf-8")
    print(wire.part(figures))
    return 0


def _batches(devices: int, runs: int, folder: Path) -> list[Onboarding]:
    batches = []
    for batch in onboardings(devices, runs, folder):
        took = f"{batch.wall_s:8.2f} s" if batch.costs else "not measured:"
        print(f"{devices:>5} devices  {batch.contender:<18} {took}  {batch.failure}", flush=True)
        batches.append(batch)
    return batches


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m bench", description=__doc__)
    names = [contender.name for contender in ALL]
    parser.add_argument(
        "--only", nargs="+", choices=[*names, _CROWD, _RUNS, _VPN], default=[], help="these contenders only"
    )
    parser.add_argument("--scenario", nargs="+", type=Scenario, choices=RACES, default=[])
    parser.add_argument(
        "--link",
        nargs="+",
        type=Shape.read,
        metavar="RTT[/UP/DOWN]",
        default=[*map(Shape.read, ("0", "100", "700")), wire.SATELLITE],
        help="round-trip times in ms, and what a link carries in kbit/s",
    )
    parser.add_argument("--runs", type=int, default=3, help=f"how often, where a run takes less than {SHORT_S:g} s")
    parser.add_argument("--crowd", nargs="+", type=int, default=[1, 50, 500], help="numbers of routers for one no-op")
    parser.add_argument("--devices", type=int, default=1000, help="in one batch into the VPN")
    parser.add_argument(
        "--smoke", action="store_true", help="everything once, as small as possible: does it still run?"
    )
    parser.add_argument("--wire", type=Path, metavar="PAGE", help="add the part about the wire of this page anew")
    parser.add_argument("--write", type=Path, help="file for the page", default=None)
    return parser


if __name__ == "__main__":
    if not (CHECKOUT / "inventory").is_dir():
        sys.exit("the bench runs from a checkout")
    sys.exit(main())
