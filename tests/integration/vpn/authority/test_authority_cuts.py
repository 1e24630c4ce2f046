"""`kill -9`, a full disk and a broken one at every system call: the same command again ends well."""

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from authority_cuts import FAULTS, SCENARIOS, UNTOUCHED, Cut, Cutting

SAMPLED = 5
"""Cuts of each command and fault in CI; `make campaign` makes them all."""


def points(cutting: Cutting, fault: str) -> list[Cut]:
    return [cut for cut in cutting.cuts if fault == "kill" or cut.call not in UNTOUCHED]


@pytest.mark.smoke("issue-kill", "revoke-full")
@pytest.mark.parametrize(
    ("name", "fault"), [("issue", "kill"), ("renew", "kill"), ("revoke", "kill"), ("issue", "full"), ("revoke", "full")]
)
def test_sampled_interruptions_are_survived(name: str, fault: str, tmp_path: Path) -> None:
    cutting = Cutting(name, tmp_path)
    every = points(cutting, fault)
    assert len(every) > 4 * SAMPLED
    with ThreadPoolExecutor(2) as pool:
        list(pool.map(lambda cut: cutting.cut(cut, fault), every[2 :: len(every) // SAMPLED]))


@pytest.mark.campaign
@pytest.mark.parametrize("fault", FAULTS)
@pytest.mark.parametrize("name", SCENARIOS)
def test_every_interruption_is_survived(name: str, fault: str, tmp_path: Path) -> None:
    cutting = Cutting(name, tmp_path)
    failed = {}
    for cut in points(cutting, fault):
        try:
            cutting.cut(cut, fault)
        except Exception as error:  # noqa: BLE001 - all of them are told, not the first
            failed[cut] = repr(error)
    print(f"{name} {fault}: {len(points(cutting, fault))} cuts, {len(failed)} failed")  # noqa: T201 - counts, for whoever asks
    assert failed == {}
