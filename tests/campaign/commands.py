"""What people type in a round: how often, on which devices, how it is prepared, and what its green means."""

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Protocol

from npk_files import write

from atlantis_netcfg.routeros.link_use import SETTLED_S
from campaign.site import ADDRESSES, DRIFTS, NEXT_VERSION, ROUTER, STATES

if TYPE_CHECKING:
    from campaign.command import Ended
    from campaign.judge import Picture
    from campaign.rounds import Table

SITE = "coastal"
AGREED = ("--yes", "--accept-cost")
_USE = ("links", "use", f"site={SITE}", "link=4g", "for=50m", "--unproved")
AFTER_S = 3600.0
"""What passes before the last look: longer than anything that a run leaves to a device."""
PACKAGES = "system/package"
TICK_S = 30.0
"""By then a job of a router has run that cuts what began on other links."""


class Undisturbed(Protocol):
    """What a command's preparation may do at the site before anything strikes."""

    def run(self, *words: str) -> "Ended": ...

    def read(self) -> "dict[str, Picture]": ...


Prepare = Callable[["Table", Undisturbed], tuple[str, ...]]
"""Set what is before and what is the target, and return the words that only this round has."""


def _nothing(_table: "Table", _site: Undisturbed) -> tuple[str, ...]:
    return ()


@dataclass(frozen=True)
class CommandKind:
    words: tuple[str, ...]
    weight: int
    """How often it is drawn."""
    states: tuple[str, ...] = STATES
    """How devices may stand at the beginning."""
    green: tuple[int, ...] = (0,)
    changes: bool = True
    hosts: tuple[str, ...] = tuple(ADDRESSES)
    """Of which it has a result."""
    settles_s: float = 0.0
    """What a device still does by itself after its green."""
    by_the_clock: bool = False
    """It holds a device's uptime against this computer's clock: no time is put forward while it runs."""
    needs_a_run: bool = False
    """It goes back to what a run has kept on this laptop: without that there is nothing to do, and a device that is so
    already has no result."""
    prepare: Prepare = _nothing


def _rollback(table: "Table", site: Undisturbed) -> tuple[str, ...]:
    """A run first, which is then taken back."""
    ended = site.run(f"site={SITE}", *AGREED, "--json")
    assert ended.code == 0, ended.output
    (run,) = json.loads(ended.out)["runs"]
    table.target, table.before = table.before, site.read()
    return (f"run={run}",)


def _restore(table: "Table", site: Undisturbed) -> tuple[str, ...]:
    """A run first, which keeps what it has confirmed; then somebody changes the router."""
    ended = site.run(f"site={SITE}", *AGREED, "--json")
    assert ended.code == 0, ended.output
    (run,) = json.loads(ended.out)["runs"]
    for edit in DRIFTS[ROUTER]:
        table.site.edit(ROUTER, *edit)
    table.before = site.read()
    return (f"run={run}",)


def _use(table: "Table", site: Undisturbed) -> tuple[str, ...]:
    """An undisturbed use first, whose routes are the target; it ends by itself, and so has the struck one to."""
    table.site.skip(SETTLED_S)
    ended = site.run(*_USE, *AGREED)
    assert ended.code == 0, ended.output
    table.site.skip(TICK_S)
    table.target, table.final = site.read(), table.before
    routes = [line for line in table.target[ROUTER].differs(table.before[ROUTER]) if " ip/route " in line]
    assert routes, "no route is another one: the link carries no traffic"
    table.site.skip(AFTER_S)
    left = site.read()[ROUTER]
    assert not left.differs(table.before[ROUTER]), left.differs(table.before[ROUTER])
    return ()


def _upgrade(table: "Table", site: Undisturbed) -> tuple[str, ...]:
    """Package files of the next version; nothing else of the router may be another afterwards."""
    version, now = NEXT_VERSION[table.plan.version], site.read()[ROUTER]
    packages = now.menus[PACKAGES] or []
    newer = {**now.menus, PACKAGES: [{**row, "version": version} for row in packages]}
    table.target = {**table.before, ROUTER: replace(now, menus=newer)}
    files = [write(table.site.folder, row["name"], version, "arm64") for row in packages]
    return (f"packages={','.join(map(str, files))}",)


def _saved_plan(table: "Table", site: Undisturbed) -> tuple[str, ...]:
    """The plan of what stands there now, in a file beside the laptop's state."""
    file = table.site.folder / "saved.plan"
    ended = site.run("plan", f"site={SITE}", "--save", str(file), "--accept-cost")
    assert ended.code in (0, 2), ended.output
    return (f"file={file}",)


COMMANDS: Mapping[str, CommandKind] = {
    "apply": CommandKind((f"site={SITE}", *AGREED), 13),
    "plan": CommandKind(("plan", f"site={SITE}", "--accept-cost"), 1, green=(0, 2), changes=False),
    "drift": CommandKind(("report", "drift", f"site={SITE}", "--accept-cost"), 1, green=(0, 6), changes=False),
    "rollback": CommandKind(
        ("recover", "rollback", f"site={SITE}", *AGREED), 2, ("drifted",), needs_a_run=True, prepare=_rollback
    ),
    "apply FILE": CommandKind(("plan", "apply", *AGREED), 3, ("adopted", "drifted", "foreign"), prepare=_saved_plan),
    "use": CommandKind((*_USE, *AGREED), 3, ("configured",), hosts=(ROUTER,), settles_s=TICK_S, prepare=_use),
    "upgrade": CommandKind(
        ("device", "upgrade", f"site={SITE}", f"device={ROUTER}", *AGREED),
        2,
        ("configured",),
        hosts=(ROUTER,),
        by_the_clock=True,
        prepare=_upgrade,
    ),
    "restore": CommandKind(
        ("device", "restore", f"device={ROUTER}", *AGREED),
        3,
        ("configured", "foreign"),
        hosts=(ROUTER,),
        needs_a_run=True,
        prepare=_restore,
    ),
}
CHANGING = {"run", "recover resume", "recover rollback", "plan apply", "device restore", "links use", "device upgrade"}
"""How commands begin that change devices, where they are not told to plan."""
