"""RouterOS-api 0.21 against the emulated router."""

import pytest
from conversation import Conversation
from intent import CALLS, PINGS, RULES
from stand import Stand


@pytest.mark.slow
class TestRouterosApi(Conversation):
    client = "routeros_api_client.py"

    def test_its_queries_return_the_expected_rows(self, at: Stand) -> None:
        expected = {"and": PINGS, "none": [], "query": ["bridge-lan"], "binary": "coastal-router", "len": RULES}
        assert at.ask(self.client, do="queries") == expected

    def test_refusals_raise_communication_error(self, at: Stand) -> None:
        told = at.ask(self.client, do="refused", calls=CALLS)
        assert {one[0] for one in told} == {"RouterOsApiCommunicationError"}

    def test_a_wrong_password(self, at: Stand) -> None:
        assert "invalid user name or password (6)" in at.ask(self.client, do="login")["wrong"]
