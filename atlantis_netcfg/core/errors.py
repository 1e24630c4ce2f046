"""The one exception root and the exit codes, so that every door (command line, Ansible) ends a run in the same way.

Near misses: the word that a person most likely meant, for every message that offers one.
"""

from __future__ import annotations

from enum import IntEnum
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterable


class ExitCode(IntEnum):
    """How a command ends; the table that technicians read is docs/exit-codes.md."""

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
        """The code of what ended so, where that could not be proved or recorded: never a green one."""
        return ExitCode.CHECKS_FAILED if self in (ExitCode.DONE, ExitCode.CHANGES) else self


TRUST = "`provision trust site=…` on a terminal shows who answers, and asks you"
"""What to type where it is not known how a device is told from an impostor: the only command that agrees to one."""

REHEARSE = "rehearse the site: `provision site=… --rehearse`"
"""What may go on with example values; a door that rehearses by itself puts its own words in its place."""

WORST_FIRST = (
    ExitCode.OUR_FAULT,
    ExitCode.UNKNOWN,
    ExitCode.FAILED,
    ExitCode.USAGE,
    ExitCode.CHECKS_FAILED,
    ExitCode.CHANGES,
    ExitCode.DONE,
)
"""The only order of exit codes: every report of several devices ends by it, and docs/exit-codes.md says it (a test)."""


def worst(codes: Iterable[ExitCode]) -> ExitCode:
    """The code that needs somebody most; NOTHING where nothing else is among them (docs/exit-codes.md)."""
    code_set = frozenset(codes)
    return next((code for code in WORST_FIRST if code in code_set), ExitCode.NOTHING)


def complete(text: str, *, site: str, device: str = "") -> str:
    """A hint with its `site=…`, `device=…` and `host=…` filled in, so that it can be typed as it stands.

    For texts of those who know neither (pure judges, programs on a gateway), by the first who knows.
    """
    for word, value in (("site", site), ("device", device), ("host", device)):
        if value:
            text = text.replace(f"{word}=…", f"{word}={value}")
    return text


class NetcfgError(Exception):
    """Root of every error that a person may see: `str()` says what is wrong, `hint` what to type next."""

    exit: ExitCode = ExitCode.OUR_FAULT

    def __init__(self, message: str, *, hint: str | None = None) -> None:
        super().__init__(message)
        self.hint = hint


class UsageError(NetcfgError):
    """The command line, or a file it names, cannot be understood; nothing was contacted."""

    exit = ExitCode.USAGE


class NoMatchError(NetcfgError, LookupError):
    """A site, host or run that does not exist: never a green nothing."""

    exit = ExitCode.NOTHING


class DeviceError(NetcfgError):
    """The device is as it was before: refused, rolled back, or never touched."""

    exit = ExitCode.FAILED


class OutcomeUnknown(NetcfgError):
    """The link was lost before the outcome could be read back."""

    exit = ExitCode.UNKNOWN


_ALIKE = 0.65
"""Ratio of difflib from which on two words count as one of them mistyped."""


def nearest(word: str, candidates: Iterable[str]) -> str | None:
    """The known word nearest to `word`, or None; neither case counts, nor which of `-`, `_` and space stands."""
    from difflib import get_close_matches  # noqa: PLC0415 - only errors need it

    by_key = {_key(candidate): candidate for candidate in candidates}
    close = get_close_matches(_key(word), by_key, n=1, cutoff=_ALIKE)
    return by_key[close[0]] if close else None


def _key(word: str) -> str:
    return word.lower().replace("-", "_").replace(" ", "_")
