"""The passwords of the inventory's vault: those that Ansible itself would use, else what a person types once.

Our loader and Ansible need the same ones: `Vault.secrets` is what both take (`DataLoader.set_vault_secrets`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from atlantis_netcfg.core.errors import UsageError
from atlantis_netcfg.operations.ansible_settings import import_ansible

if TYPE_CHECKING:
    from collections.abc import Callable

    from atlantis_netcfg.core.secret import Secret

_PROMPTS = frozenset({"prompt", "prompt_ask_vault_pass"})
"""In place of a file: Ansible's words for an identity whose password is typed."""


class Vault:
    """Opens vaulted values. Nothing is read and nobody is asked before the first of them."""

    def __init__(self, ask: Callable[[str], Secret] | None = None, *, insist: bool = False) -> None:
        """`ask` has the password of a vault id typed; `insist`: also where a file is named."""
        self._ask = ask
        self._insist = insist
        self._secrets: list[tuple[str, Any]] | None = None

    @property
    def secrets(self) -> list[tuple[str, Any]]:
        """Vault id and `VaultSecret`, as Ansible's classes take them. Raises UsageError without any."""
        if self._secrets is None:
            self._secrets = self._found()
        return self._secrets

    def decrypt(self, text: str) -> str:
        """Open one value. Raises UsageError without a password, and whatever Ansible raises for a wrong one."""
        import_ansible()
        from ansible.parsing.vault import VaultLib  # noqa: PLC0415 - most inventories of a rehearsal need no vault

        return str(VaultLib(self.secrets).decrypt(text.encode()).decode())

    @property
    def opened(self) -> list[tuple[str, Any]]:
        """The same without asking anybody: empty where no value of the inventory needed them."""
        return self._secrets or []

    def _found(self) -> list[tuple[str, Any]]:
        import_ansible()
        # ansible reads its configuration when it is imported: most commands need neither.
        from ansible import constants  # noqa: PLC0415

        found = []
        for item in filter(None, [*constants.DEFAULT_VAULT_IDENTITY_LIST, constants.DEFAULT_VAULT_PASSWORD_FILE]):
            label, _, file = item.rpartition("@")
            label = label or "default"
            found.append((label, self._prompt(label) if file in _PROMPTS else _of_file(label, file)))
        if self._insist or not found:
            found.append(("default", self._prompt("default")))
        return found

    def _prompt(self, label: str) -> object:
        from ansible.parsing.vault import VaultSecret  # noqa: PLC0415 - as above

        if self._ask is None:
            raise UsageError(
                "secrets of the inventory are encrypted, and there is no password for them",
                hint="name the file that holds it: ANSIBLE_VAULT_PASSWORD_FILE=FILE provision …\n"
                "or type it: the same command with `--ask-vault-pass`, on a terminal",
            )
        return VaultSecret(self._ask(label).reveal().strip().encode())


def _of_file(label: str, file: str) -> object:
    """Read a password file, or run one that is a program. Raises UsageError."""
    from ansible.errors import AnsibleError  # noqa: PLC0415 - as above
    from ansible.parsing.dataloader import DataLoader  # noqa: PLC0415
    from ansible.parsing.vault import get_file_vault_secret  # noqa: PLC0415

    try:
        secret = get_file_vault_secret(filename=file, vault_id=label, loader=DataLoader())
        secret.load()
    except (AnsibleError, OSError) as error:
        raise UsageError(
            f"the vault's password cannot be read from {file}: {error}",
            hint="put the password into that file, or name another: ANSIBLE_VAULT_PASSWORD_FILE=FILE provision …",
        ) from error
    return secret
