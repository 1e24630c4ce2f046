"""Each thing that can be broken in a rehearsal turns exactly the items that it concerns; these say what mends it."""

import asyncio
import contextlib
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from atlantis_netcfg.checklist import plan
from atlantis_netcfg.checklist.report import Item, ItemKind
from atlantis_netcfg.checklist.runner import examine
from atlantis_netcfg.checklist.runner.simulated import FAULTS, rehearsed_ears
from atlantis_netcfg.checklist.runner.simulated._faults import ROUTER_FAULTS as OF_ROUTERS
from atlantis_netcfg.cli import checklist
from atlantis_netcfg.cli.base.session import CommandSession, session
from atlantis_netcfg.cli.base.syntax import parse
from atlantis_netcfg.core.events import Verdict
from atlantis_netcfg.operations import Mode
from atlantis_netcfg.operations.computers._access import is_computer

pytestmark = pytest.mark.slow

SITE = "coastal"
STICKS = "stork/rc_rf/sticks"
Seen = dict[str, tuple[Verdict, tuple[tuple[Verdict, str], ...]]]


@pytest.fixture
def coastal(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[CommandSession]:
    """The routers as they are declared."""
    monkeypatch.setenv("ATLANTIS_STATE", str(tmp_path / "state"))
    arguments = parse(checklist.CHECK, [f"site={SITE}", "--rehearse", "--json"])
    with session(
        arguments,
        rehearse=True,
        choose_hosts=lambda declaration: tuple(one for one in declaration.site_hosts(SITE) if not is_computer(one)),
    ) as opened:
        assert opened.perform(Mode.APPLY).exit == 0
        yield opened


def looked(opened: CommandSession, broken: Sequence[str]) -> dict[str, Item]:
    """All that a program sees; the sticks, which take twelve seconds, where they are concerned or all is well."""
    sticks = not broken or any(STICKS in FAULTS[name].turns for name in broken)
    assert opened.rehearsal is not None
    entries = [
        one
        for one in plan(opened.inventory, SITE).entries
        if one.item.kind is not ItemKind.PERSON and (sticks or one.item.id != STICKS)
    ]
    with rehearsed_ears(opened.inventory, SITE, opened.rehearsal, broken) as ears:
        return {item.id: item for item in asyncio.run(examine(entries, ears, lambda _: None))}


def told(items: dict[str, Item]) -> Seen:
    return {
        name: (item.verdict, tuple((finding.verdict, finding.code) for finding in item.findings))
        for name, item in items.items()
    }


def wrong_about(name: str, items: dict[str, Item], well: Seen) -> Iterator[str]:
    """What is not as the fault says."""
    turned = {one for one, seen in told(items).items() if seen != well[one]}
    concerned = {one.replace("SITE", SITE) for one in FAULTS[name].turns}
    for one in sorted(concerned - turned):
        yield f"{name}: {one} has not noticed"
    for one in sorted(turned - concerned):
        yield f"{name}: {one} has turned: {items[one].message}"
    for one in sorted(turned & concerned):
        if items[one].verdict in {Verdict.PASS, Verdict.SKIP, Verdict.ERROR} or not items[one].hint:
            yield f"{name}: {one} says {items[one].verdict} without a hint: {items[one].message}"


def test_each_fault_changes_exactly_the_affected_items_and_names_the_fix(coastal: CommandSession) -> None:
    well = told(looked(coastal, ()))
    unmeasured = {name for name, seen in well.items() if seen[0] is Verdict.SKIP}
    assert unmeasured == {f"{SITE}/site/link-qualified-{link}" for link in ("wifi-ptp", "4g", "satellite")}
    assert {seen[0] for name, seen in well.items() if name not in unmeasured} == {Verdict.PASS, Verdict.WARN}
    # By the registration table of the emulated router's access point.
    assert [well[f"{name}/wifi"][0] for name in ("zarco", "stork")] == [Verdict.PASS, Verdict.PASS]
    found = {name: looked(coastal, (name,)) for name in OF_ROUTERS}
    # What is not done to a router, which all share, can be looked at side by side.
    beside = [name for name in FAULTS if name not in OF_ROUTERS]
    with ThreadPoolExecutor(4) as pool:
        found.update(zip(beside, pool.map(lambda name: looked(coastal, (name,)), beside), strict=True))
    assert len(found) >= 40
    assert [one for name in FAULTS for one in wrong_about(name, found[name], well)] == []
    # Everything was taken back.
    with contextlib.suppress(KeyError):
        del well[STICKS]
    assert {name: seen for name, seen in told(looked(coastal, ("gps-stale",))).items() if name != "sparus/gps"} == {
        name: seen for name, seen in well.items() if name != "sparus/gps"
    }
