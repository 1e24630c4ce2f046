"""What a name of ours may look like."""

from __future__ import annotations

import re


def why_no_name(text: str) -> tuple[str, str] | None:
    """What is wrong with a name and what to type instead; None if it is an RFC 1123 label of at most 32 characters."""
    if re.fullmatch(r"[a-z0-9](?:[a-z0-9-]{0,30}[a-z0-9])?", text):
        return None
    near = re.sub(r"[^a-z0-9]+", "-", text.lower()).strip("-")[:32].strip("-")
    rule = "lower-case letters, digits and hyphens inside, 32 at most"
    return f"`{text}` is no name: a name has {rule}", near or "a name is like coastal-router"
