"""`provision inventory doctor` and the password of the vault: missing, wrong, typed; no secret is shown."""

import json
from pathlib import Path

import pytest
from quay import _VAULT_PASSWORD, _inventory
from test_vault_run import QUESTION, _left_nowhere, typed

pytestmark = pytest.mark.slow


@pytest.mark.parametrize(
    ("keyboard", "flags", "verdict", "measured"),
    [
        (
            None,
            ("--json",),
            "INCONCLUSIVE",
            "secrets of the inventory are encrypted, and there is no password for them",
        ),
        ("not this", ("--json", "--ask-vault-pass"), "FAIL", "this secret cannot be decrypted, nor "),
        (_VAULT_PASSWORD.decode(), ("--json", "--ask-vault-pass"), "PASS", "the password decrypts all "),
    ],
    ids=["missing", "wrong", "right"],
)
def test_vault_password_verdict(
    tmp_path: Path, keyboard: str | None, flags: tuple[str, ...], verdict: str, measured: str
) -> None:
    done = typed(_inventory(tmp_path), ("inventory", "doctor", *flags), keyboard)
    document = json.loads(done.stdout)
    (item,) = [item for item in document["items"] if item["name"] == "vault"]
    assert item["verdict"] == verdict
    assert measured in item["measured"]
    assert document["exit"] == done.returncode == 6, "the gateways' SSH keys are nobody's here"
    _left_nowhere(tmp_path, done)
    assert "a-real-" not in done.stdout + done.stderr


def test_vault_password_is_requested_once_on_a_terminal(tmp_path: Path) -> None:
    done = typed(_inventory(tmp_path), ("inventory", "doctor"), _VAULT_PASSWORD.decode())
    assert "  PASS vault               the password decrypts all " in done.stdout
    assert done.stderr.count(QUESTION.decode()) == 1
    _left_nowhere(tmp_path, done)
