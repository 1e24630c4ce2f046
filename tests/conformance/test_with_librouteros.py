"""librouteros 4.2 against the emulated router."""

import pytest
from conversation import Conversation
from intent import CALLS, PINGS, RULES
from stand import Stand


@pytest.mark.smoke
class TestLibrouteros(Conversation):
    client = "librouteros_client.py"

    def test_queries_are_answered_as_it_builds_them(self, at: Stand) -> None:
        assert at.ask(self.client, do="queries") == {
            "and": PINGS,
            "or": [*["return"] * 4, "log", *["return"] * 6, "log", "log", "log"],
            "in": ["atlantis: satellite, the terminal itself", "atlantis: satellite, allow-list"],
            "none": [],
            "fields": ["action", "chain"],
            "raw": ["bridge-lan"],
            "len": RULES,
        }

    def test_it_takes_refusals_for_traps_with_their_category(self, at: Stand) -> None:
        told = at.ask(self.client, do="refused", calls=CALLS)
        assert {one[0] for one in told} == {"TrapError"}
        assert [one[1] for one in told] == [0, 0, 1, 1, 0, None, None]

    def test_both_ways_to_log_in(self, at: Stand) -> None:
        told = at.ask(self.client, do="login")
        assert told == {"wrong": "invalid user name or password (6)", "old": "coastal-router"}
