"""The satellite campaign, shortened: one size and one rate of each grid, through real OpenVPN and real Cyclone DDS."""

from dataclasses import replace
from importlib.util import find_spec

import pytest

if find_spec("cyclonedds") is None:
    pytest.skip("PyPI has no cyclonedds for this machine", allow_module_level=True)

from pathlib import Path

from satcom_campaign import CERTUS, campaign, cells
from satcom_page import page

from atlantis_netcfg.computers.dds import TUNING
from atlantis_netcfg.inventory.model import Pace
from atlantis_netcfg.links.qualify.profile import DirectionProfile, LinkProfile
from atlantis_netcfg.operations.common.link_shapes import build_shapes

pytestmark = [pytest.mark.slow, pytest.mark.namespace]
_ANNOUNCE_S = 2


def test_the_campaign_shortened(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    # Who is new is announced sooner than a pilot's satellite would have it: that alone would take 20 s.
    for pace in Pace:
        monkeypatch.setitem(TUNING, pace, replace(TUNING[pace], announce_s=_ANNOUNCE_S))
    grid = cells(2.0, shortened=True)
    done = campaign(tmp_path, grid, cell_s=2.0, idle_s=3.0, patience_s=1.0)
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


def test_full_grid_has_all_cells() -> None:
    grid = cells(60.0)
    assert len(grid) == 3 * 4 + 6 * 4
    assert len({cell.stream for cell in grid}) == len(grid)
    assert all(cell.messages >= 5 for cell in grid)


@pytest.mark.campaign
def test_the_vpn_and_dds_over_a_replayed_run(tmp_path: Path) -> None:
    """A measured run takes the link's place: its least delay and its loss are what tunnel and samples meet."""
    steps = tuple(0.2 + n / 1000 for n in range(50))
    way = DirectionProfile(
        delays_s=steps, loss=0.1, duplicates=0.0, reordered=0.0, reorder_s=0.0, rate_bps=1_000_000, mtu=None
    )
    profile = LinkProfile(
        run="4g-1", site="coastal", link="4g", kind="lte", emulated=True, recorded_s=600, interval_s=0.1,
        packet_octets=200, packets=50, split="", up=way, down=way, gaps=(),
    )  # fmt: skip
    grid = cells(5.0, shortened=True)
    done = campaign(tmp_path, grid, cell_s=5.0, idle_s=20.0, shapes=build_shapes(profile, None, None), link=profile.run)
    assert done.idle.rtt is not None
    assert 0.4 <= done.idle.rtt.min < 0.45
    assert done.idle.rtt.p50 == pytest.approx(0.449, rel=0.05), "the medians of both ways"
    assert done.idle.loss.share == pytest.approx(0.19, abs=0.05), "a tenth each way"
    assert min(delay for row in done.dds for delay in row.delays_s) >= 0.2
    assert "The link is run `4g-1`, replayed" in "\n".join(page(done))
