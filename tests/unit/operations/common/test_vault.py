"""The passwords of the inventory's vault: where they are looked for, when they are typed, how Ansible gets them."""

import sys
from pathlib import Path

import pytest
from ansible import constants
from ansible.parsing.vault import VaultLib, VaultSecret

from atlantis_netcfg.cli.base import passphrase
from atlantis_netcfg.cli.base.passphrase import vault_of
from atlantis_netcfg.cli.base.syntax import ASK_VAULT_PASS, JSON, Arguments, CommandSpec
from atlantis_netcfg.core.errors import UsageError
from atlantis_netcfg.core.secret import Secret
from atlantis_netcfg.operations.common.vault import Vault

PASSWORD = "the word of the quay"
SEALED = VaultLib([("default", VaultSecret(PASSWORD.encode()))]).encrypt(b"open").decode()


@pytest.fixture
def named(monkeypatch: pytest.MonkeyPatch) -> pytest.MonkeyPatch:
    """No password is configured; Ansible reads its configuration once a process."""
    monkeypatch.setattr(constants, "DEFAULT_VAULT_PASSWORD_FILE", None)
    monkeypatch.setattr(constants, "DEFAULT_VAULT_IDENTITY_LIST", [])
    return monkeypatch


class Person:
    """Types the same whenever something is asked."""

    def __init__(self, text: str = PASSWORD) -> None:
        self.text = text
        self.questions: list[str] = []

    def __call__(self, vault_id: str) -> Secret:
        self.questions.append(vault_id)
        return Secret(self.text)


def file(folder: Path, text: str = f"{PASSWORD}\n") -> str:
    path = folder / "vault-password"
    path.write_text(text)
    return str(path)


def test_password_file_is_used_without_a_prompt(named: pytest.MonkeyPatch, tmp_path: Path) -> None:
    named.setattr(constants, "DEFAULT_VAULT_PASSWORD_FILE", file(tmp_path))
    person = Person()
    vault = Vault(person)
    assert (vault.decrypt(SEALED), person.questions) == ("open", [])
    assert [label for label, _ in vault.known_secrets] == ["default"]
    assert sorted(path.name for path in tmp_path.iterdir()) == ["vault-password"]


def test_without_a_file_the_password_is_asked_once(named: pytest.MonkeyPatch) -> None:
    del named
    person = Person(f" {PASSWORD} ")
    vault = Vault(person)
    assert [vault.decrypt(SEALED) for _ in range(3)] == ["open"] * 3
    assert person.questions == ["default"]
    ((label, secret),) = vault.secrets
    assert (label, secret.bytes) == ("default", PASSWORD.encode())
    assert PASSWORD not in repr(vault)


def test_nothing_is_asked_before_the_first_encrypted_value(named: pytest.MonkeyPatch) -> None:
    del named
    person = Person()
    assert (Vault(person).known_secrets, person.questions) == ([], [])


def test_prompt_can_be_forced_despite_a_file(named: pytest.MonkeyPatch, tmp_path: Path) -> None:
    named.setattr(constants, "DEFAULT_VAULT_PASSWORD_FILE", file(tmp_path, "another"))
    person = Person()
    assert Vault(person, insist=True).decrypt(SEALED) == "open"
    assert person.questions == ["default"]


def test_prompt_identity_is_asked_for(named: pytest.MonkeyPatch) -> None:
    named.setattr(constants, "DEFAULT_VAULT_IDENTITY_LIST", ["quay@prompt"])
    person = Person()
    assert (Vault(person).decrypt(SEALED), person.questions) == ("open", ["quay"])


def test_without_a_prompt_the_error_explains_how(named: pytest.MonkeyPatch) -> None:
    del named
    with pytest.raises(UsageError, match="encrypted, and there is no password") as told:
        _ = Vault().secrets
    assert told.value.hint is not None
    assert "ANSIBLE_VAULT_PASSWORD_FILE=FILE" in told.value.hint
    assert "--ask-vault-pass" in told.value.hint


@pytest.mark.parametrize("text", [None, ""])
def test_missing_or_empty_password_file_is_reported(
    named: pytest.MonkeyPatch, tmp_path: Path, text: str | None
) -> None:
    path = str(tmp_path / "missing") if text is None else file(tmp_path, text)
    named.setattr(constants, "DEFAULT_VAULT_PASSWORD_FILE", path)
    with pytest.raises(UsageError, match=path):
        _ = Vault().secrets


def arguments(*flags: str) -> Arguments:
    return Arguments(CommandSpec("run", "", flags=(ASK_VAULT_PASS, JSON)), {}, dict.fromkeys(flags))


@pytest.mark.parametrize(
    ("flags", "terminal", "asks"),
    [((), True, True), ((), False, False), (("json",), True, False), (("json", "ask-vault-pass"), True, True)],
)
def test_password_prompt_needs_a_terminal_or_an_explicit_flag(
    named: pytest.MonkeyPatch, *, flags: tuple[str, ...], terminal: bool, asks: bool
) -> None:
    named.setattr(sys.stdin, "isatty", lambda: terminal)
    named.setattr(passphrase, "_read_secret", lambda *_: Secret(PASSWORD))
    vault = vault_of(arguments(*flags))
    if asks:
        assert vault.decrypt(SEALED) == "open"
    else:
        with pytest.raises(UsageError, match="there is no password"):
            vault.decrypt(SEALED)


def test_required_password_without_a_terminal_is_refused(named: pytest.MonkeyPatch) -> None:
    named.setattr(sys.stdin, "isatty", lambda: False)
    with pytest.raises(UsageError, match="the vault password is needed, and there is no terminal to type it"):
        vault_of(arguments("ask-vault-pass"))
