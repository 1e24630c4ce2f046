"""Putting members out: recorded and on the list first, so that it holds whatever the server says."""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.core.errors import UsageError

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from atlantis_netcfg.core.secret import Secret
    from atlantis_netcfg.operations.vpn.operator import OperatorContext
    from atlantis_netcfg.vpn.authority import Revoked
    from atlantis_netcfg.vpn.identity import Member

__all__ = ["reason_of", "revoke"]

_LONGEST = 100


def reason_of(typed: str | None) -> str:
    """The reason for the record. Raises UsageError for more than a line."""
    if typed is None:
        return "no reason given"
    if not typed.isprintable() or len(typed) > _LONGEST:
        raise UsageError(f"a reason is one line of {_LONGEST} characters at most", hint="as in `reason=stolen`")
    return typed


def revoke(
    prompt: OperatorContext, members: Sequence[Member], reason: str, passphrase: Callable[[], Secret]
) -> Revoked:
    """Record it and publish the list; nothing is asked of the server here."""
    with prompt.unlocked(passphrase) as signer:
        return signer.revoke([member.name for member in members], reason)
