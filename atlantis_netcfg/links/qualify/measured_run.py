"""What a run of measurements is beside its raw samples: where, over what, when, within which budget, who counted along.

A run is a folder with two files: `samples.jsonl` (`samples`) and `run.json`, which holds one `MeasuredRun`. Figures,
tables, plots and verdicts are made of these two, so that they can be made again with other thresholds.

Streams of a run are named so that a reader of samples knows what they are: `idle` and `loaded` (trains), `led` (a train
while a tunnel moves to the link), `load up` and `load down` (messages), `telemetry SIZE RATE`, `image LABEL RATE`,
`rate SIZE RATE` (octets, and messages a second as `%g`; a label as `grids.NominalImage.label` has it). `rate SIZE 0`:
messages one after the other, without load, whose latency those of this size are compared with.
"""

from __future__ import annotations

from datetime import datetime
from decimal import Decimal
from enum import StrEnum
from typing import TYPE_CHECKING, Final

from pydantic import BaseModel, ConfigDict

from atlantis_netcfg.core.atomic_files import write_atomically
from atlantis_netcfg.core.events import Verdict
from atlantis_netcfg.links.cost import Tariff
from atlantis_netcfg.links.qualify.judgement import QualifyProfile

if TYPE_CHECKING:
    from pathlib import Path

VERSION: Final = 1
SAMPLES_FILE: Final = "samples.jsonl"
RUN_FILE: Final = "run.json"


class Selection(StrEnum):
    """What is measured: the word of `profile=`. Idle round trips and the path MTU belong to each."""

    TELEMETRY = "telemetry"
    IMAGES = "images"
    THROUGHPUT = "throughput"
    ALL = "all"


class RunPart(BaseModel):
    """A part of `run.json`."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class FarEnd(RunPart):
    """Who answered."""

    name: str
    address: str
    port: int
    over_vpn: bool
    authenticated: bool
    source: str
    """This computer's address, as the packets bear it."""


class BudgetLimits(RunPart):
    """What a person has allowed; None: no limit of that kind."""

    max_bytes: int | None = None
    max_seconds: float | None = None
    max_price: Decimal | None = None


class LinkCount(RunPart):
    """What the router counted on one of the site's links between the first packet and the last.

    `test_*`: packets of this run alone, by counting rows of the router; None: it has not counted. Through the VPN: all
    of this computer's tunnel.
    `port_*`: whatever passed the port, traffic of the site included.
    """

    link: str
    test_packets_up: int | None = None
    test_bytes_up: int | None = None
    test_packets_down: int | None = None
    test_bytes_down: int | None = None
    port_bytes_up: int | None = None
    port_bytes_down: int | None = None


class MeasuredRun(RunPart):
    """All that is known of a run and is no sample."""

    version: int = VERSION
    id: str
    """`LINK-20261126T022248Z`: unique within a site."""
    tool: str
    """Version of this program."""
    site: str
    link: str
    kind: str
    """Of the bearer, as the declaration has it."""
    emulated: bool
    """The far end and the link were emulated: the figures say nothing of a real link."""
    selection: Selection
    far_end: FarEnd
    begun: datetime
    ended: datetime | None
    """None: the program ended before it could write this."""
    reason: str
    """Why it ended: `done`, `stopped`, or the limit of the budget."""
    clock_synchronised: bool
    """This computer's, by its kernel."""
    budget: BudgetLimits
    currency: str | None = None
    tariff: Tariff | None = None
    """As the link is declared; None: nobody has declared it, or the link is not paid by the byte."""
    sent_bytes: int = 0
    """As they went over the wire, IP and UDP headers included; by this computer's count."""
    received_bytes: int = 0
    charged_bytes: int = 0
    """What counts for the budget: with answers that have not come, since a provider may bill them."""
    price: Decimal | None = None
    counts: tuple[LinkCount, ...] = ()
    """Of every link of the site, the measured one among them."""
    way: Verdict = Verdict.INCONCLUSIVE
    """Whether the traffic left by the link that was meant, and by no other."""
    way_reason: str = ""
    path_mtu_up: int | None = None
    path_mtu_both: int | None = None
    path_mtu_reason: str = ""
    thresholds_name: str
    thresholds: QualifyProfile
    facts: dict[str, str] = {}
    """What the boxes said of the link at the beginning: signal, cell, version. Label to value."""
    remarks: tuple[str, ...] = ()
    time_zone: str = ""
    """The pilot's, as IANA names it, for pages; empty: UTC."""


def write_run(folder: Path, run: MeasuredRun) -> None:
    """Replace `run.json` of a run's folder at once."""
    write_atomically(folder / RUN_FILE, f"{run.model_dump_json(indent=1)}\n".encode())


def read_run(folder: Path) -> MeasuredRun:
    """Read it. OSError; ValueError: it is not one of this version."""
    return MeasuredRun.model_validate_json((folder / RUN_FILE).read_text(encoding="utf-8"))
