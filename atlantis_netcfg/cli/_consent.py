"""A person's word before devices change."""

from __future__ import annotations

import sys

from atlantis_netcfg.errors import DeviceFailed, UsageError

__all__ = ["Declined", "agreed"]


class Declined(DeviceFailed):
    """The person said no: every device is as it was."""


def agreed(question: str) -> None:
    """Return when the person agrees. Raises Declined, or UsageError when nobody is there to be asked."""
    if not sys.stdin.isatty():
        raise UsageError(
            "nobody is here to agree to these changes, so nothing was changed",
            hint="look at what would change, then type the same with `--yes`",
        )
    try:
        answer = input(f"{question}? Type yes to go on: ")
    except EOFError:
        answer = ""
    if answer.strip().lower() not in {"yes", "y"}:
        raise Declined("not agreed, so nothing was changed")
