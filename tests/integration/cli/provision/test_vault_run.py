"""An inventory with vaulted secrets, whose password is typed, missing or wrong."""

import os
import re
import subprocess
from collections.abc import Sequence
from pathlib import Path

import pytest
from quay import _VAULT_PASSWORD, PROVISION, ROUTER, _inventory, quay

pytestmark = pytest.mark.slow

QUESTION = b"Password of the inventory vault: "
COMMANDS = (
    ("plan", "site=coastal"),
    ("report", "drift", "site=coastal", f"device={ROUTER}", "--rehearse"),
    ("links", "site=coastal"),
    ("device", "adopt", "site=coastal", f"device={ROUTER}", "--plan"),
    ("check", "site=coastal"),
)


def typed(
    inventory: Path, words: Sequence[str], keyboard: str | None = None, **variables: str
) -> subprocess.CompletedProcess[str]:
    """Type a command, at a terminal of its own where there is a keyboard; no password of the vault is configured."""
    base = inventory.parent
    (base / "tmp").mkdir(exist_ok=True)
    environment = {name: value for name, value in os.environ.items() if not name.startswith("ANSIBLE_VAULT")}
    environment |= {"ATLANTIS_STATE": str(base / "state"), "TMPDIR": str(base / "tmp"), **variables}
    ours, theirs = os.openpty()
    with (
        os.fdopen(ours, "wb", buffering=0) as terminal,
        os.fdopen(theirs, "rb", buffering=0) as stdin,
        subprocess.Popen(
            [PROVISION, *words, f"inventory={inventory}"],
            env=environment,
            stdin=subprocess.DEVNULL if keyboard is None else stdin,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            start_new_session=True,  # no other terminal than this one
        ) as process,
    ):
        assert process.stderr is not None
        asked = b""
        # What is typed before the question is thrown away.
        while keyboard is not None and not asked.endswith(QUESTION) and (more := process.stderr.read(1)):
            asked += more
        if keyboard is not None:
            terminal.write(f"{keyboard}\n".encode())
        out, err = process.communicate()
    return subprocess.CompletedProcess(words, process.returncode, out.decode(), (asked + err).decode())


@pytest.mark.parametrize("words", COMMANDS, ids=[words[0] for words in COMMANDS])
def test_missing_vault_password_gives_one_error_with_the_options(tmp_path: Path, words: tuple[str, ...]) -> None:
    done = typed(_inventory(tmp_path), words)
    assert (done.returncode, done.stdout) == (3, "")
    assert done.stderr.splitlines() == [
        "error: secrets of the inventory are encrypted, and there is no password for them",
        "       name the file that holds it: ANSIBLE_VAULT_PASSWORD_FILE=FILE provision …",
        "       or type it: the same command with `--ask-vault-pass`, on a terminal",
    ]


def test_wrong_vault_password_is_reported_once_with_the_first_value(tmp_path: Path) -> None:
    inventory = _inventory(tmp_path)
    (tmp_path / "wrong").write_text("not this")
    file = {"ANSIBLE_VAULT_PASSWORD_FILE": str(tmp_path / "wrong")}
    for done in (typed(inventory, COMMANDS[0], **file), typed(inventory, COMMANDS[0], "not this")):
        assert done.returncode == 3
        assert done.stderr.count("error:") == 1
        told = re.search(
            r"(\S+):(\d+):\d+: this secret cannot be decrypted, nor (\d+) more of the inventory", done.stderr
        )
        assert told is not None, done.stderr
        line = (tmp_path / told[1]).read_text("utf-8").splitlines()[int(told[2]) - 1]
        assert "!vault" in line
        assert int(told[3]) > 5


def test_vault_password_can_be_typed_for_a_rehearsal(tmp_path: Path) -> None:
    done = typed(_inventory(tmp_path), COMMANDS[1], _VAULT_PASSWORD.decode())
    assert done.returncode == 6, done.stderr
    assert done.stderr.count(QUESTION.decode()) == 1
    _left_nowhere(tmp_path, done)


@pytest.mark.smoke
@pytest.mark.namespace
def test_typed_vault_password_is_used_in_the_run(tmp_path: Path) -> None:
    with quay(tmp_path) as at:
        done = typed(at.inventory, ("plan", "site=coastal", f"device={ROUTER}"), _VAULT_PASSWORD.decode())
        assert done.returncode == 2, done.stderr
        assert done.stderr.count(QUESTION.decode()) == 1
        _left_nowhere(tmp_path, done)


def _left_nowhere(folder: Path, done: subprocess.CompletedProcess[str]) -> None:
    password = _VAULT_PASSWORD
    assert password.decode() not in done.stdout + done.stderr
    places = (folder / "state", folder / "tmp")
    kept = [path for place in places for path in place.rglob("*") if path.is_file()]
    assert [path for path in kept if password in path.read_bytes()] == []
