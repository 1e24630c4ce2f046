"""Values that ansible-vault has encrypted (`!vault |`).

Without a `decrypt` callable they stay sealed: that is enough to validate an inventory, and no password is asked for.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NoReturn

from atlantis_netcfg.core.errors import UsageError
from atlantis_netcfg.core.secret import Secret

TAG = "!vault"
UNTAGGED = "!vault-encrypted"
"""The older name of the tag; Ansible reads both (ansible-core, `parsing/yaml/constructor`)."""
CLOSED = "this secret cannot be decrypted"
Decrypt = Callable[[str], str]
"""Vault text in, secret out; whatever it raises means that the text could not be decrypted."""


class VaultError(UsageError):
    """A vaulted value that is damaged or does not open."""


class SealedSecret(Secret):
    """A secret that nobody has decrypted: equal only to the same vault text, and it cannot be revealed."""

    __slots__ = ()

    def reveal(self) -> NoReturn:
        """Refuse: the value is not known here."""
        raise UsageError(
            "a secret of the inventory is still encrypted",
            hint="give the vault's password: ANSIBLE_VAULT_PASSWORD_FILE=FILE provision …, or `--ask-vault-pass`",
        )


def unseal(text: str, decrypt: Decrypt | None, *, strict: bool = True) -> Secret:
    """The secret in a vault text; sealed if there is nothing to decrypt it with.

    Raises VaultError, or the UsageError of a `decrypt` that has no password at all.
    """
    if strict and not text.startswith("$ANSIBLE_VAULT;"):
        raise VaultError("this is not a vaulted value", hint="make one: ansible-vault encrypt_string")
    if decrypt is None or not strict:
        return SealedSecret(text)
    try:
        value = decrypt(text)
    except UsageError:
        raise
    except Exception as error:
        raise VaultError(CLOSED, hint="check the vault's password: it is not the one of this value") from error
    return Secret(value.rstrip("\r\n"))
