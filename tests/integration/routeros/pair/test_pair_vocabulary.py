"""Every sentence that goes to the two ends of a radio bridge is in the command tree of their version."""

from pathlib import Path

import pytest
from heard import listening
from pair_bench import PairBench, Words, on
from trees import Tree


@pytest.mark.parametrize("family", ["legacy", "wifi"])
def test_commands_for_both_ends_exist_in_the_command_tree(family: str, tmp_path: Path) -> None:
    words = Words(ssid="new name", key="a new key for both ends", frequency=5520)

    async def act(bench: PairBench) -> None:
        await bench.converge(words)
        await bench.converge(words)

    with listening() as heard:
        on(PairBench(tmp_path, family=family), act)
    tree = Tree("7.18.2")
    assert heard.unknown(tree) == {}
    menu = "/interface/wireless" if family == "legacy" else "/interface/wifi"
    assert {(menu, "set"), (f"{menu}/registration-table", "print")} <= {
        (one.menu, one.command) for one in heard.said(tree)
    }
