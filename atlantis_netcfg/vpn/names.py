"""Which names are taken at all: a name becomes a common name, a file name, and a word of nft's language."""

from __future__ import annotations

import re

__all__ = ["LONGEST", "NAME", "check_name", "member_name"]

LONGEST = 48
"""Characters of a name; with a successor's `.2` it stays below the 64 of a common name (RFC 5280, ub-common-name)."""
NAME = re.compile(r"[a-z0-9](?:[a-z0-9-]{0,46}[a-z0-9])?")
"""The grammar, to be matched in full: `$` would let a newline at the end through."""


def check_name(text: str, what: str) -> str:
    """`text`, if it may be a name; else UsageError that says what is wrong with `what` and offers a valid name."""
    raise NotImplementedError


def member_name(partner: str, device: str) -> str:
    """`PARTNER-DEVICE`, each part and the whole checked. Raises UsageError."""
    raise NotImplementedError
