"""Words that every page shares, and what makes text of people and devices harmless to show."""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.checklist.report._states import GREEN, State, state
from atlantis_netcfg.checklist.report.document import EvidenceType
from atlantis_netcfg.core.errors import ExitCode
from atlantis_netcfg.core.printable import visible

if TYPE_CHECKING:
    from collections.abc import Iterable
    from datetime import datetime

    from atlantis_netcfg.checklist.report.document import Document, Evidence, Item

_TITLES = {
    "wifi": "Wi-Fi",
    "acoustic": "Acoustic",
    "satellite": "Satellite",
    "usbl": "USBL",
    "rc_rf": "RC RF",
    "4g": "4G",
    "gps": "GPS",
    "ethernet": "Ethernet",
    "site": "Site",
    "vpn": "VPN",
}


def title(endpoint: str) -> str:
    """A column in the words of Table 3."""
    return _TITLES.get(endpoint, endpoint)


def clock(at: datetime) -> str:
    """A time as people compare it with their notes."""
    return f"{at:%Y-%m-%d %H:%M:%S} {at.tzname() or 'no time zone'}"


def counts(items: Iterable[Item]) -> dict[State, int]:
    """How many there are of each state, the worst first, without those that there are none of."""
    states = [state(item) for item in items]
    return {entry: states.count(entry) for entry in reversed(State) if entry in states}


def by_state(items: Iterable[Item]) -> list[Item]:
    """The worst first; those of one state in the order of the list."""
    order = tuple(reversed(State))
    return sorted(items, key=lambda item: order.index(state(item)))


def first(document: Document) -> tuple[str, list[Item]]:
    """What somebody has to look at, the worst first, and a heading for it."""
    every = [item for item in by_state(document.items) if state(item) not in _SETTLED]
    grave = any(state(item) not in GREEN for item in every)
    return "What to mend first" if grave else "What to look at", every


_SETTLED = frozenset({State.PASS, State.SKIP, State.OVERRIDDEN})


def headline(document: Document) -> tuple[State, str]:
    """The verdict of the whole in one word and one sentence."""
    values = counts(document.items)
    narrowed = f", for {scope(document)} alone" if document.scope else ""
    if document.exit is ExitCode.NOTHING:
        return State.NOT_CHECKED, "Nothing was checked"
    if document.exit is not ExitCode.DONE:
        return next(iter(values)), f"The checklist has not passed{narrowed}"
    unpleasant = State.OVERRIDDEN if State.OVERRIDDEN in values else State.WARN if State.WARN in values else State.PASS
    return unpleasant, f"The checklist has passed{narrowed}{_AND[unpleasant]}"


_AND = {
    State.OVERRIDDEN: ", with what a person has overruled",
    State.WARN: ", with warnings",
    State.PASS: "",
}


def scope(document: Document) -> str:
    """What it was narrowed to, in the words of the command line."""
    return " ".join(f"{name}={','.join(chosen)}" for name, chosen in document.scope.items())


def closing(document: Document) -> str:
    """The exit in words."""
    words = ", ".join(f"{number} {item}" for item, number in counts(document.items).items())
    return f"{headline(document)[1]} (exit {int(document.exit)}): {words or 'no items'}"


def signed(document: Document) -> str:
    """Who vouches for it."""
    if document.signed is None:
        return "NOT SIGNED: nobody vouches for it"
    return f"Signed by {visible(document.signed.by)}, {clock(document.signed.at)}"


_EVIDENCE = {
    EvidenceType.MEASURED: "measured",
    EvidenceType.READ: "read from the device",
    EvidenceType.CONFIRMED: "confirmed by a person",
    EvidenceType.DECLARED: "declared in the inventory",
    EvidenceType.FILE: "file",
}


def evidence_type(evidence: Evidence) -> str:
    """What it stands on, and whose and when it is."""
    by = f", {evidence.by}" if evidence.by is not None else ""
    at = f", {clock(evidence.at)}" if evidence.at is not None else ""
    return f"{_EVIDENCE[evidence.type]}{by}{at}"


def evidence_groups(item: Item) -> list[tuple[str, list[Evidence]]]:
    """Evidence that lies side by side and is of one kind, person and time, under its words; a file is on its own."""
    result: list[tuple[str, list[Evidence]]] = []
    for evidence in item.evidence:
        words = evidence_type(evidence)
        if result and result[-1][0] == words and evidence.file is None and result[-1][1][-1].file is None:
            result[-1][1].append(evidence)
        else:
            result.append((words, [evidence]))
    return result


def evidence_words(evidence: Evidence) -> str:
    """One line of evidence."""
    kept = f"; kept as {evidence.file}" if evidence.file is not None else ""
    digest = f", SHA-256 {evidence.sha256}" if evidence.sha256 is not None else ""
    return f"{evidence.what}: {evidence.value} ({evidence_type(evidence)}){kept}{digest}"
