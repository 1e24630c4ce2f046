"""RouterOS-api 0.21 against the emulated router."""

from conversation import Conversation
from intent import CALLS, PINGS, RULES
from stand import Stand


class TestRouterosApi(Conversation):
    client = "routeros_api_client.py"

    def test_queries_are_answered_as_it_builds_them(self, at: Stand) -> None:
        expected = {"and": PINGS, "none": [], "query": ["bridge-lan"], "binary": "coastal-router", "len": RULES}
        assert at.ask(self.client, do="queries") == expected

    def test_it_tells_refusals_from_broken_connections(self, at: Stand) -> None:
        told = at.ask(self.client, do="refused", calls=CALLS)
        assert {one[0] for one in told} == {"RouterOsApiCommunicationError"}

    def test_a_wrong_password(self, at: Stand) -> None:
        assert "invalid user name or password (6)" in at.ask(self.client, do="login")["wrong"]
