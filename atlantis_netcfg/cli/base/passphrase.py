"""The passphrase of the CA key, typed or read from a file descriptor, and the inventory's vault password.

Never an argument, never in the environment: other programs can read both, and shells and logs store them.
"""

from __future__ import annotations

import os
import sys
from typing import TYPE_CHECKING

from atlantis_netcfg.cli.base import syntax
from atlantis_netcfg.core.errors import UsageError
from atlantis_netcfg.core.messages import arg, msg
from atlantis_netcfg.core.secret import Secret

if TYPE_CHECKING:
    from collections.abc import Callable

    from atlantis_netcfg.operations.common.vault import Vault


PASSPHRASE_FD = syntax.Flag("passphrase-fd", "read the passphrase from this open file descriptor", takes="N")
_MOST = 1024
_WORDS = "the passphrase of the CA key"


def passphrase_prompt(arguments: syntax.Arguments, what: str = _WORDS) -> Callable[[], Secret]:
    """Return a function that prompts once for the passphrase and caches it. Raises UsageError without a terminal.

    An unreadable descriptor is reported at once, before anything is done.
    """
    cache: list[Secret] = []
    number = _descriptor_number(arguments)
    if number is None:
        _require_person(what)

    def ask() -> Secret:
        if not cache:
            cache.append(
                _read_secret(msg(f"{arg(what[0].upper())}{arg(what[1:])}: ")) if number is None else _read(number)
            )
        return cache[0]

    return ask


def choose_passphrase(arguments: syntax.Arguments, check: Callable[[Secret], None]) -> Secret:
    """Read a new passphrase, typed twice or read once. Raises UsageError, and errors of `check` for a weak one."""
    number = _descriptor_number(arguments)
    if number is not None:
        only = _read(number)
        check(only)
        return only
    _require_person(_WORDS)
    first = _read_secret(msg(f"Choose {arg(_WORDS)} (for example six dice-selected words): "))
    check(first)
    if _read_secret("The same again: ") != first:
        raise UsageError("the two entries differ; nothing was created", hint="run the command again")
    return first


def vault_of(arguments: syntax.Arguments) -> Vault:
    """Return the inventory's vault; on a terminal, prompt once for its password if none is configured.

    Raises UsageError if the user requests a prompt and there is no terminal.
    """
    from atlantis_netcfg.operations.common.vault import Vault

    insist = arguments.has_flag(syntax.ASK_VAULT_PASS)
    if not sys.stdin.isatty():
        if insist:
            raise UsageError(
                "the vault password is needed, and there is no terminal to type it",
                hint="run the command on a terminal, or name a file: ANSIBLE_VAULT_PASSWORD_FILE=FILE provision …",
            )
        return Vault()
    return Vault(_vault_password if insist or not arguments.has_flag(syntax.JSON) else None, insist=insist)


def _vault_password(vault_id: str) -> Secret:
    suffix = msg("" if vault_id == "default" else f" ({arg(vault_id)})")
    return _read_secret(msg(f"Password of the inventory vault{arg(suffix)}: "))


def _descriptor_number(arguments: syntax.Arguments) -> int | None:
    text = arguments.value(PASSPHRASE_FD.name)
    if text is None:
        return None
    if not (text.isascii() and text.isdecimal()) or len(text) > 6:  # noqa: PLR2004 - more than any system has
        raise UsageError(
            f"`--passphrase-fd {arg(text)}` is not a file descriptor number", hint="example: `--passphrase-fd 3 3<FILE`"
        )
    return int(text)


def _require_person(what: str) -> None:
    if not sys.stdin.isatty():
        raise UsageError(
            f"{arg(what)} is needed, and there is no terminal to type it",
            hint="run the command on a terminal, or pass it as in `--passphrase-fd 3 3<FILE`",
        )


def _read_secret(question: str) -> Secret:
    from getpass import getpass

    try:
        return _require_nonempty(getpass(question))
    except EOFError:
        return _require_nonempty("")


def _read(number: int) -> Secret:
    """Read the first line of a file descriptor."""
    data = b""
    try:
        while b"\n" not in data and len(data) <= _MOST and (more := os.read(number, _MOST)):
            data += more
    except OSError as error:
        raise UsageError(
            f"cannot read file descriptor {arg(number)}: {arg(error.strerror)}",
            hint="example: `--passphrase-fd 3 3<FILE`",
        ) from error
    line = data.partition(b"\n")[0].removesuffix(b"\r")
    if len(line) > _MOST:
        raise UsageError(
            f"the input of file descriptor {arg(number)} is too long for a passphrase", hint="only one line is read"
        )
    try:
        return _require_nonempty(line.decode())
    except UnicodeDecodeError:
        raise UsageError(
            f"the input of file descriptor {arg(number)} is not text", hint="only one line of UTF-8 text is read"
        ) from None


def _require_nonempty(text: str) -> Secret:
    if not text:
        raise UsageError("the passphrase is empty", hint="run the command again")
    return Secret(text)
