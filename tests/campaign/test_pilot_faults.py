"""Each single fault of the joined pilot turns exactly the expected checklist items; data flow again in time after it.

`make campaign ARGS='tests/campaign/test_pilot_faults.py --fault-records figures.jsonl'` adds a line of figures a fault.
"""

import json
import os
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from campaign import pilot_stand
from campaign.pilot_faults import FAULTS, Fault
from campaign.pilot_stand import PilotStand

SMOKE = ("coastal-wifi-ptp-cut", "scc-reflector-stopped", "coastal-data-outside")
"""What CI runs too."""

pytestmark = [
    pytest.mark.namespace,
    pytest.mark.skipif(os.geteuid() != 0, reason="making a network namespace needs root"),
]


@pytest.fixture(scope="module")
def stand(tmp_path_factory: pytest.TempPathFactory) -> Iterator[PilotStand]:
    yield from pilot_stand.module_stand(tmp_path_factory)


def test_there_are_forty_faults_with_different_names() -> None:
    assert len({fault.name for fault in FAULTS}) == len(FAULTS) >= 40


@pytest.mark.timeout(1500)
@pytest.mark.parametrize(
    "fault",
    [
        pytest.param(fault, id=fault.name, marks=pytest.mark.slow if fault.name in SMOKE else pytest.mark.campaign)
        for fault in FAULTS
    ],
)
def test_fault_turns_exactly_the_expected_items(
    stand: PilotStand, fault: Fault, request: pytest.FixtureRequest
) -> None:
    trial = stand.try_fault(fault)
    if (path := request.config.getoption("--fault-records")) is not None:
        with Path(path).open("a", encoding="utf-8") as file:
            file.write(json.dumps({"fault": fault.name, **trial.as_dict()}) + "\n")
    assert trial.turned.keys() == fault.turns.keys(), trial.turned
    assert {name: words for name, words in trial.turned.items() if not re.fullmatch(fault.turns[name], words)} == {}
    assert fault.over is None or trial.moved_s is not None
    assert trial.back_s is not None
    assert trial.left == {}
