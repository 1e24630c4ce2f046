"""The document of one checklist: what `--json` prints, what is stored, what is signed."""

from __future__ import annotations

from datetime import datetime
from enum import StrEnum
from typing import Literal

from atlantis_netcfg.core.errors import ExitCode
from atlantis_netcfg.core.events import Verdict, worst
from atlantis_netcfg.core.message_models import MessageModel
from atlantis_netcfg.inventory.model import Phase


class ItemKind(StrEnum):
    """Who settles the item."""

    AUTOMATIC = "automatic"
    """Checked by the tool, which only observes."""
    ACTIVE = "active"
    """Checked by the tool, which triggers something: only with a person's consent."""
    PERSON = "person"
    """Checked by a person, who looks and answers."""


class EvidenceType(StrEnum):
    """Basis of a verdict."""

    MEASURED = "measured"
    """Measured by this tool."""
    READ = "read"
    """Read from the device, in its own words."""
    CONFIRMED = "confirmed"
    """Confirmed by a person: `by` and `at` give name and time."""
    DECLARED = "declared"
    """Declared in the inventory."""
    FILE = "file"
    """A photo, a screenshot, an exported backup: `file` and `sha256` say which."""


class Evidence(MessageModel):
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


class ItemFinding(MessageModel):
    """One finding of an item's verdict."""

    verdict: Verdict
    code: str
    message: str
    hint: str | None = None


class Override(MessageModel):
    """A person's acceptance of responsibility for an item that did not pass."""

    reason: str
    by: str
    at: datetime


class Item(MessageModel):
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
    """A column of Table 3, `ethernet`, `site` for the site's own checks, `robot` for data that robots publish,

    `integration` for an integration record, `items` for items that the pilot declares.
    """
    table3: bool
    """Whether it is part of a cell that the report marks."""
    kind: ItemKind
    phase: Phase
    open: bool
    """Whether it is not settled yet: not probed, or not answered."""
    verdict: Verdict
    """INCONCLUSIVE while the item is open."""
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


class Row(MessageModel):
    """A row of the grid."""

    key: str
    name: str
    """As Table 3 prints it; for a location, its title."""
    kind: str
    """auv, asv, uav, rov, docking_station, or `location`."""
    aliases: tuple[str, ...] = ()
    table3: tuple[str, ...]
    """Columns that are marked, by the report or (for a location) by the inventory."""
    deviation: str | None = None
    """Why the row differs from the report's."""
    beside: tuple[str, ...] = ()
    """Columns that are checked although Table 3 does not mark them: a location's links, `ethernet`."""


class LeftOut(MessageModel):
    """Something that was not checked."""

    what: str
    why: str


class ItemChange(MessageModel):
    """An item that differs from the last green checklist."""

    id: str
    before: Verdict | None
    """None: the item did not exist."""
    after: Verdict | None
    message: str


class SinceGreen(MessageModel):
    """Changes since the last green checklist of the same scope."""

    run: str
    at: datetime
    changes: tuple[ItemChange, ...]


class DrawnNode(MessageModel):
    """A node in the drawing of the site."""

    key: str
    label: str
    kind: str
    """router, cpe, lte_router, satellite_terminal, gateway, control_centre, vpn_server, vehicle, partner, site."""
    items: tuple[str, ...] = ()
    """Items that concern it; the drawing shows the worst."""
    detail: str = ""


class DrawnLink(MessageModel):
    """A link in the drawing."""

    a: str
    b: str
    label: str
    kind: str
    """wifi, acoustic, satellite, usbl, rc_rf, 4g, gps, ethernet, vpn."""
    items: tuple[str, ...] = ()


class Drawing(MessageModel):
    """Drawing of the site, from the inventory."""

    nodes: tuple[DrawnNode, ...]
    links: tuple[DrawnLink, ...]


class Signature(MessageModel):
    """Signature of a named person over the whole document."""

    by: str
    at: datetime
    digest: str
    """SHA-256 over the canonical JSON of the document without this field."""
    key: str
    """Fingerprint of the computer's key, `SHA256:…`."""
    public: str = ""
    """Public half of that key, raw, base64: with the document alone it can be checked against the fingerprint."""
    signature: str
    """Ed25519 over the canonical JSON of this block without this field, base64: name and time are signed as well."""


class Document(MessageModel):
    """A complete checklist of a site."""

    version: Literal[1] = 1
    run: str
    site: str
    title: str
    rehearsed: bool
    tool: str
    """Version of this toolkit."""
    inventory: str
    """Revision of the inventory: SHA-256 over its files."""
    started: datetime
    ended: datetime | None
    scope: dict[str, tuple[str, ...]]
    """Selection that narrows it (`vehicle`, `endpoint`, `phase`); empty: everything."""
    mission: str = ""
    """Name of the mission whose declared items are added; empty: none."""
    columns: tuple[str, ...]
    """Columns of Table 3, in the report's order."""
    rows: tuple[Row, ...]
    items: tuple[Item, ...]
    left_out: tuple[LeftOut, ...] = ()
    notes: tuple[str, ...] = ()
    """Facts about this site that no item can change; they have no verdict."""
    not_rehearsed: tuple[str, ...] = ()
    broken: tuple[str, ...] = ()
    """Rehearsal: faults that were set on purpose."""
    drawing: Drawing
    time_zone: str = ""
    """IANA time zone of the pilot, shown beside UTC; empty in older documents: UTC alone."""
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
