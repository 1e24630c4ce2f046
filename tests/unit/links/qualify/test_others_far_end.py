"""A far end of others: it answers STAMP without a key, so it measures less, and proves less, than ours."""

from dataclasses import replace
from ipaddress import IPv4Address
from pathlib import Path

import pytest
from simulated_network import SECOND, SimulatedNetwork, network

from atlantis_netcfg.core.errors import NoMatchError, UsageError
from atlantis_netcfg.inventory import load
from atlantis_netcfg.inventory.model import AllowedTarget, Transport
from atlantis_netcfg.links.qualify.budget import Budget, BudgetGuard
from atlantis_netcfg.links.qualify.figures import train_figures
from atlantis_netcfg.links.qualify.measured_run import Selection
from atlantis_netcfg.links.qualify.samples import Sample, StreamEnd
from atlantis_netcfg.links.qualify.session import ReflectorPeer
from atlantis_netcfg.operations.common.link_shapes import link_shapes
from atlantis_netcfg.operations.qualify.far_end import MeasuredFarEnd, far_end_of
from atlantis_netcfg.operations.qualify.measure import CountedTransport, Measurement
from atlantis_netcfg.operations.qualify.plan import build_plan

DECLARED = load(Path(__file__).parents[4] / "inventory")
BEARERS = {bearer.name: bearer for bearer in DECLARED.sites["coastal"].bearers}


@pytest.mark.parametrize(
    ("text", "port"), [("192.0.2.7", 862), ("192.0.2.7:862", 862), ("192.0.2.7:8620", 8620)], ids=str
)
def test_far_end_is_given_by_its_address(text: str, port: int) -> None:
    found = far_end_of(DECLARED, over_vpn=False, other=text)
    assert found == MeasuredFarEnd(text, "192.0.2.7", port, None)
    assert not found.is_ours


@pytest.mark.parametrize("text", ["", "router.example.net", "192.0.2", "192.0.2.7:", "192.0.2.7:65536", "224.0.0.1"])
def test_invalid_address_is_refused(text: str) -> None:
    with pytest.raises(UsageError, match="is not an IPv4 address"):
        far_end_of(DECLARED, over_vpn=False, other=text)


def test_vpn_measurement_needs_a_vpn_address() -> None:
    assert far_end_of(DECLARED, over_vpn=True, other="10.80.0.77").address == "10.80.0.77"
    with pytest.raises(UsageError, match="is not an address in the VPN"):
        far_end_of(DECLARED, over_vpn=True, other="192.0.2.7")


@pytest.mark.parametrize("selection", [Selection.IMAGES, Selection.THROUGHPUT, Selection.ALL])
def test_messages_need_our_own_far_end(selection: Selection) -> None:
    with pytest.raises(UsageError, match="` needs our own far end"):
        far_end_of(DECLARED, over_vpn=False, other="192.0.2.7").refuse(selection, [], DECLARED)
    far_end_of(DECLARED, over_vpn=False).refuse(selection, BEARERS.values(), DECLARED)


def test_satellite_must_allow_the_far_end() -> None:
    far, satellite = far_end_of(DECLARED, over_vpn=False, other="192.0.2.7"), BEARERS["satellite"]
    far.refuse(Selection.TELEMETRY, [BEARERS["4g"]], DECLARED)
    with pytest.raises(NoMatchError, match=r"`satellite` blocks traffic to 192\.0\.2\.7, UDP port 862"):
        far.refuse(Selection.TELEMETRY, BEARERS.values(), DECLARED)
    target = AllowedTarget(name="tester", address=IPv4Address("192.0.2.7"), port=862, transport=Transport.UDP)
    far.refuse(Selection.TELEMETRY, [satellite.model_copy(update={"allow": (*satellite.allow, target)})], DECLARED)


def measured(net: SimulatedNetwork) -> Measurement:
    plan = build_plan(BEARERS["4g"], Selection.TELEMETRY, is_rehearsal=True, confirms=False)
    kept: list[Sample] = []
    guard = BudgetGuard(Budget(), lambda: net.now / SECOND)
    found = Measurement(plan, ReflectorPeer(None, counts=False), CountedTransport(net), guard, kept.append)
    assert found.measure() == "done"
    return found


def test_packets_of_every_size_are_measured_without_messages() -> None:
    net = network(*link_shapes(BEARERS["4g"]), key=None)
    found = measured(net)
    figures = train_figures(found.samples, "idle")
    assert (figures.loss.sent, figures.loss.received) == (600, 600)
    assert (found.mtu.up, found.mtu.both) == (None, 1500)
    assert (found.plan.sizes, found.rates) == ((), [])
    ended = [sample.stream for sample in found.samples if isinstance(sample, StreamEnd)]
    assert ended == ["idle", *(cell.stream for cell in found.plan.cells)]
    assert found.transport.sent_bytes + found.transport.received_bytes <= found.plan.bytes


def test_direction_of_loss_is_not_guessed() -> None:
    """It tells no counters; its numbers alone say where, and of the last ones they do not."""
    up, down = link_shapes(BEARERS["4g"])
    net = network(replace(up, loss=0.05), down, key=None)
    loss = train_figures(measured(net).samples, "idle").loss
    assert loss.lost > 5
    assert (loss.up, loss.down) in {(loss.lost, 0), (None, None)}
