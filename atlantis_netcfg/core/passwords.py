"""How hard a password is to guess, as zxcvbn estimates it: it knows words, names, dates and keyboards."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterable

_MOST_CHARACTERS = 72
"""Characters that zxcvbn takes; what comes after them makes a password no weaker."""
_WORDS = ("atlantis", "netcfg", "provision", "openvpn", "mikrotik", "routeros")


def guesses(text: str, words: Iterable[str] = ()) -> tuple[float, str]:
    """Estimate how many guesses find it, and say why so few (empty: no reason); a guesser knows our `words`, too."""
    from zxcvbn import zxcvbn  # noqa: PLC0415 - its lists of words are read when it is imported

    estimate = zxcvbn(text[:_MOST_CHARACTERS], user_inputs=[*_WORDS, *words])
    return float(estimate["guesses"]), estimate["feedback"]["warning"].rstrip(".").lower()
