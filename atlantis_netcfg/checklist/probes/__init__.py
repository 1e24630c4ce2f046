"""What each column of Table 3 means on the wire: which questions tell, and how their answers are judged.

A column (and each of the site's own checks) gives steps for a cell of the table: a probe, or something for a person
to look at. A probe is two pure functions, the questions that it asks and the judgement of whatever came back; it opens
no connection, so the same judgement serves the real site, the rehearsal and the data cases of the tests. Questions are
data from closed lists of commands that only read; whoever carries them out (`checklist/runner`) stands where the
thing is.
"""

from __future__ import annotations

from atlantis_netcfg.checklist.probes.step import (
    ITEMS,
    SITE,
    AllowListTestRequest,
    AllowListTestResult,
    Answer,
    Cell,
    CommandResult,
    Consent,
    DdsDiscoverRequest,
    DdsDiscoverResult,
    DhcpDiscoverRequest,
    DhcpOffer,
    DhcpOffers,
    Judged,
    LinkRecordRequest,
    LinkRecordResult,
    LinkStatusRequest,
    LinkStatusResult,
    Listen,
    Place,
    Probe,
    Question,
    Reflected,
    ReflectRequest,
    ReflectResult,
    RouterOsQuery,
    Rows,
    RunProgram,
    Say,
    Step,
    Transcript,
    Trouble,
)

__all__ = [
    "ITEMS",
    "SITE",
    "AllowListTestRequest",
    "AllowListTestResult",
    "Answer",
    "Cell",
    "CommandResult",
    "Consent",
    "DdsDiscoverRequest",
    "DdsDiscoverResult",
    "DhcpDiscoverRequest",
    "DhcpOffer",
    "DhcpOffers",
    "Judged",
    "LinkRecordRequest",
    "LinkRecordResult",
    "LinkStatusRequest",
    "LinkStatusResult",
    "Listen",
    "Place",
    "Probe",
    "Question",
    "ReflectRequest",
    "ReflectResult",
    "Reflected",
    "RouterOsQuery",
    "Rows",
    "RunProgram",
    "Say",
    "Step",
    "Transcript",
    "Trouble",
]
