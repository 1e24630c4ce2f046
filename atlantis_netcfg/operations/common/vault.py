"""Passwords of the inventory's vault, and the settings with which Ansible is imported.

The passwords are those that Ansible itself would use, else what a person types once. All code that modifies Ansible
to save time is here as well.
"""

from __future__ import annotations

import atexit
import hashlib
import json
import locale
import os
import sys
from contextlib import ExitStack, suppress
from functools import cache
from importlib import import_module
from typing import TYPE_CHECKING, Any

from atlantis_netcfg.core import paths, temporary
from atlantis_netcfg.core.errors import UsageError
from atlantis_netcfg.core.messages import arg
from atlantis_netcfg.runs import write_atomically

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from atlantis_netcfg.core.secret import Secret


_USED = {"connection_loader": ("local", "ssh"), "shell_loader": ("sh",), "become_loader": ("sudo",)}
"""Ansible plugins that runs use, by the executor's names of their loaders."""
_LARGE = 50_000
"""Collection metadata above this number of bytes is cached; that of Ansible's own collection has 400,000."""


def _speak_utf8() -> None:
    """Set a UTF-8 locale if the current one is not (`LC_ALL=C`): otherwise Ansible ends the process.

    Python itself uses UTF-8 there; started programs inherit the locale.
    """
    try:
        locale.setlocale(locale.LC_ALL, "")
        encoding = locale.getlocale()[1] or ""
    except locale.Error:
        encoding = ""
    if encoding.lower() not in {"utf-8", "utf8"}:
        os.environ["LC_ALL"] = "C.UTF-8"


@cache
def import_ansible() -> None:
    """Import Ansible with the toolkit's settings, once per process; child processes do not inherit them.

    The folder for its temporary files is removed when the process ends.
    """
    _speak_utf8()
    stack = ExitStack()
    atexit.register(stack.close)
    ours = {
        "ANSIBLE_CONFIG": str(paths.resource("ansible.cfg")),
        "ANSIBLE_COLLECTIONS_PATH": str(paths.collections()),
        "ANSIBLE_LOCAL_TEMP": str(stack.enter_context(temporary.folder("run"))),
        "ANSIBLE_NOCOLOR": "1",
        # An inventory need not have every group of the playbook; whom a run is for was chosen before.
        "ANSIBLE_HOST_PATTERN_MISMATCH": "ignore",
        "ANSIBLE_STDOUT_CALLBACK": "atlantis.netcfg.events",
    }
    before = {name: os.environ.get(name) for name in ours}
    os.environ.update(ours)
    try:
        import_module("ansible.constants")
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value
    _leave_out_paramiko()
    _keep_metadata()


def load_used_plugins() -> None:
    """Preload the plugins that runs use before the first task; Ansible would load all plugins of their kinds.

    Tasks run in separate processes, where loading would cost more. Any other plugin is loaded by the task that needs
    it.
    """
    executor: Any = import_module("ansible.executor.playbook_executor")
    loaders: Any = import_module("ansible.plugins.loader")
    for kind, names in _USED.items():
        setattr(executor, kind, _Loader(getattr(loaders, kind), names))


class _Loader:
    """A replacement for a plugin loader that loads only the plugins in use."""

    def __init__(self, loader: Any, names: Sequence[str]) -> None:  # noqa: ANN401 - Ansible's; it has no types
        self._loader, self._names = loader, names

    def all(self, *, class_only: bool) -> list[object]:
        return [self._loader.get(name, class_only=class_only) for name in self._names]


def _leave_out_paramiko() -> None:
    """Prevent Ansible from importing paramiko, which it treats as optional and which is not used here."""
    if "paramiko" in sys.modules:
        return
    sys.modules["paramiko"] = None  # type: ignore[assignment]  # what Python documents for "not to be imported"
    try:
        import_module("ansible.module_utils.compat.paramiko")
    finally:
        del sys.modules["paramiko"]


def _keep_metadata() -> None:
    """Cache the metadata of Ansible's own collection as JSON: parsing its YAML took 5 % of a run without changes.

    Ansible's `_meta_yml_to_dict` documents that it may be replaced and its result cached.
    """
    finder: Any = import_module("ansible.utils.collection_loader._collection_finder")
    parse = finder._meta_yml_to_dict  # noqa: SLF001 - as above

    def parse_with_cache(text: bytes | str, content: object) -> Mapping[str, Any]:
        folder = paths.private_cache("ansible") if isinstance(text, bytes) and len(text) > _LARGE else None
        if folder is None:
            read: Mapping[str, Any] = parse(text, content)
            return read
        assert isinstance(text, bytes)  # noqa: S101 - see above
        path = folder / f"{hashlib.sha256(text).hexdigest()}.json"
        with suppress(OSError, ValueError):
            if isinstance(cache_entry := json.loads(path.read_bytes()), dict):
                return cache_entry
        read = parse(text, content)
        with suppress(OSError):
            write_atomically(path, json.dumps(read).encode())
        return read

    finder._meta_yml_to_dict = parse_with_cache  # noqa: SLF001 - as above


def is_configured() -> bool:
    """Return whether Ansible's settings name a file, or a prompt, for the vault's password."""
    import_ansible()
    from ansible import constants  # noqa: PLC0415 - as below

    return bool(constants.DEFAULT_VAULT_IDENTITY_LIST or constants.DEFAULT_VAULT_PASSWORD_FILE)


PROMPTS = frozenset({"prompt", "prompt_ask_vault_pass"})
"""Ansible's words, instead of a file name, for a vault identity whose password is typed."""


class Vault:
    """Decryption of vaulted values; passwords are read or asked for only when first needed.

    The toolkit's loader and Ansible share them: both accept `secrets` (`DataLoader.set_vault_secrets`).
    """

    def __init__(self, ask: Callable[[str], Secret] | None = None, *, insist: bool = False) -> None:
        """`ask` prompts for the password of a vault id; `insist`: prompt even if a file is configured."""
        self._ask = ask
        self._insist = insist
        self._secrets: list[tuple[str, Any]] | None = None

    @property
    def secrets(self) -> list[tuple[str, Any]]:
        """Pairs of vault id and `VaultSecret`, as Ansible's classes take them; raises UsageError if there are none."""
        if self._secrets is None:
            self._secrets = self._collect_secrets()
        return self._secrets

    def decrypt(self, text: str) -> str:
        """Decrypt one value; raise UsageError without a password, or Ansible's error for a wrong one."""
        import_ansible()
        from ansible.parsing.vault import VaultLib  # noqa: PLC0415 - most inventories of a rehearsal need no vault

        return str(VaultLib(self.secrets).decrypt(text.encode()).decode())

    def encrypt(self, text: str) -> str:
        """Encrypt one value with the first password; raise UsageError if there is none."""
        secret = self.secrets[0][1]
        from ansible.parsing.vault import VaultLib  # noqa: PLC0415 - as above

        return str(VaultLib(self.secrets).encrypt(text.encode(), secret=secret).decode())

    @property
    def known_secrets(self) -> list[tuple[str, Any]]:
        """The secrets obtained so far, without prompting; empty if no value needed them."""
        return self._secrets or []

    def _collect_secrets(self) -> list[tuple[str, Any]]:
        import_ansible()
        # ansible reads its configuration when it is imported: most commands need neither.
        from ansible import constants  # noqa: PLC0415

        result = []
        for item in filter(None, [*constants.DEFAULT_VAULT_IDENTITY_LIST, constants.DEFAULT_VAULT_PASSWORD_FILE]):
            label, _, file = item.rpartition("@")
            label = label or "default"
            result.append((label, self._prompt(label) if file in PROMPTS else _of_file(label, file)))
        if self._insist or not result:
            result.append(("default", self._prompt("default")))
        return result

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
    """Read a password file, or run it if it is a program; raise UsageError."""
    from ansible.errors import AnsibleError  # noqa: PLC0415 - as above
    from ansible.parsing.dataloader import DataLoader  # noqa: PLC0415
    from ansible.parsing.vault import get_file_vault_secret  # noqa: PLC0415

    try:
        secret = get_file_vault_secret(filename=file, vault_id=label, loader=DataLoader())
        secret.load()
    except (AnsibleError, OSError) as error:
        raise UsageError(
            f"the vault's password cannot be read from {arg(file)}: {arg(error)}",
            hint="put the password into that file, or name another: ANSIBLE_VAULT_PASSWORD_FILE=FILE provision …",
        ) from error
    return secret
