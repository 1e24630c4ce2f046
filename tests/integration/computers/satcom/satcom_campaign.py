"""The satellite tests of the report (Tables 33 and 34) through an emulated Certus link, real OpenVPN and real DDS.

    make satcom ARGS='[--cell-s SECONDS] [--profile RUN] [--write]'

A gateway is a member of the pilot's VPN, each file as the product writes it, in network namespaces (root). Its packets
to the server pass the emulated link. Every cell of the grids is sent twice from the gateway to the control centre,
through the tunnel: as test packets of `provision measure link`, and as best-effort samples of Cyclone DDS with the
profile of `provision robot dds`. `--profile`: the link is not Certus as assumed here, but a measured run, replayed.
`--write` makes docs/engineers/satcom.md and its pictures of what was measured.
"""

import argparse
import json
import re
import sys
import tempfile
import time
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path

from dds_stand import Participant
from matrix_papers import host
from matrix_stand import Vpn, vpn
from satcom_page import write_page

from atlantis_netcfg.computers.dds import profile_views, profiles
from atlantis_netcfg.emulator.udp_link import LinkShape
from atlantis_netcfg.inventory import load
from atlantis_netcfg.inventory.model import Dds, RosDistribution, RosMiddleware
from atlantis_netcfg.links.qualify.figures import TrainFigures, train_figures
from atlantis_netcfg.links.qualify.grids import (
    IMAGE_RATES_HZ,
    IMAGES,
    TELEMETRY_RATES_HZ,
    TELEMETRY_SIZES,
    RateRow,
    image_row,
    telemetry_row,
)
from atlantis_netcfg.links.qualify.profile import read_profile
from atlantis_netcfg.links.qualify.responses import answered_packets
from atlantis_netcfg.links.qualify.samples import PacketSent, ReplySample, Sample, read
from atlantis_netcfg.links.qualify.transfers import message_figures
from atlantis_netcfg.operations.common.link_shapes import build_shapes

ROOT = Path(__file__).parents[4]
PROGRAMS = Path(__file__).with_name("programs")
GATEWAY, CENTRE = "coastal-gateway", "scc-control"
CERTUS = (LinkShape(352_000, 0.28, jitter_s=0.025, loss=0.01), LinkShape(704_000, 0.28, jitter_s=0.025, loss=0.01))
"""Up and down, as facts of such links have it: no gaps, a queue of 64 kB each way."""
KEY = b"an example key, 32 octets long.."
PORT = 862
_AROUND = 28 + 50 + 136
"""Octets around those of a chunk: IP and UDP, OpenVPN about, and STAMP with its extensions."""
_FEWEST = 5
"""Messages of a cell."""
_PATIENCE_S = 120.0
_COUNT = """\
table ip satcom {
  counter up {}
  counter down {}
  chain out { type filter hook output priority 0; oifname "eth0" counter name up; }
  chain in { type filter hook input priority 0; iifname "eth0" counter name down; }
}
"""


@dataclass(frozen=True)
class Cell:
    """A size at a rate."""

    kind: str
    label: str
    octets: int
    rate_hz: float
    seconds: float

    @property
    def stream(self) -> str:
        """Its name in samples, as `measured_run` has it."""
        return f"{self.kind} {self.label} {self.rate_hz:g}"

    @property
    def messages(self) -> int:
        return max(1, round(self.rate_hz * self.seconds))


@dataclass(frozen=True)
class DdsRow:
    """What became of a cell as DDS samples; the delay is one way."""

    cell: Cell
    sent: int
    delays_s: tuple[float, ...]


@dataclass(frozen=True)
class Campaign:
    """All that was measured."""

    at: datetime
    cell_s: float
    shapes: tuple[LinkShape, LinkShape]
    link: str
    idle: TrainFigures
    round_trips_s: tuple[float, ...]
    packets: tuple[RateRow, ...]
    dds: tuple[DdsRow, ...]
    up_bytes: int
    down_bytes: int
    """On the gateway's interface, the tunnel around everything, the whole campaign."""


def cells(cell_s: float, *, shortened: bool = False) -> list[Cell]:
    """Both grids; `shortened`: one size and one rate of each."""
    telemetry = [(size, rate) for size in TELEMETRY_SIZES for rate in TELEMETRY_RATES_HZ]
    images = [(image, rate) for image in IMAGES for rate in IMAGE_RATES_HZ]
    if shortened:
        telemetry, images = [(TELEMETRY_SIZES[1], 10.0)], [(IMAGES[0], 2.0)]
    return [
        *(Cell("telemetry", f"{size}", size, rate, _seconds(rate, cell_s)) for size, rate in telemetry),
        *(Cell("image", image.label, image.octets, rate, _seconds(rate, cell_s)) for image, rate in images),
    ]


def _seconds(rate_hz: float, cell_s: float) -> float:
    return max(cell_s, _FEWEST / rate_hz)


def campaign(  # noqa: PLR0913 - each is a choice of who runs it
    folder: Path,
    grid: Sequence[Cell],
    *,
    cell_s: float,
    idle_s: float,
    shapes: tuple[LinkShape, LinkShape] = CERTUS,
    link: str = "",
    patience_s: float = 3.0,
) -> Campaign:
    """Measure every cell as test packets, then as DDS samples; `patience_s` is for answers and between two cells."""
    shipped = load(ROOT / "inventory")
    dds = Dds(distribution=RosDistribution.HUMBLE, middleware=RosMiddleware.CYCLONE_DDS)
    declaration = replace(shipped, pilot=shipped.pilot.model_copy(update={"dds": dds}))
    wishes = [host(declaration, name) for name in (GATEWAY, CENTRE)]
    with vpn(declaration, wishes, folder, slow=[GATEWAY], shapes=shapes) as made:
        made.run(GATEWAY, "nft", "-f", "-", text=_COUNT)
        samples = _test_packets(made, folder, grid, idle_s, patience_s)
        heard = _dds_samples(made, folder, grid, patience_s)
        up, down = _counted(made, "up"), _counted(made, "down")
    idle = train_figures(samples, "idle")
    assert idle.rtt is not None, "nothing was answered through the tunnel"
    return Campaign(
        at=datetime.now(UTC),
        cell_s=cell_s,
        shapes=shapes,
        link=link,
        idle=idle,
        round_trips_s=_round_trips(samples),
        packets=tuple(_row(samples, cell, idle.rtt.p50, shapes[0].rate_bps) for cell in grid),
        dds=heard,
        up_bytes=up,
        down_bytes=down,
    )


def _test_packets(made: Vpn, folder: Path, grid: Sequence[Cell], idle_s: float, patience_s: float) -> list[Sample]:
    key, plan, file = folder / "stamp.key", folder / "stamp.json", folder / "samples.jsonl"
    key.write_bytes(KEY)
    address = str(made.authority.membership().members[CENTRE].address)
    rows = [[cell.kind, cell.label, cell.octets, cell.rate_hz, cell.seconds] for cell in grid]
    told = {"far_end": [address, PORT], "key": str(key), "samples": str(file), "idle_s": idle_s}
    plan.write_text(json.dumps({**told, "cells": rows, "patience_s": patience_s}))
    reflector = ("-P", "-m", "atlantis_netcfg.links.qualify.reflector", "--address", address, "--port", str(PORT))
    far = Participant("reflector", made.start(CENTRE, sys.executable, *reflector, "--key-file", str(key)))
    assert far.wait(lambda: any("ready" in line for line in far.lines), time.monotonic() + _PATIENCE_S), far.lines
    made.run(GATEWAY, sys.executable, "-P", str(PROGRAMS / "stamp_cells.py"), str(plan))
    far.process.terminate()
    with file.open(encoding="utf-8") as lines:
        return [*read(lines)]


def _dds_samples(made: Vpn, folder: Path, grid: Sequence[Cell], patience_s: float) -> tuple[DdsRow, ...]:
    plan = folder / "dds.json"
    rows = [[cell.kind, cell.label, cell.octets, cell.rate_hz, cell.seconds] for cell in grid]
    plan.write_text(json.dumps({"cells": rows, "patience_s": patience_s}))
    both = {}
    for name, what in ((CENTRE, "hear"), (GATEWAY, "publish")):
        views = profile_views(made.declaration, made.declaration.hosts[name], "pypi")
        view = max(views, key=lambda one: one.tuning.announce_s)
        path = folder / f"{name}.xml"
        path.write_text(profiles(view)[f"{view.link}/cyclonedds.xml"], encoding="utf-8")
        command = (sys.executable, "-P", str(PROGRAMS / "dds_cells.py"), what, str(plan))
        both[what] = Participant(name, made.start(name, *command, environment={"CYCLONEDDS_URI": str(path)}))
    publisher, hearer = both["publish"], both["hear"]
    lasts = sum(cell.seconds + 2 * patience_s for cell in grid) + _PATIENCE_S
    assert publisher.wait(lambda: "done" in publisher.lines, time.monotonic() + lasts), publisher.lines + hearer.lines
    delays: dict[int, list[float]] = {}
    for line in list(hearer.lines):
        if found := re.fullmatch(r"heard (\d+) ([\d.]+)", line):
            delays.setdefault(int(found[1]), []).append(float(found[2]))
    return tuple(DdsRow(cell, cell.messages, tuple(delays.get(number, ()))) for number, cell in enumerate(grid))


def _counted(made: Vpn, name: str) -> int:
    said = made.run(GATEWAY, "nft", "list", "counter", "ip", "satcom", name)
    return int(re.findall(r"bytes (\d+)", said)[0])


def _row(samples: Sequence[Sample], cell: Cell, idle_p50_s: float, rate_bps: float | None) -> RateRow:
    if cell.kind == "telemetry":
        return telemetry_row(cell.octets, cell.rate_hz, train_figures(samples, cell.stream), idle_p50_s)
    image = next(image for image in IMAGES if image.label == cell.label)
    figures = message_figures(samples, cell.stream)
    assert figures is not None
    sending_s = (figures.size + figures.chunks * _AROUND) * 8 / rate_bps if rate_bps is not None else 0.0
    return image_row(image, cell.rate_hz, figures, idle_p50_s + sending_s)


def _round_trips(samples: Sequence[Sample]) -> tuple[float, ...]:
    idle = [sample for sample in samples if sample.stream == "idle"]
    pairs = answered_packets(
        [sample for sample in idle if isinstance(sample, PacketSent)],
        [sample for sample in idle if isinstance(sample, ReplySample)],
    )
    return tuple(pair.rtt / 1e9 for pair in pairs)


def main() -> None:
    """Run it, and say it or write the page."""
    words = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    words.add_argument("--cell-s", type=float, default=60.0, help="how long each cell is sent (60)")
    words.add_argument("--idle-s", type=float, default=60.0, help="how long the link is measured without load (60)")
    words.add_argument("--profile", help="a measured run (its folder or profile.json) in place of the assumed link")
    words.add_argument("--write", action="store_true", help="write docs/engineers/satcom.md and its pictures")
    chosen = words.parse_args()
    shapes, link = CERTUS, ""
    if chosen.profile is not None:
        profile = read_profile(Path(chosen.profile))
        shapes, link = build_shapes(profile, CERTUS[0].rate_bps, CERTUS[1].rate_bps), profile.run
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        done = campaign(
            folder, cells(chosen.cell_s), cell_s=chosen.cell_s, idle_s=chosen.idle_s, shapes=shapes, link=link
        )
    if chosen.write:
        write_page(done, ROOT / "docs")
    else:
        sys.stdout.write("\n".join(write_page(done, None)) + "\n")


if __name__ == "__main__":
    main()
