"""The exception root and the exit codes, shared by all front ends (command line, Ansible).

Also near-miss suggestions: the word that a person most likely meant.
"""

from __future__ import annotations

from enum import IntEnum
from typing import TYPE_CHECKING

from atlantis_netcfg.core import messages

if TYPE_CHECKING:
    from collections.abc import Iterable


class ExitCode(IntEnum):
    """Exit codes; technicians find them in docs/exit-codes.md."""

    DONE = 0
    OUR_FAULT = 1
    CHANGES = 2
    USAGE = 3
    FAILED = 4
    UNKNOWN = 5
    CHECKS_FAILED = 6
    NOTHING = 7

    @property
    def unproven_code(self) -> ExitCode:
        """Exit code if the outcome could not be proved or recorded: never a success code."""
        return ExitCode.CHECKS_FAILED if self in (ExitCode.DONE, ExitCode.CHANGES) else self


TRUST = "run `provision device trust site=…` on a terminal: it shows each device's identity and asks you to confirm it"
"""What to type if a device's identity is not pinned yet; no other command accepts an unknown identity."""

REHEARSE = "rehearse the site: `provision site=… --rehearse`"
"""What is possible with example values; callers that rehearse by themselves replace this text."""

WORST_FIRST = (
    ExitCode.OUR_FAULT,
    ExitCode.UNKNOWN,
    ExitCode.FAILED,
    ExitCode.USAGE,
    ExitCode.CHECKS_FAILED,
    ExitCode.CHANGES,
    ExitCode.DONE,
)
"""The only order of exit codes: reports on several devices exit with the worst. A test checks docs/exit-codes.md."""


def worst(codes: Iterable[ExitCode]) -> ExitCode:
    """Return the most urgent exit code, or NOTHING if there is no other (docs/exit-codes.md)."""
    code_set = frozenset(codes)
    return next((code for code in WORST_FIRST if code in code_set), ExitCode.NOTHING)


def fill_hint(text: str, *, site: str, device: str = "") -> str:
    """Fill in `site=…` and `device=…` of a hint, so that it can be typed as shown.

    For hints of code that does not know them (pure checks, programs on a gateway); called by the first code that does.
    """
    text = messages.msg(text)
    for word, value in (("site", site), ("device", device)):
        if value:
            text = text.replace(f"{word}=…", f"{word}={value}")
    return text


class NetcfgError(Exception):
    """Root of all errors shown to a user: `str()` is the problem, `hint` what to type next, both `Message`."""

    exit: ExitCode = ExitCode.OUR_FAULT

    def __init__(self, message: str, *, hint: str | None = None) -> None:
        super().__init__(messages.msg(message))
        self.hint = hint and messages.msg(hint)


class UsageError(NetcfgError):
    """The command line, or a file it names, cannot be understood; nothing was contacted."""

    exit = ExitCode.USAGE


class NoMatchError(NetcfgError, LookupError):
    """A site, host or run that does not exist; an empty selection is never a success."""

    exit = ExitCode.NOTHING


class DeviceError(NetcfgError):
    """The device is as it was before: refused, rolled back, or never touched."""

    exit = ExitCode.FAILED


class OutcomeUnknown(NetcfgError):
    """The connection was lost before the outcome could be verified."""

    exit = ExitCode.UNKNOWN


_ALIKE = 0.65
"""Minimum difflib ratio for two words to count as a typo of each other."""


def nearest(word: str, candidates: Iterable[str]) -> str | None:
    """Return the known word most similar to `word`, or None; ignores case, `-`, `_` and spaces."""
    from difflib import get_close_matches  # noqa: PLC0415 - only errors need it

    by_key = {_comparison_key(candidate): candidate for candidate in candidates}
    close = get_close_matches(_comparison_key(word), by_key, n=1, cutoff=_ALIKE)
    return by_key[close[0]] if close else None


def _comparison_key(word: str) -> str:
    return word.lower().replace("-", "_").replace(" ", "_")
