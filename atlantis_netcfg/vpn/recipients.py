"""The public keys for sealing enrolment packages, from command arguments: checked, and never a private key."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from atlantis_netcfg.core.errors import UsageError
from atlantis_netcfg.core.messages import arg
from atlantis_netcfg.vpn import requests
from atlantis_netcfg.vpn.pki import check_recipient

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping


_LONGEST = 20_000
"""Maximum characters of a public key file: RSA keys and comments have a few thousand."""
_PRIVATE = ("AGE-SECRET-KEY", "PRIVATE KEY")


def recipients_of(device_requests: Iterable[requests.DeviceWords], names: Iterable[str]) -> Mapping[str, str]:
    """Return the requested recipients by member name. Raises InvalidRequest with all invalid ones."""
    result: dict[str, str] = {}
    errors: list[UsageError] = []
    for item, name in zip(device_requests, names, strict=True):
        if item.recipient is None:
            continue
        try:
            result[name] = recipient_of(item.recipient)
        except UsageError as error:
            errors.append(UsageError(f"{arg(item.place)}: {arg(error)}", hint=error.hint) if item.place else error)
    if errors:
        raise requests.InvalidRequest(errors)
    return result


def recipient_of(argument: str) -> str:
    """Return a checked public key. Raises UsageError for anything else, and for a private key sent by mistake."""
    _refuse_private(argument)
    text = argument if argument.startswith(("age1", "ssh-")) else _read_key_file(argument)
    _refuse_private(text)
    lines = [line.strip() for line in text.splitlines() if line.strip() and not line.startswith("#")]
    if len(lines) != 1:
        raise UsageError(
            f"{arg(len(lines))} keys in {arg(requests.quote(argument))}", hint="use one file per public key"
        )
    check_recipient(lines[0])
    return lines[0]


def _refuse_private(text: str) -> None:
    if any(mark in text.upper() for mark in _PRIVATE):
        raise UsageError(
            "this is a private key: only its owner may have it",
            hint="ask them to create a new one (`age-keygen`) and to send the line that begins with age1",
        )


def _read_key_file(argument: str) -> str:
    hint = "an age key begins with age1; you can also name a file that contains one, or an SSH public key"
    try:
        with Path(argument).open(encoding="utf-8") as file:
            return file.read(_LONGEST)
    except (OSError, ValueError) as error:
        why = getattr(error, "strerror", None) or "it is not a text file"
        raise UsageError(
            f"no public key to seal to: {arg(requests.quote(argument))} cannot be read: {arg(why)}", hint=hint
        ) from error
