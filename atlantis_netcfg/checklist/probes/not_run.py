"""What is said where a question has no whole answer: what stands in the way, and that nothing follows from it."""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.bearers import Finding
from atlantis_netcfg.checklist.probes.requests import Place
from atlantis_netcfg.checklist.probes.results import Ran, Rows, Trouble
from atlantis_netcfg.core.verdicts import Verdict

if TYPE_CHECKING:
    from collections.abc import Iterator

    from atlantis_netcfg.checklist.probes.results import Answer

__all__ = ["PLACES", "not_run", "rows_of", "unasked"]

PLACES = {Place.GATEWAY: "the gateway", Place.LAPTOP: "this computer", Place.ROUTER: "the router"}
"""A place in words."""
_PACKAGES = {"ping": "iputils-ping", "ip": "iproute2"}
"""Where the package of Debian and Ubuntu is not called as its program is."""


def unasked(who: str, answer: Answer | None) -> Finding:
    """Say that `who` could not be asked; it never fails anything, for nothing is known."""
    words = getattr(answer, "words", "") or "it does not answer"
    hint = f"make {who} reachable first, then ask again"
    return Finding(Verdict.INCONCLUSIVE, "not-asked", f"{who} could not be asked: {words}", hint)


def not_run(place: Place, program: str, ran: Answer | None) -> Iterator[Finding]:
    """Say why a program has printed nothing that counts; nothing, if it was carried out."""
    where = PLACES[place]
    if not isinstance(ran, Ran):
        yield unasked(where, ran)
    elif ran.trouble is Trouble.MISSING:
        hint = f"on it: sudo apt install {_PACKAGES.get(program, program)}"
        yield Finding(Verdict.INCONCLUSIVE, "program-missing", f"{where} has no program `{program}`", hint)
    elif ran.trouble is Trouble.SILENT:
        hint = f"look whether {where} is overloaded, then ask again"
        message = f"`{program}` did not come to an end in time on {where}"
        yield Finding(Verdict.INCONCLUSIVE, "program-slow", message, hint)
    elif ran.trouble is not None:
        yield unasked(where, ran)


def rows_of(answer: Answer | None) -> tuple[dict[str, str], ...] | None:
    """Give the rows of a menu; None: it was not asked, or the device does not have it."""
    if not isinstance(answer, Rows) or answer.trouble is not None or answer.rows is None:
        return None
    return tuple(dict(row) for row in answer.rows)
