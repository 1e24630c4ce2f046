"""mikronode 2.3 against an emulated router of before 7.18: it does not know `!empty`, and waits for ever."""

from pathlib import Path

import pytest
from conversation import Conversation
from stand import PRESENT, Stand, stand


class TestMikronode(Conversation):
    client = "mikronode_client.js"
    version = "7.17"
    provisioned = False

    def test_wrong_password_with_the_login_method_before_6_43(self, at: Stand) -> None:
        assert at.ask(self.client, do="login") == {"wrong": "cannot log in"}

    def test_a_print_without_rows(self, at: Stand) -> None:
        assert at.ask(self.client, do="nothing") == {"rows": []}


@PRESENT
@pytest.mark.slow
def test_empty_print_never_returns_from_7_18(tmp_path: Path) -> None:
    """The router's doing, not the twin's: from that version it says `!empty` (Manual, API)."""
    with stand(tmp_path, version="7.18.2") as at:
        told = at.ask("mikronode_client.js", do="nothing")
    assert any("Error processing sentence" in line for line in told["failed"]), told
