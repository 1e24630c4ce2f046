"""Several people onboard, renew and revoke at the same moment, each in a process of their own."""

import json
from contextlib import ExitStack
from pathlib import Path

import authority_witness as witness
import pytest
from authority_child import child, place, run

from atlantis_netcfg.vpn.authority.authority import Authority

SIX = ("issue b c d", "issue d e", "issue f", "renew iqua-a", "revoke iqua-gone", "publish")
WHOLE = {"a": 2, "gone": 0, "b": 1, "c": 1, "d": 1, "e": 1, "f": 1}


def six_at_once(work: Path) -> None:
    work.mkdir()
    folder = place(work).folder
    run(work, "issue a gone")
    with ExitStack() as open_:
        children = [open_.enter_context(child(work, command)) for command in SIX]
        for one in children:
            one.go()
        ended = [one.wait() for one in children]
    assert [code for code, _ in ended] == [0] * len(SIX), ended
    assert {name: len(some) for name, some in witness.admitted(folder).items()} == {
        f"iqua-{name}": count for name, count in WHOLE.items()
    }
    witness.nothing_outside_the_record(folder)
    witness.private_and_clean(folder)
    assert Authority.open(folder).check() == []
    lines = (folder / "ledger.jsonl").read_text().splitlines()
    assert [json.loads(line)["line"] for line in lines] == list(range(1, len(lines) + 1))
    kinds = [record["kind"] for record in witness.records(folder)]
    assert kinds.count("begun") == kinds.count("committed")
    numbers = [record["number"] for record in witness.records(folder) if record["kind"] == "published"]
    assert numbers == sorted(set(numbers))


def test_six_concurrent_operations_succeed(tmp_path: Path) -> None:
    six_at_once(tmp_path / "work")


@pytest.mark.campaign
def test_six_concurrent_operations_succeed_repeatedly(tmp_path: Path) -> None:
    for number in range(1000):
        six_at_once(tmp_path / str(number))
