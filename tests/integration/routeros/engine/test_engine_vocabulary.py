"""Every sentence and every line that the engine says to a twin is in the command tree of that twin's version."""

from collections.abc import Callable, Coroutine
from pathlib import Path
from typing import Any

import pytest
from engine_bench import TEXT, Bench, leases, on
from heard import listening
from holes import known
from trees import Tree

from atlantis_netcfg.routeros import JobMode
from atlantis_netcfg.routeros.desired import from_export, read
from atlantis_netcfg.routeros.menus import MENUS

CHANGED = (
    TEXT.replace("1h name=lan", "2h name=lan")
    .replace('comment="atlantis: lan" in-interface=bridge-lan protocol=icmp', 'comment="atlantis: ping" protocol=icmp')
    .replace('add bridge=bridge-lan comment="atlantis: lan" interface=ether5\n', "")
    .replace("set ftp disabled=yes", "set ftp address=10.0.0.0/8 disabled=no")
)
"""The first configuration with rows changed, replaced, moved and removed."""
REFUSED = TEXT + '/interface list member\nadd comment="atlantis: nothing" interface=nowhere list=WAN\n'
"""Its last row names an interface that is not there."""


async def _changes(bench: Bench) -> None:
    ssh = bench.ssh
    await bench.converge(JobMode.PLAN, ssh=ssh)
    await bench.converge(ssh=ssh)
    before = bench.router.export(show_sensitive=True)
    await bench.converge(desired_state=read(CHANGED), ssh=ssh)
    await bench.converge(desired_state=from_export(before, read(TEXT).menus), ssh=ssh)
    await bench.converge(ssh=ssh)


async def _refusal(bench: Bench) -> None:
    await bench.converge(desired_state=read(REFUSED), ssh=bench.ssh)
    await bench.converge(JobMode.PLAN, desired_state=read(REFUSED), ssh=bench.ssh)


async def _much(bench: Bench) -> None:
    await bench.converge(desired_state=read(TEXT + leases(150)), ssh=bench.ssh)
    await bench.converge(desired_state=read(TEXT), ssh=bench.ssh)


async def _without_console(bench: Bench) -> None:
    await bench.converge()
    await bench.converge(desired_state=read(CHANGED))


SCENES: dict[str, tuple[Callable[[Bench], Coroutine[Any, Any, None]], dict[str, Any]]] = {
    "changes": (_changes, {}),
    "refusal": (_refusal, {}),
    "much": (_much, {}),
    "no-scripts": (_changes, {"execute": "none"}),
    "no-console": (_without_console, {}),
}
"""What makes the engine say everything that it can; who adds a way to speak adds a scene."""


@pytest.mark.smoke("changes-7.18.2", "refusal-7.16", "much-7.18.2", "no-scripts-7.18.2", "no-console-7.16")
@pytest.mark.parametrize("version", ["7.16", "7.18.2", "7.21.5"])
@pytest.mark.parametrize("scene", SCENES)
def test_commands_of_the_engine_exist_in_the_command_tree(scene: str, version: str, tmp_path: Path) -> None:
    act, spec = SCENES[scene]
    with listening() as heard:
        on(Bench(tmp_path, spec={"version": version, **spec}), act)
    tree = Tree(version)
    assert heard.unknown(tree) == {}
    said = heard.said(tree)
    assert len(said) > 60
    assert {"print", "add", "set"} <= {one.command for one in said}
    assert bool(heard.typed) == (version == "7.16") or scene != "changes"


def test_properties_read_by_the_engine_exist(tmp_path: Path) -> None:
    """Settable ones are in the trees; which others a menu prints is the table's word, as no tree tells."""
    with listening() as heard:
        on(Bench(tmp_path), _changes)
    newest = Tree("7.24")
    asked = {(menu, name) for menu, name in heard.proplists() if menu in MENUS}
    read_only = {
        (menu, name)
        for menu, name in asked
        if name not in (*newest.settable(menu), ".id", *MENUS[menu].flags) and not known(menu, "set", name)
    }
    gone = {
        (menu, name)
        for menu, name in read_only
        if any(name in Tree(each).settable(menu) for each in ("7.16", "7.18.2", "7.21.5"))
    }
    assert read_only - gone == set()
    assert len(asked) > 300
