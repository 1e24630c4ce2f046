"""Password strength as estimated by zxcvbn: it knows words, names, dates and keyboard patterns."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterable

_MOST_CHARACTERS = 72
"""Maximum number of characters that zxcvbn accepts; further characters do not make a password weaker."""
_WORDS = ("atlantis", "netcfg", "provision", "openvpn", "mikrotik", "routeros")


def guesses(text: str, words: Iterable[str] = ()) -> tuple[float, str]:
    """Estimate the guesses needed, with zxcvbn's warning (or empty); `words` count as known to an attacker."""
    from zxcvbn import zxcvbn  # noqa: PLC0415 - its lists of words are read when it is imported

    estimate = zxcvbn(text[:_MOST_CHARACTERS], user_inputs=[*_WORDS, *words])
    return float(estimate["guesses"]), estimate["feedback"]["warning"].rstrip(".").lower()
