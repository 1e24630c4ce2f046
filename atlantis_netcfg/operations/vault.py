"""Opening vaulted values where no play of Ansible's runs: with the passwords that Ansible itself would use."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING

from atlantis_netcfg import paths
from atlantis_netcfg.errors import UsageError

if TYPE_CHECKING:
    from atlantis_netcfg.site import Decrypt

__all__ = ["decrypter"]


def decrypter() -> Decrypt:
    """Decrypt with the password files of `ANSIBLE_VAULT_PASSWORD_FILE`, `ANSIBLE_VAULT_IDENTITY_LIST`, or ansible.cfg.

    Nothing is read before the first vaulted value. The callable raises UsageError without a password.
    """
    opened: list[object] = []

    def decrypt(text: str) -> str:
        if not opened:
            opened.append(_vault())
        (vault,) = opened
        return str(vault.decrypt(text.encode()).decode())  # type: ignore[attr-defined] # ansible ships no types

    return decrypt


def _vault() -> object:
    os.environ.setdefault("ANSIBLE_CONFIG", str(paths.checkout() / "ansible.cfg"))
    # ansible reads its configuration when it is imported: most commands need neither.
    from ansible import constants  # noqa: PLC0415
    from ansible.parsing.dataloader import DataLoader  # noqa: PLC0415
    from ansible.parsing.vault import VaultLib, get_file_vault_secret  # noqa: PLC0415

    named = [*constants.DEFAULT_VAULT_IDENTITY_LIST, constants.DEFAULT_VAULT_PASSWORD_FILE]
    secrets = []
    for one in filter(None, named):
        label, _, file = one.rpartition("@")
        secret = get_file_vault_secret(filename=file, vault_id=label or "default", loader=DataLoader())
        secret.load()
        secrets.append((label or "default", secret))
    if not secrets:
        raise UsageError(
            "a secret of the inventory is encrypted, and there is no password for it",
            hint="give the vault's password: ANSIBLE_VAULT_PASSWORD_FILE=FILE provision …",
        )
    return VaultLib(secrets)
