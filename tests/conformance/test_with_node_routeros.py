"""node-routeros 1.6 against an emulated router of before 7.18: it does not survive `!empty`."""

from pathlib import Path

import pytest
from conversation import Conversation
from stand import PRESENT, Stand, stand


class TestNodeRouteros(Conversation):
    client = "node_routeros_client.js"
    version = "7.17"
    provisioned = False

    def test_a_wrong_password(self, at: Stand) -> None:
        assert at.ask(self.client, do="login") == {"wrong": "Username or password is invalid"}

    def test_a_print_without_rows(self, at: Stand) -> None:
        assert at.ask(self.client, do="nothing") == {"rows": []}


@PRESENT
@pytest.mark.slow
def test_empty_print_raises_an_exception_from_7_18(tmp_path: Path) -> None:
    """The router's doing, not the twin's: from that version it says `!empty` (Manual, API)."""
    with stand(tmp_path, version="7.18.2") as at:
        told = at.ask("node_routeros_client.js", do="nothing")
    assert told == {"failed": "RosException: Tried to process unknown reply: !empty"}
