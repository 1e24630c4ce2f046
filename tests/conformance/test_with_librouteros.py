"""librouteros 4.2 against the emulated router."""

import pytest
from conversation import Conversation
from intent import CALLS, PINGS, RULES
from stand import Stand


@pytest.mark.smoke
class TestLibrouteros(Conversation):
    client = "librouteros_client.py"

    def test_its_queries_return_the_expected_rows(self, at: Stand) -> None:
        assert at.ask(self.client, do="queries") == {
            "and": PINGS,
            "or": [*["return"] * 4, "log", *["return"] * 6, "log", "log", "log"],
            "in": ["atlantis: satellite, the terminal itself", "atlantis: satellite, allow-list"],
            "none": [],
            "fields": ["action", "chain"],
            "raw": ["bridge-lan"],
            "len": RULES,
        }

    def test_refusals_raise_trap_error_with_category(self, at: Stand) -> None:
        told = at.ask(self.client, do="refused", calls=CALLS)
        assert {one[0] for one in told} == {"TrapError"}
        assert [one[1] for one in told] == [0, 0, 1, 1, 0, None, None]

    def test_new_and_old_login_method(self, at: Stand) -> None:
        told = at.ask(self.client, do="login")
        assert told == {"wrong": "invalid user name or password (6)", "old": "coastal-router"}
