"""The few words that the grammar itself must know; all others are the device's business."""

from __future__ import annotations

VERBS = frozenset(
    {
        "add",
        "comment",
        "disable",
        "edit",
        "enable",
        "export",
        "find",
        "get",
        "move",
        "print",
        "remove",
        "reset",
        "run",
        "set",
        "unset",
    }
)
"""Commands that most menus have, and no menu's name: they end the path of a full-path line, whatever follows."""

FLAGS = frozenset({"blackhole", "fib", "no-summaries", "passive"})
"""Arguments that `export` prints as the bare name when they are there; the API gives them an empty value."""
