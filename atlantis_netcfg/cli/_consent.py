"""A person's word before devices change, money is spent, or many rows of others go: no question answers another."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

from atlantis_netcfg.cli._output import signal_of
from atlantis_netcfg.core import printable
from atlantis_netcfg.core.errors import DeviceFailed, UsageError
from atlantis_netcfg.operations.costs import unpaid

if TYPE_CHECKING:
    from collections.abc import Sequence


_PAY, _REMOVE = "pay", "remove"


class Declined(DeviceFailed):
    """The person said no: every device is as it was."""


def agreed(question: str) -> None:
    """Return when the person agrees. Raises Declined, or UsageError when nobody is there to be asked."""
    if not sys.stdin.isatty():
        raise UsageError(
            "nobody is here to agree to these changes, so nothing was changed",
            hint="look at what would change, then type the same with `--yes`",
        )
    answer = _answer(f"{question}? Type yes to go on: ")
    if answer.strip().lower() not in {"yes", "y"}:
        raise Declined("not agreed, so nothing was changed")


def _answer(question: str) -> str:
    """What a person types; nothing at the end of the input. Raises Declined at Ctrl-C: nothing was sent yet."""
    try:
        return input(printable.lines(question))
    except EOFError:
        return ""
    except KeyboardInterrupt as stop:
        raise Declined(f"stopped by {signal_of(stop)} at the question, so nothing was changed") from stop


def pay(words: Sequence[str], *, accepted: bool, as_json: bool) -> None:
    """Show what goes over links that are paid by the byte, and ask unless `accepted`. Raises CostRefused."""
    if words and not accepted:
        pays(words, ask=not as_json)
    elif words and not as_json:
        print("".join(f"This goes {each}\n" for each in words), end="", flush=True)


def pays(words: Sequence[str], *, ask: bool) -> None:
    """Return when the person pays for what the words tell. Raises CostRefused (`ask`: not where a program reads)."""
    if not ask or not sys.stdin.isatty():
        raise unpaid(words)
    for each in words:
        print(f"This goes {each}")
    answer = _answer(f"Pay for it? Type {_PAY} to go on: ")
    if answer.strip().lower() != _PAY:
        raise unpaid(words)


def removes(words: Sequence[str], *, ask: bool) -> None:
    """Return when the person lets the rows go that the words tell of. Raises Declined, UsageError with nobody there."""
    if not ask or not sys.stdin.isatty():
        raise UsageError(
            f"nobody is here to agree to this, so nothing was changed: {'; '.join(words)}",
            hint="look at them with `--plan`, then type the same with `--yes --remove-foreign`",
        )
    for each in words:
        print(each)
    answer = _answer(f"Remove them? Type {_REMOVE} to go on: ")
    if answer.strip().lower() != _REMOVE:
        raise Declined("not agreed, so nothing was changed")
