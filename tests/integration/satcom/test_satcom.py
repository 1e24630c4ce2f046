"""The satellite campaign, shortened: one size and one rate of each grid, through real OpenVPN and real Cyclone DDS."""

from __future__ import annotations

from importlib.util import find_spec
from typing import TYPE_CHECKING

import pytest

if find_spec("cyclonedds") is None:
    pytest.skip("PyPI has no cyclonedds for this machine", allow_module_level=True)

from satcom_campaign import CERTUS, campaign, cells
from satcom_page import page

if TYPE_CHECKING:
    from pathlib import Path

pytestmark = [pytest.mark.slow, pytest.mark.namespace, pytest.mark.timeout(240)]


def test_the_campaign_shortened(tmp_path: Path) -> None:
    grid = cells(2.0, shortened=True)
    done = campaign(tmp_path, grid, cell_s=2.0, idle_s=3.0)
    assert done.idle.rtt is not None
    assert done.idle.rtt.min >= CERTUS[0].delay_s + CERTUS[1].delay_s
    assert done.idle.rtt.p50 == pytest.approx(0.62, rel=0.15), "280 ms each way, their jitter, and the tunnel"
    assert [row.sent for row in done.packets] == [cell.messages for cell in grid]
    telemetry, image = done.packets
    assert telemetry.received >= 0.8 * telemetry.sent
    assert image.p50_s is None or image.p50_s > done.idle.rtt.min
    sent = sum(row.sent for row in done.dds)
    heard = [delay for row in done.dds for delay in row.delays_s]
    assert len(heard) >= 0.6 * sent, "an image in fragments is lost with one of them"
    assert min(heard) >= CERTUS[0].delay_s
    on_the_wire = sum(cell.messages * cell.octets * 2 for cell in grid)
    assert done.up_bytes > on_the_wire, "as packets and as samples, the tunnel around them"
    lines = page(done)
    assert any("emulated" in line for line in lines[:6])
    assert sum(line.startswith("| 128 B ") for line in lines) == 2


def test_the_full_grids_are_those_of_the_tables() -> None:
    grid = cells(60.0)
    assert len(grid) == 3 * 4 + 6 * 4
    assert len({cell.stream for cell in grid}) == len(grid)
    assert all(cell.messages >= 5 for cell in grid)
