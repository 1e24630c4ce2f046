"""A sealed file: for a key that its reader has, or by a passphrase that is told by telephone and kept nowhere."""

from __future__ import annotations

import re
import secrets
from dataclasses import dataclass

from atlantis_netcfg.core.errors import UsageError
from atlantis_netcfg.core.secret import Secret
from atlantis_netcfg.vpn import pki
from atlantis_netcfg.vpn.enrolment_package._archive import NotAHandOut

__all__ = ["OneTimePassphrase", "Recipient", "Sealing", "seal", "unseal"]

_GROUPS, _DIGITS = 5, 5
_SECRET_KEY = "AGE-SECRET-KEY-"  # noqa: S105 - how such a key begins


@dataclass(frozen=True, slots=True)
class Recipient:
    """Whoever holds the key of this public one."""

    public: str
    """`age1…`, or the line of an `ssh-ed25519` or `ssh-rsa` key."""


@dataclass(frozen=True, slots=True)
class OneTimePassphrase:
    """Whoever is told the passphrase that is made for this one file."""


Sealing = Recipient | OneTimePassphrase


def seal(data: bytes, sealing: Sealing) -> tuple[bytes, Secret | None]:
    """The sealed bytes, and the passphrase if there is one. Raises RecipientRefused."""
    if isinstance(sealing, Recipient):
        return pki.seal_for(data, sealing.public), None
    passphrase = _passphrase()
    return pki.seal(data, passphrase), passphrase


def unseal(data: bytes, secret: Secret) -> bytes:
    """What was sealed; `told` is the passphrase, or an `AGE-SECRET-KEY-1…`. Raises WrongPassphrase, NotAHandOut."""
    by_key = secret.reveal().strip().startswith(_SECRET_KEY)
    try:
        return pki.unseal_with(data, secret) if by_key else pki.unseal(data, _as_made(secret))
    except pki.SealDamaged:
        raise NotAHandOut("it is not sealed, or was damaged on its way") from None
    except pki.WrongPassphrase:
        raise WrongKey(by_key=by_key) from None


class WrongKey(UsageError):
    """The file is whole as far as can be seen, and what was typed does not open it."""

    def __init__(self, *, by_key: bool) -> None:
        super().__init__(
            "this key does not open the hand-out" if by_key else "this passphrase does not open the hand-out",
            hint="use the key that the control centre was given"
            if by_key
            else f"it has {_GROUPS} groups of {_DIGITS} digits: ask the control centre to read it out again",
        )


def _passphrase() -> Secret:
    """25 digits, 83 bits: digits are understood by telephone in every language of the partners."""
    groups = (f"{secrets.randbelow(10**_DIGITS):0{_DIGITS}}" for _ in range(_GROUPS))
    return Secret("-".join(groups))


def _as_made(typed: Secret) -> Secret:
    """Digits may be typed with spaces, without anything between them, or as they were shown."""
    digits = re.sub(r"[\s-]", "", typed.reveal())
    if not re.fullmatch(rf"[0-9]{{{_GROUPS * _DIGITS}}}", digits):
        return typed
    return Secret("-".join(digits[at : at + _DIGITS] for at in range(0, len(digits), _DIGITS)))
