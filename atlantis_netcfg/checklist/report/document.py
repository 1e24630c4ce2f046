"""The document of one checklist: what `--json` prints, what is stored, what is signed."""

from __future__ import annotations

from datetime import datetime
from enum import StrEnum
from typing import Literal

from pydantic import BaseModel, ConfigDict

from atlantis_netcfg.core.errors import ExitCode
from atlantis_netcfg.core.events import Verdict, worst
from atlantis_netcfg.inventory.model import Phase


class _Data(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class ItemKind(StrEnum):
    """Who settles the item."""

    AUTOMATIC = "automatic"
    """The tool, which only observes."""
    ACTIVE = "active"
    """The tool, which makes something happen: only with a person's consent."""
    PERSON = "person"
    """A person, who looks and answers."""


class EvidenceType(StrEnum):
    """Basis of a verdict."""

    MEASURED = "measured"
    """By this tool."""
    READ = "read"
    """From the device, in its own words."""
    CONFIRMED = "confirmed"
    """By a person: `by` and `at` say who and when."""
    DECLARED = "declared"
    """In the inventory."""
    FILE = "file"
    """A photo, a screenshot, an exported backup: `file` and `sha256` say which."""


class Evidence(_Data):
    """One piece of evidence."""

    type: EvidenceType
    what: str
    """`signal at coastal-gateway`."""
    value: str
    """`-52 dBm`: with its unit; never a secret, an IMEI, IMSI or ICCID."""
    at: datetime | None = None
    by: str | None = None
    file: str | None = None
    """Name of the copy that is kept beside the document."""
    sha256: str | None = None


class ItemFinding(_Data):
    """One finding of an item's verdict."""

    verdict: Verdict
    code: str
    message: str
    hint: str | None = None


class Override(_Data):
    """A person's acceptance of responsibility for an item that did not pass."""

    reason: str
    by: str
    at: datetime


class Item(_Data):
    """One line of the checklist."""

    id: str
    """`sparus/wifi`, `sparus/usbl/ping`, `coastal/site/rogue-dhcp`, `sparus/items/battery`: row, endpoint, step."""
    title: str
    """What is checked, in a technician's words."""
    vehicle: str | None
    """Key of the vehicle; None: an item of the location."""
    location: str
    """The site."""
    endpoint: str
    """A column of Table 3, `ethernet`, `site` for the site's own checks, `robot` for what robots publish,
    `integration` for a record of its own, `items` for what the pilot declares."""
    table3: bool
    """Whether it is part of a cell that the report marks."""
    kind: ItemKind
    phase: Phase
    open: bool
    """Not settled yet: not probed, or nobody has answered."""
    verdict: Verdict
    """While it is open: INCONCLUSIVE."""
    message: str
    hint: str | None = None
    findings: tuple[ItemFinding, ...] = ()
    evidence: tuple[Evidence, ...] = ()
    at: datetime | None = None
    seconds: float | None = None
    override: Override | None = None

    @property
    def counts(self) -> Verdict:
        """Verdict as it counts for the exit code: an overridden item is only a warning."""
        if self.override is not None and self.verdict in {Verdict.FAIL, Verdict.INCONCLUSIVE, Verdict.ERROR}:
            return Verdict.WARN
        return self.verdict


class Row(_Data):
    """A row of the grid."""

    key: str
    name: str
    """As Table 3 prints it; of a location its title."""
    kind: str
    """auv, asv, uav, rov, docking_station, or `location`."""
    aliases: tuple[str, ...] = ()
    table3: tuple[str, ...]
    """The columns that are marked, by the report or (a location) by the declaration."""
    deviation: str | None = None
    """Why the row differs from the report's."""
    beside: tuple[str, ...] = ()
    """Columns that are checked though Table 3 does not mark them: a location's bearers, `ethernet`."""


class LeftOut(_Data):
    """Something that was not checked."""

    what: str
    why: str


class ItemChange(_Data):
    """An item that differs from the last green checklist."""

    id: str
    before: Verdict | None
    """None: there was no such item."""
    after: Verdict | None
    message: str


class SinceGreen(_Data):
    """Changes since the last green checklist of the same scope."""

    run: str
    at: datetime
    changes: tuple[ItemChange, ...]


class DrawnNode(_Data):
    """A node in the drawing of the site."""

    key: str
    label: str
    kind: str
    """router, cpe, lte_router, satellite_terminal, gateway, control_centre, vpn_server, vehicle, partner, site."""
    items: tuple[str, ...] = ()
    """Items that speak of it; the drawing shows the worst."""
    detail: str = ""


class DrawnLink(_Data):
    """A link in the drawing."""

    a: str
    b: str
    label: str
    kind: str
    """wifi, acoustic, satellite, usbl, rc_rf, 4g, gps, ethernet, vpn."""
    items: tuple[str, ...] = ()


class Drawing(_Data):
    """Drawing of the site, from the inventory."""

    nodes: tuple[DrawnNode, ...]
    links: tuple[DrawnLink, ...]


class Signature(_Data):
    """Signature of a named person over the whole document."""

    by: str
    at: datetime
    digest: str
    """SHA-256 over the canonical JSON of the document without this field."""
    key: str
    """Fingerprint of the computer's key, `SHA256:…`."""
    public: str = ""
    """That key's public half, raw, base64: whoever has the document alone can check it against the fingerprint."""
    signature: str
    """Ed25519 over the canonical JSON of this block without this field, base64: name and time are signed as well."""


class Document(_Data):
    """A complete checklist of a site."""

    version: Literal[1] = 1
    run: str
    site: str
    title: str
    rehearsed: bool
    tool: str
    """Version of this toolkit."""
    inventory: str
    """Revision of the declaration: SHA-256 over its files."""
    started: datetime
    ended: datetime | None
    scope: dict[str, tuple[str, ...]]
    """What it was narrowed to (`vehicle`, `endpoint`, `phase`); empty: everything."""
    mission: str = ""
    """Name of the mission whose declared items are asked on top; empty: none."""
    columns: tuple[str, ...]
    """Table 3's, in the report's order."""
    rows: tuple[Row, ...]
    items: tuple[Item, ...]
    left_out: tuple[LeftOut, ...] = ()
    notes: tuple[str, ...] = ()
    """What holds at this site and no item can change: of no verdict."""
    not_rehearsed: tuple[str, ...] = ()
    broken: tuple[str, ...] = ()
    """Rehearsal: what was broken on purpose."""
    drawing: Drawing
    time_zone: str = ""
    """The pilot's (IANA name), for people beside UTC; empty in documents of before it was kept: UTC alone."""
    since_green: SinceGreen | None = None
    signed: Signature | None = None

    @property
    def verdict(self) -> Verdict:
        """Worst of all verdicts as they count for the exit code."""
        return worst(item.counts for item in self.items)

    @property
    def exit(self) -> ExitCode:
        """Exit code; a checklist without checks, or with unanswered items, is not green."""
        if not self.items or all(item.verdict is Verdict.SKIP for item in self.items):
            return ExitCode.NOTHING
        green = {Verdict.PASS, Verdict.WARN, Verdict.SKIP}
        is_done = all(item.counts in green and (not item.open or item.override) for item in self.items)
        return ExitCode.DONE if is_done else ExitCode.CHECKS_FAILED
