"""Several links, one after the other: limits hold for all together, and each link that was asked for has a result."""

import random
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from datetime import timedelta
from decimal import Decimal
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING, cast

import pytest
from example_runs import BEGUN, measured_run
from simulated_network import KEY, SECOND, SimulatedNetwork, network

from atlantis_netcfg.cli.qualify import _cap_limits, _preview
from atlantis_netcfg.core.errors import DeviceError, ExitCode, NetcfgError, OutcomeUnknown, UsageError
from atlantis_netcfg.core.events import Verdict
from atlantis_netcfg.emulator.udp_link import HEADERS, LinkShape
from atlantis_netcfg.inventory import Inventory, load
from atlantis_netcfg.inventory.model import Link
from atlantis_netcfg.links.cost import Tariff, bill
from atlantis_netcfg.links.qualify.budget import Budget, BudgetGuard
from atlantis_netcfg.links.qualify.judgement import profile
from atlantis_netcfg.links.qualify.measured_run import BudgetLimits, Selection
from atlantis_netcfg.links.qualify.record import make_record
from atlantis_netcfg.links.qualify.session import EndReason, ReflectorPeer
from atlantis_netcfg.operations.common.link_shapes import link_shapes
from atlantis_netcfg.operations.qualify.measure import CountedTransport, Measurement
from atlantis_netcfg.operations.qualify.plan import build_plan
from atlantis_netcfg.operations.qualify.result import QualifyResult
from atlantis_netcfg.operations.qualify.several import SeveralResults, measure_each, remaining_limits

if TYPE_CHECKING:
    from atlantis_netcfg.cli.base.session import CommandSession

DECLARED = load(Path(__file__).parents[4] / "inventory")
BEARERS = DECLARED.sites["coastal"].bearers
WIFI, MOBILE, SATELLITE = BEARERS
TARIFF = Tariff(Decimal("8.00"), min_session_bytes=5000, floor_bytes_per_s=300, floor_after_s=30)
"""An example; the floor holds early, so that these short runs meet it."""
DEAD = LinkShape(loss=1.0)


@dataclass
class Stand:
    """Measures links over a simulated network each, as the command does it over real ones."""

    dead: tuple[str, ...] = ()
    failures: dict[str, NetcfgError] = field(default_factory=dict)
    stopped: str = ""
    caps: dict[str, int] = field(default_factory=dict)
    lossy: float = 0.0
    used: dict[str, tuple[int, float]] = field(default_factory=dict)
    """Octets by the interface, and seconds, of each link."""

    def measure(self, bearer: Link, limits: BudgetLimits) -> QualifyResult:
        net = self._network(bearer)
        bounds = [each for each in (limits.max_bytes, self.caps.get(bearer.name)) if each is not None]
        price, tariff = (limits.max_price, TARIFF) if bearer.metered else (None, None)
        kept = limits.model_copy(update={"max_bytes": min(bounds, default=None), "max_price": price})
        plan = build_plan(bearer, Selection.TELEMETRY, is_rehearsal=True)
        budget = Budget(kept.max_bytes, kept.max_seconds, price, tariff, closing_s=plan.times.timeout_s)
        guard = BudgetGuard(budget, lambda: net.now / SECOND)
        measured = Measurement(plan, ReflectorPeer(KEY), CountedTransport(net), guard, lambda _sample: None)
        reason = EndReason.STOPPED if bearer.name == self.stopped else measured.measure()
        seconds = net.now / SECOND
        net.drain()
        self.used[bearer.name] = net.up.sent_bytes + net.delivered_bytes, seconds
        run = measured_run(
            link=bearer.name,
            reason=reason,
            begun=BEGUN,
            ended=BEGUN + timedelta(seconds=seconds),
            budget=kept,
            tariff=tariff,
            currency=None if tariff is None else "EUR",
            sent_bytes=measured.transport.sent_bytes,
            received_bytes=measured.transport.received_bytes,
            charged_bytes=guard.charged_bytes,
            price=guard.current_bill().price,
            selection=Selection.TELEMETRY,
            thresholds=profile("satellite").model_copy(update={"gap_s": 5.0}),
        )
        return QualifyResult(make_record(run, measured.samples), Path("/nowhere"), self.failures.get(bearer.name))

    def _network(self, bearer: Link) -> SimulatedNetwork:
        if bearer.name in self.dead:
            return network(DEAD, DEAD)
        if self.lossy:
            return network(LinkShape(loss=self.lossy, delay_s=0.3), LinkShape(loss=self.lossy, delay_s=0.3))
        return network(*link_shapes(bearer))


def together(stand: Stand, links: Sequence[Link] = BEARERS, **limits: object) -> SeveralResults:
    return measure_each(links, BudgetLimits.model_validate(limits), stand.measure)


def test_all_links_pass() -> None:
    found = together(Stand())
    assert [each.run.link for each in found.results] == ["wifi-ptp", "4g", "satellite"]
    assert {each.run.reason for each in found.results} == {"done"}
    assert (found.not_measured, found.exit) == ((), ExitCode.DONE)


def test_dead_link_ends_early_and_the_others_are_measured() -> None:
    stand = Stand(dead=("4g",))
    found = together(stand)
    assert [(each.run.link, each.run.reason) for each in found.results] == [
        ("wifi-ptp", "done"),
        ("4g", "no answer"),
        ("satellite", "done"),
    ]
    assert [each.exit for each in found.results] == [ExitCode.DONE, ExitCode.CHECKS_FAILED, ExitCode.DONE]
    assert found.exit is ExitCode.CHECKS_FAILED
    down = found.results[1]
    assert down.record.verdict is not Verdict.PASS
    assert any("no response, so the rest was skipped" in line for line in down.lines())
    assert down.record.telemetry == ()


def test_lost_router_session_is_reported_and_others_are_measured() -> None:
    found = together(Stand(failures={"wifi-ptp": DeviceError("the session is lost")}))
    assert [each.run.link for each in found.results] == ["wifi-ptp", "4g", "satellite"]
    assert found.exit is ExitCode.FAILED
    assert found.results[0].as_json()["error"] == "the session is lost"


def test_unknown_router_state_stops_all_measurements() -> None:
    found = together(Stand(failures={"wifi-ptp": OutcomeUnknown("the rows are not seen to be gone")}))
    assert [each.link for each in found.not_measured] == ["4g", "satellite"]
    assert found.exit is ExitCode.UNKNOWN


def test_user_stop_ends_all_and_lists_unmeasured_links() -> None:
    found = together(Stand(stopped="4g"))
    assert [each.run.link for each in found.results] == ["wifi-ptp", "4g"]
    assert [each.line() for each in found.not_measured] == ["satellite: not measured: the measurement was interrupted"]
    assert found.exit is not ExitCode.DONE


def test_unmeasured_link_makes_the_whole_run_fail() -> None:
    """NOTHING is no bad code where codes are compared: beside a link that passes it would be lost."""
    found = together(Stand(caps={"4g": 0}))
    assert [each.exit for each in found.results] == [ExitCode.DONE, ExitCode.NOTHING, ExitCode.DONE]
    assert found.exit is ExitCode.CHECKS_FAILED


def test_link_cap_applies_to_its_link_and_total_limit_to_all() -> None:
    capped = together(Stand(caps={"4g": 100_000}), max_bytes=5_000_000)
    assert [(each.run.link, each.run.reason) for each in capped.results][1:] == [("4g", "bytes"), ("satellite", "done")]
    limited = together(Stand(), max_bytes=400_000)
    assert [(each.run.link, each.run.reason) for each in limited.results] == [("wifi-ptp", "done"), ("4g", "bytes")]
    assert [each.line() for each in limited.not_measured] == [
        "satellite: not measured: the data limit was reached before"
    ]
    assert limited.exit is ExitCode.CHECKS_FAILED


def test_price_limit_applies_to_metered_links_only() -> None:
    found = together(Stand(), (SATELLITE, WIFI, MOBILE), max_price=Decimal("0.40"))
    assert [(each.run.link, each.run.reason) for each in found.results] == [
        ("satellite", "money"),
        ("wifi-ptp", "done"),
    ]
    assert [(each.link, each.why) for each in found.not_measured] == [("4g", "the cost limit was reached before")]


def test_lost_replies_are_billed() -> None:
    (found,) = together(Stand(dead=("satellite",)), (SATELLITE,)).results
    run = found.run
    assert run.received_bytes == 0
    assert run.charged_bytes > 1.5 * run.sent_bytes
    rest = remaining_limits(BudgetLimits(max_bytes=1_000_000, max_seconds=1e6, max_price=Decimal(9)), found)
    assert rest.max_bytes == 1_000_000 - run.charged_bytes
    assert rest.max_price is not None
    assert run.price is not None
    assert rest.max_price < Decimal(9) - run.price
    assert remaining_limits(BudgetLimits(max_bytes=10, max_price=Decimal("0.01")), found) == BudgetLimits(
        max_bytes=0, max_price=Decimal(0)
    )


def test_price_limit_needs_a_tariff_in_the_same_currency() -> None:
    limits = BudgetLimits(max_price=Decimal(1))
    assert preview(SATELLITE, limits, DECLARED)
    assert preview(WIFI, limits, DECLARED)
    with pytest.raises(UsageError, match="the tariff of `4g` in the inventory is not in EUR") as caught:
        preview(MOBILE, limits, DECLARED)
    assert caught.value.hint == "set `billing` of link `4g` in group_vars/coastal.yml in the inventory"
    billing = SATELLITE.billing
    assert billing is not None
    dollars = MOBILE.model_copy(update={"billing": billing.model_copy(update={"currency": "USD"})})
    site = DECLARED.sites["coastal"].model_copy(update={"bearers": (WIFI, dollars, SATELLITE)})
    with pytest.raises(UsageError, match="the tariff of `4g` in the inventory is not in EUR"):
        preview(dollars, limits, replace(DECLARED, sites={**DECLARED.sites, "coastal": site}))


def test_price_limit_skips_free_links_and_cap_still_applies() -> None:
    limits = BudgetLimits(max_price=Decimal(1), max_bytes=9_000_000)
    opened = cast("CommandSession", SimpleNamespace(inventory=DECLARED, site="coastal"))
    assert _cap_limits(opened, WIFI, limits) == BudgetLimits(max_bytes=9_000_000)
    assert _cap_limits(opened, SATELLITE, limits) == BudgetLimits(max_price=Decimal(1), max_bytes=5_000_000)


def preview(bearer: Link, limits: BudgetLimits, declaration: Inventory) -> str:
    opened = SimpleNamespace(
        inventory=declaration,
        site="coastal",
        is_rehearsal=True,
        arguments=SimpleNamespace(optional=lambda _word: None),
    )
    return _preview(cast("CommandSession", opened), bearer, Selection.TELEMETRY, limits).words


@pytest.mark.parametrize("seed", range(12))
def test_total_limits_are_exceeded_by_at_most_one_packet(seed: int) -> None:
    draw = random.Random(seed)  # noqa: S311 - a test
    max_price = Decimal(draw.randrange(20, 6000)) / 1000
    max_bytes = draw.choice([None, draw.randrange(20_000, 900_000)])
    stand = Stand(lossy=draw.choice([0.0, 0.02, 0.3]))
    together(stand, (MOBILE, SATELLITE), max_price=max_price, max_bytes=max_bytes)
    packet = 1500 + HEADERS
    prices = [bill(octets, seconds, TARIFF).price for octets, seconds in stand.used.values()]
    dearer = bill(packet, 0, Tariff(TARIFF.price_per_mb)).price
    assert dearer is not None
    assert sum(price for price in prices if price is not None) <= max_price + dearer
    assert max_bytes is None or sum(octets for octets, _ in stand.used.values()) <= max_bytes + packet
