"""Every sentence and every line that the engine said to a twin is in the command tree of that twin's version."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import pytest
from engine_bench import TEXT, Bench, leases, on
from holes import known
from spoken import Said, lines, sentence
from trees import Tree, parts

from atlantis_netcfg.routeros import Mode
from atlantis_netcfg.routeros.desired import from_export, read
from atlantis_netcfg.routeros.menus import MENUS
from atlantis_netcfg.twin import Device

if TYPE_CHECKING:
    from collections.abc import Callable, Coroutine, Sequence
    from pathlib import Path

    from atlantis_netcfg.twin.answers import Answer, Caller

ASKED_EVERYWHERE = {"/safe-mode/print"}
"""How we learn whether a device has it."""
CHANGED = (
    TEXT.replace("1h name=lan", "2h name=lan")
    .replace('comment="atlantis: lan" in-interface=bridge-lan protocol=icmp', 'comment="atlantis: ping" protocol=icmp')
    .replace('add bridge=bridge-lan comment="atlantis: lan" interface=ether5\n', "")
    .replace("set ftp disabled=yes", "set ftp address=10.0.0.0/8 disabled=no")
)
"""The first configuration with rows changed, replaced, moved and removed."""
REFUSED = TEXT + '/interface list member\nadd comment="atlantis: nothing" interface=nowhere list=WAN\n'
"""Its last row names an interface that is not there."""


@dataclass
class Heard:
    """All that was said to twins."""

    sentences: list[list[str]] = field(default_factory=list)
    typed: list[str] = field(default_factory=list)

    def said(self, tree: Tree) -> list[Said]:
        """Return it in one form: sentences, the lines of the scripts in them, what was typed, what schedulers run."""
        found = [sentence(words) for words in self.sentences]
        for words in self.sentences:
            for word in words:
                if word.startswith(("=script=", "=on-event=", "=source=")):
                    found += lines(word.partition("=")[2].partition("=")[2], tree)
        for line in self.typed:
            found += lines(line, tree)
        return found

    def proplists(self) -> list[tuple[str, str]]:
        """Return menus and the properties that were asked for."""
        return [
            (words[0].rpartition("/")[0], name)
            for words in self.sentences
            for word in words
            if word.startswith("=.proplist=")
            for name in word.removeprefix("=.proplist=").split(",")
        ]


@pytest.fixture
def heard(monkeypatch: pytest.MonkeyPatch) -> Heard:
    everything = Heard()
    run, type_ = Device.run, Device.type

    def running(device: Device, caller: Caller, words: Sequence[str]) -> list[Answer]:
        everything.sentences.append(list(words))
        return run(device, caller, words)

    def typing(device: Device, caller: Caller, line: str, **how: Any) -> Any:  # noqa: ANN401 - as Device.type has it
        everything.typed.append(line)
        return type_(device, caller, line, **how)

    monkeypatch.setattr(Device, "run", running)
    monkeypatch.setattr(Device, "type", typing)
    return everything


async def _changes(bench: Bench) -> None:
    await bench.converge(Mode.PLAN)
    await bench.converge()
    before = bench.router.export(show_sensitive=True)
    await bench.converge(desired=read(CHANGED))
    await bench.converge(desired=from_export(before, read(TEXT).menus))
    await bench.converge()


async def _refusal(bench: Bench) -> None:
    await bench.converge(desired=read(REFUSED))
    await bench.converge(Mode.PLAN, desired=read(REFUSED))


async def _much(bench: Bench) -> None:
    await bench.converge(desired=read(TEXT + leases(150)))
    await bench.converge(desired=read(TEXT))


async def _by_sentences(bench: Bench) -> None:
    await bench.converge()
    await bench.converge(desired=read(CHANGED))


SCENES: dict[str, tuple[Callable[[Bench], Coroutine[Any, Any, None]], dict[str, Any]]] = {
    "changes": (_changes, {}),
    "refusal": (_refusal, {}),
    "much": (_much, {}),
    "no-scripts": (_by_sentences, {"execute": "none"}),
}
"""What makes the engine say everything that it can; who adds a way to speak adds a scene."""


@pytest.mark.parametrize("version", ["7.18.2", "7.21.5"])
@pytest.mark.parametrize("scene", SCENES)
def test_what_the_engine_says_is_in_the_tree(scene: str, version: str, heard: Heard, tmp_path: Path) -> None:
    act, spec = SCENES[scene]
    on(Bench(tmp_path, spec={"version": version, **spec}), act)
    tree, odd = Tree(version), {}
    said = heard.said(tree)
    for one in said:
        path = f"{one.menu.rstrip('/')}/{one.command}"
        strange = one.unknown(tree)
        if strange and path not in ASKED_EVERYWHERE and not known(one.menu, one.command):
            odd[path] = strange
    assert odd == {}
    assert len(said) > 60
    assert {"print", "add", "set"} <= {one.command for one in said}


def test_what_the_engine_asks_for_is_a_property(heard: Heard, tmp_path: Path) -> None:
    """Settable ones are in the trees; which others a menu prints is the table's word, as no tree tells."""
    on(Bench(tmp_path), _changes)
    newest = Tree("7.21.5")
    asked = {(menu, name) for menu, name in heard.proplists() if menu in MENUS}
    read_only = {
        (menu, name)
        for menu, name in asked
        if name not in (*newest.settable(menu), ".id", *MENUS[menu].flags) and not known(menu, "set", name)
    }
    gone = {
        (menu, name)
        for menu, name in read_only
        if any(name in Tree(each).settable(menu) for each in ("7.16", "7.18.2"))
    }
    assert read_only - gone == set()
    assert len(asked) > 300
    assert all(parts(menu) for menu, _ in asked)
