"""Module `clock`: a clock that is years off is set, one that follows a better one never is."""

from dataclasses import dataclass, field

import pytest

from atlantis_netcfg.ansible_collections.atlantis.netcfg.plugins.module_utils.errors import ModuleError
from atlantis_netcfg.ansible_collections.atlantis.netcfg.plugins.module_utils.programs import ProgramResult
from atlantis_netcfg.ansible_collections.atlantis.netcfg.plugins.modules.clock import Clock

NOW = 1_795_000_000.0  # 2026-11-18
DAY_S = 86400


@dataclass
class Board:
    now: float
    follows: bool = False
    frozen: bool = False
    ran: list[str] = field(default_factory=list)

    def clock(self, *, check: bool = False) -> Clock:
        return Clock(check=check, read=lambda: self.now, write=self.write, run=self.run)

    def write(self, now: float) -> None:
        if self.frozen:
            raise PermissionError(1, "Operation not permitted")
        self.now = now

    def run(self, argv: list[str]) -> ProgramResult:
        self.ran.append(argv[0])
        return ProgramResult(0, "yes\n" if argv[0] == "timedatectl" and self.follows else "no\n")


@pytest.mark.parametrize(
    ("off_s", "told"),
    [
        (-3650 * DAY_S, "clock set: it was 3650 days behind (2016-11-20 11:06 UTC)"),
        (3650 * DAY_S, "clock set: it was 3650 days ahead (2036-11-15 11:06 UTC)"),
        (-301, "clock set: it was 301 s behind (2026-11-18 11:01 UTC)"),
        (299, None),
        (0, None),
    ],
)
def test_a_clock_that_is_far_off_is_set_once(off_s: float, told: str | None) -> None:
    board = Board(NOW + off_s)
    wanted = [told] if told else []
    looking = board.clock(check=True)
    looking.converge(NOW)
    assert (looking.changes, board.now) == (wanted, NOW + off_s)
    first, second = board.clock(), board.clock()
    first.converge(NOW)
    second.converge(NOW + 5)
    assert (first.changes, second.changes) == (wanted, [])
    assert abs(board.now - NOW) <= 300


def test_synchronised_clock_is_not_set_and_difference_is_reported() -> None:
    board = Board(NOW - 7200, follows=True)
    clock = board.clock()
    clock.converge(NOW)
    assert (clock.changes, board.now) == ([], NOW - 7200)
    assert clock.notes == [
        "its clock is 7200 s behind of your computer's and follows a time server: check your computer's clock"
    ]


def test_clock_that_cannot_be_set_is_a_failure_with_a_hint() -> None:
    board = Board(NOW - 3650 * DAY_S, frozen=True)
    with pytest.raises(
        ModuleError, match="is 3650 days behind, and cannot be set here: Operation not permitted"
    ) as caught:
        board.clock().converge(NOW)
    assert "CAP_SYS_TIME" in caught.value.hint


def test_wrong_clock_of_the_laptop_sets_nothing() -> None:
    board = Board(NOW)
    with pytest.raises(ModuleError, match=r"this laptop's clock is wrong .1970-01-01 00:20 UTC"):
        board.clock().converge(1200)
    assert board.now == NOW
