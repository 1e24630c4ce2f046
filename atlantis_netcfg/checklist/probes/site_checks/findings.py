"""How a check of the site says what it has found, and what it says where somebody did not answer."""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.bearers import Finding
from atlantis_netcfg.checklist.probes.results import Trouble
from atlantis_netcfg.checklist.report import Evidence, EvidenceType
from atlantis_netcfg.core.verdicts import Verdict

if TYPE_CHECKING:
    from collections.abc import Iterable

__all__ = ["declared", "fail", "good", "listed", "measured", "read", "silent", "unknown", "unreadable", "warn"]


def good(code: str, message: str) -> Finding:
    """It was seen to hold."""
    return Finding(Verdict.PASS, code, message)


def warn(code: str, message: str, hint: str) -> Finding:
    """It works, and somebody should look at it."""
    return Finding(Verdict.WARN, code, message, hint)


def fail(code: str, message: str, hint: str) -> Finding:
    """It was seen not to hold."""
    return Finding(Verdict.FAIL, code, message, hint)


def unknown(code: str, message: str, hint: str) -> Finding:
    """It could not be seen."""
    return Finding(Verdict.INCONCLUSIVE, code, message, hint)


def silent(who: str, trouble: Trouble, words: str) -> Finding:
    """Somebody was asked and gave no whole answer: nothing is known of it."""
    code, message, hint = _SILENT.get(trouble, _SILENT[Trouble.SILENT])
    text = f": {words}" if words else ""
    return unknown(code, message.format(who=who) + text, hint.format(who=who))


_SILENT = {
    Trouble.NO_PLACE: (
        "not-reached",
        "{who} was not reached, so that nobody could look",
        "is {who} switched on, and is this computer in the network by which it is managed?",
    ),
    Trouble.SILENT: (
        "no-answer",
        "{who} did not answer in time",
        "repeat the check; if it stays so, restart {who}",
    ),
    Trouble.DENIED: (
        "denied",
        "{who} does not let us look",
        "log in to {who} as root, or as an account that may use sudo without a password",
    ),
    Trouble.MISSING: (
        "no-program",
        "{who} lacks what it takes to look",
        "run the site once, which installs what a gateway computer needs",
    ),
    Trouble.BUSY: (
        "in-use",
        "another program of {who} holds what it takes to look",
        "end the other program, or repeat the check in a minute",
    ),
}


def unreadable(who: str, what: str) -> Finding:
    """It answered with something else than it should."""
    return unknown(
        "unreadable",
        f"what {who} says of {what} makes no sense",
        f"repeat the check; if it stays so, look at {who} itself",
    )


def read(what: str, value: str) -> Evidence:
    """From the device, in its own words."""
    return Evidence(type=EvidenceType.READ, what=what, value=value)


def measured(what: str, value: str) -> Evidence:
    """By this tool."""
    return Evidence(type=EvidenceType.MEASURED, what=what, value=value)


def declared(what: str, value: str) -> Evidence:
    """In the inventory."""
    return Evidence(type=EvidenceType.DECLARED, what=what, value=value)


def listed(words: Iterable[str]) -> str:
    """Read `a`, `a and b`, `a, b and c`."""
    every = list(words)
    return " and ".join(filter(None, (", ".join(every[:-1]), *every[-1:])))
