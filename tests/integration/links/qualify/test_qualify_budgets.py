"""A budget is never exceeded by more than one packet, as the kernel counts at the sender's interface."""

import json
import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from decimal import Decimal
from itertools import chain
from pathlib import Path

import pytest
from budget_stand import LARGEST, TARIFF, Outcome

from atlantis_netcfg.links.cost import bill

sys.path.insert(0, str(Path(__file__).parents[3] / "unit" / "links" / "qualify"))

from tolerances import tolerances

pytestmark = pytest.mark.skipif(os.geteuid() != 0, reason="making a network namespace needs root")
STAND = Path(__file__).with_name("budget_stand.py")
_LATE_S = 0.5
"""A busy machine wakes the sender late; the seconds themselves are exact on the simulated clock of the unit test."""


def _outcomes(seeds: range) -> list[Outcome]:
    """Runs in a network of their own."""
    command = ["unshare", "--net", sys.executable, "-P", str(STAND), str(seeds.start), str(seeds.stop)]
    ended = subprocess.run(command, capture_output=True, text=True, check=False)
    assert ended.returncode == 0, ended.stderr
    found = [Outcome(**json.loads(line)) for line in ended.stdout.splitlines()]
    assert [outcome.seed for outcome in found] == list(seeds)
    return found


def _excess(outcome: Outcome) -> list[str]:
    """How a run has exceeded its budget."""
    slack = round(tolerances()["budget_packets"] * LARGEST)
    dearer = bill(slack, 0, TARIFF).price
    assert dearer is not None
    found = []
    if outcome.max_bytes is not None and outcome.used > outcome.max_bytes + slack:
        found.append(f"seed {outcome.seed}: {outcome.used} bytes of {outcome.max_bytes}")
    if outcome.max_price is not None and Decimal(outcome.price) > Decimal(outcome.max_price) + dearer:
        found.append(f"seed {outcome.seed}: {outcome.price} of {outcome.max_price}")
    if outcome.max_seconds is not None and outcome.seconds > outcome.max_seconds + _LATE_S:
        found.append(f"seed {outcome.seed}: {outcome.seconds} s of {outcome.max_seconds}")
    return found


def _judge(outcomes: list[Outcome]) -> None:
    assert list(chain.from_iterable(map(_excess, outcomes))) == []
    # What the sender has counted has passed, and was not counted twice.
    assert [outcome.seed for outcome in outcomes if outcome.guard > outcome.used] == []
    assert {"bytes", "seconds", "money", "done"} <= {outcome.reason for outcome in outcomes}
    assert sum(outcome.copies for outcome in outcomes) > 10, "the links of these seeds double nothing"
    assert sum(outcome.lost for outcome in outcomes) > 10, "and lose nothing"


@pytest.mark.slow
def test_sample_of_budgets_is_kept_by_interface_counters() -> None:
    with ThreadPoolExecutor(2) as pool:
        _judge([*chain.from_iterable(pool.map(_outcomes, (range(10), range(10, 20))))])


@pytest.mark.campaign
@pytest.mark.parametrize("block", range(10))
def test_thousand_budgets_are_kept_by_interface_counters(block: int) -> None:
    _judge(_outcomes(range(block * 100, block * 100 + 100)))
