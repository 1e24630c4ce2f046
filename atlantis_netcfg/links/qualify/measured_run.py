"""Metadata of a measurement run: place, link, time, budget, and the router's own counters.

A run is a folder with two files: `samples.jsonl` (`samples`) and `run.json`, which holds one `MeasuredRun`. Figures,
tables, plots and verdicts are computed from these two, so that other thresholds can be applied later.

Streams of a run have fixed names, which identify them to a reader of samples: `idle` and `loaded` (trains), `led` (a
train while a tunnel moves to the link), `load up` and `load down` (messages), `telemetry SIZE RATE`, `image LABEL
RATE`, `rate SIZE RATE` (octets, and messages a second as `%g`; a label as in `grids.NominalImage.label`). `rate SIZE
0`: messages sent one by one without load, whose latency is the reference for messages of this size.
"""

from __future__ import annotations

from datetime import datetime
from decimal import Decimal
from enum import StrEnum
from typing import TYPE_CHECKING, Final

from pydantic import Field

from atlantis_netcfg.core.atomic_files import write_atomically
from atlantis_netcfg.core.events import Verdict
from atlantis_netcfg.core.message_models import MessageModel
from atlantis_netcfg.links.cost import Tariff
from atlantis_netcfg.links.qualify.judgement import QualifyProfile

if TYPE_CHECKING:
    from pathlib import Path

VERSION: Final = 1
SAMPLES_FILE: Final = "samples.jsonl"
RUN_FILE: Final = "run.json"


class Selection(StrEnum):
    """The measurement selected by `profile=`; idle round trips and the path MTU are part of each."""

    TELEMETRY = "telemetry"
    IMAGES = "images"
    THROUGHPUT = "throughput"
    ALL = "all"


class FarEnd(MessageModel):
    """The reflector that responded."""

    name: str
    address: str
    port: int
    over_vpn: bool
    authenticated: bool
    source: str
    """This computer's source address in the packets."""


class BudgetLimits(MessageModel):
    """The limits that a person has set; None means no limit of that kind."""

    max_bytes: int | None = None
    max_seconds: float | None = None
    max_price: Decimal | None = None


class LinkCount(MessageModel):
    """The router's counters for one link of the site between the first packet and the last.

    `test_*`: packets of this run alone, by counting rules of the router; None if it did not count. Through the VPN: all
    traffic of this computer's tunnel.
    `port_*`: all traffic of the port, including the site's.
    """

    link: str
    test_packets_up: int | None = None
    test_bytes_up: int | None = None
    test_packets_down: int | None = None
    test_bytes_down: int | None = None
    port_bytes_up: int | None = None
    port_bytes_down: int | None = None


class MeasuredRun(MessageModel):
    """All data about a run except its samples."""

    version: int = VERSION
    id: str
    """`LINK-20261126T022248Z`: unique within a site."""
    tool: str
    """Version of this program."""
    site: str
    link: str
    kind: str
    """Link kind in the inventory."""
    emulated: bool
    """Whether far end and link were emulated: then the figures do not describe a real link."""
    selection: Selection
    far_end: FarEnd
    begun: datetime
    ended: datetime | None
    """None: the program was terminated before it could record the end."""
    reason: str
    """Why the run ended: `done`, `stopped`, or the limit of the budget."""
    clock_synchronised: bool
    """Whether this computer's clock is synchronised, as its kernel reports."""
    budget: BudgetLimits
    currency: str | None = None
    tariff: Tariff | None = None
    """Tariff of the link in the inventory; None: no tariff is declared, or the link is not metered."""
    sent_bytes: int = 0
    """Bytes on the wire by this computer's count, IP and UDP headers included."""
    received_bytes: int = 0
    charged_bytes: int = 0
    """Bytes charged to the budget, including missing responses, because a provider may bill them."""
    price: Decimal | None = None
    counts: tuple[LinkCount, ...] = ()
    """Counts of every link of the site, including the measured one."""
    way: Verdict = Verdict.INCONCLUSIVE
    """Whether the traffic used the intended link and no other."""
    way_reason: str = ""
    path_mtu_up: int | None = None
    path_mtu_both: int | None = None
    path_mtu_reason: str = ""
    thresholds_name: str
    thresholds: QualifyProfile
    facts: dict[str, str] = Field(default_factory=dict)
    """Facts about the link that its devices reported at the beginning (signal, cell, version): label to value."""
    remarks: tuple[str, ...] = ()
    time_zone: str = ""
    """The pilot's time zone (IANA name), for pages; empty: UTC."""


def write_run(folder: Path, run: MeasuredRun) -> None:
    """Replace `run.json` in a run's folder atomically."""
    write_atomically(folder / RUN_FILE, f"{run.to_json(indent=1)}\n".encode())


def read_run(folder: Path) -> MeasuredRun:
    """Read `run.json`; raise OSError, or ValueError if it is not of this version."""
    return MeasuredRun.from_json((folder / RUN_FILE).read_bytes())
