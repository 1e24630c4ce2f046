"""Who is asked before what is sent over which link, and what is written down after: against the shipped declaration."""

import ast
import inspect
from collections.abc import Callable
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pytest

from atlantis_netcfg.cli.base.commands import COMMANDS, load
from atlantis_netcfg.cli.base.syntax import ACCEPT_COST
from atlantis_netcfg.core.errors import ExitCode, UsageError
from atlantis_netcfg.core.events import ignore
from atlantis_netcfg.core.versions import Version
from atlantis_netcfg.inventory import Inventory
from atlantis_netcfg.inventory import load as load_inventory
from atlantis_netcfg.inventory.model import LteDriver, LteRouter
from atlantis_netcfg.links.cost import CostRefusal
from atlantis_netcfg.operations import Mode, Request, Target, apply
from atlantis_netcfg.operations.common.costs import Costs, Meter, ports_of, preview_costs, require_consent, ways_of
from atlantis_netcfg.operations.common.jobs import device_job
from atlantis_netcfg.operations.common.kinds import get_managed_device, is_supported
from atlantis_netcfg.operations.common.request import ACCEPT_COST as ACCEPT
from atlantis_netcfg.operations.common.request import REMOVE_FOREIGN, of_variables
from atlantis_netcfg.operations.common.site_links import links_of
from atlantis_netcfg.routeros import DeviceResult, Status
from atlantis_netcfg.routeros._types import Facts, Observation, PortCounts
from atlantis_netcfg.routeros.estimate import MOST_TEXT, Estimate
from atlantis_netcfg.runs import CostRecord, NoJournal, Record, Store

INVENTORY = Path(__file__).parents[4] / "inventory"
ROUTER = "coastal-router"
FACTS = Facts(
    identity="r",
    version=Version(7, 18, 2),
    board="b",
    architecture="a",
    device_mode={},
    packages=(),
    policies=frozenset(),
    has_safe_mode=True,
    safe_mode_owner=None,
    session_address="",
    history=0,
)
NOON = datetime(2026, 11, 21, 12, tzinfo=UTC)
SMALL = Estimate("satellite", 10, 30_000, 20_000, 20.0, sessions=2)
HUGE = Estimate("satellite", 10, 30_000, 9_000_000, 20.0, sessions=2)


@pytest.fixture(scope="module")
def declaration() -> Inventory:
    return load_inventory(INVENTORY)


def capped(declaration: Inventory, cap_mb: float) -> Inventory:
    """The declaration with another cap on coastal's satellite."""
    there = declaration.sites["coastal"]
    bearers = tuple(
        one.model_copy(update={"cap_mb": cap_mb}) if one.name == "satellite" else one for one in there.bearers
    )
    return replace(declaration, sites={**declaration.sites, "coastal": there.model_copy(update={"bearers": bearers})})


def request(tmp_path: Path, via: str | None = "satellite", **more: Any) -> Request:  # noqa: ANN401 - fields of Request
    return Request(state=tmp_path, via={ROUTER: via} if via else {}, command="provision site=coastal", **more)


def routes(*bearers: str) -> Observation:
    """A router whose active default routes lead to the next hops of these bearers."""
    hops = {"wifi-ptp": "10.10.0.1", "4g": "10.10.1.1", "satellite": "10.10.2.1"}
    rows = tuple(
        {"dst-address": "0.0.0.0/0", "gateway": hops[name], "active": "true", "distance": "1"} for name in bearers
    )
    return Observation(FACTS, {"/ip/route": rows})


# --- before the first byte ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("mode", list(Mode))
def test_metered_link_needs_consent(declaration: Inventory, tmp_path: Path, mode: Mode) -> None:
    with pytest.raises(
        CostRefusal, match=r"nothing was sent: over metered link satellite of coastal: .* [0-9.]+ EUR$"
    ) as refused:
        require_consent(declaration, [declaration.hosts[ROUTER]], request(tmp_path, mode=mode))
    assert refused.value.exit is ExitCode.FAILED
    assert "`--accept-cost`" in (refused.value.hint or "")
    require_consent(declaration, [declaration.hosts[ROUTER]], request(tmp_path, mode=mode, accept_cost=True))


def test_gateway_over_a_metered_link_needs_consent(declaration: Inventory, tmp_path: Path) -> None:
    gateway = declaration.hosts["coastal-gateway"]
    over = {"via": {gateway.name: "satellite"}, "command": "provision site=coastal"}
    for mode in (Mode.PLAN, Mode.APPLY, Mode.DRIFT):
        asked = Request(state=tmp_path, mode=mode, **over)
        with pytest.raises(CostRefusal, match="nothing was sent: over metered link satellite of coastal: "):
            require_consent(declaration, [gateway], asked)
        require_consent(declaration, [gateway], asked.model_copy(update={"accept_cost": True}))
    (look,) = preview_costs(declaration, [gateway], Request(state=tmp_path, mode=Mode.PLAN, **over))
    (work,) = preview_costs(declaration, [gateway], Request(state=tmp_path, **over))
    assert (look.at_most, work.at_most) == (False, True)
    assert look.bill.payload_bytes < work.bill.payload_bytes < 200_000
    assert look.bill.seconds < work.bill.seconds
    both = preview_costs(declaration, [gateway, declaration.hosts[ROUTER]], request(tmp_path))
    assert both == preview_costs(declaration, [declaration.hosts[ROUTER]], request(tmp_path)), "each by its own way"
    require_consent(declaration, [gateway], Request(state=tmp_path, mode=Mode.BACKUP, **over))
    with pytest.raises(CostRefusal, match="the limit for one action is"):
        require_consent(capped(declaration, 0.05), [gateway], Request(state=tmp_path, accept_cost=True, **over))


def test_playbook_refusal_names_the_ansible_variable(declaration: Inventory, tmp_path: Path) -> None:
    plain = Request(state=tmp_path, via={ROUTER: "satellite"})
    with pytest.raises(CostRefusal) as refused:
        require_consent(declaration, [declaration.hosts[ROUTER]], plain)
    assert "`-e atlantis_accept_cost=true`" in (refused.value.hint or "")


def test_unmetered_link_needs_no_consent(declaration: Inventory, tmp_path: Path) -> None:
    for via in (None, "lan", "wifi-ptp"):
        require_consent(declaration, [declaration.hosts[ROUTER]], request(tmp_path, via))


def test_a_rehearsal_costs_nothing(declaration: Inventory, tmp_path: Path) -> None:
    require_consent(capped(declaration, 0.001), [declaration.hosts[ROUTER]], request(tmp_path, rehearsed=True))


def test_unknown_link_is_always_refused(declaration: Inventory, tmp_path: Path) -> None:
    for more in ({"rehearsed": True}, {"accept_cost": True}, {}):
        with pytest.raises(UsageError, match="coastal has no such link"):
            require_consent(declaration, [declaration.hosts[ROUTER]], request(tmp_path, "uplink", **more))


def test_consent_does_not_lift_the_cap(declaration: Inventory, tmp_path: Path) -> None:
    with pytest.raises(CostRefusal, match=r"the limit for one action is 1\.0 kB") as refused:
        require_consent(capped(declaration, 0.001), [declaration.hosts[ROUTER]], request(tmp_path, accept_cost=True))
    assert "`cap_mb` of link `satellite` in group_vars/coastal.yml" in (refused.value.hint or "")


def test_declared_metered_link_is_priced_by_default(declaration: Inventory, tmp_path: Path) -> None:
    asked = Request(state=tmp_path, mode=Mode.PLAN)
    (found,) = preview_costs(declaration, [declaration.hosts["te4sea-router"], declaration.hosts[ROUTER]], asked)
    assert (found.link.site, found.link.name) == ("te4sea", "satellite")


def test_unit_without_its_own_link_is_reached_like_its_router(declaration: Inventory, tmp_path: Path) -> None:
    unit = declaration.hosts["te4sea-4g"]
    assert isinstance(unit.device, LteRouter)
    assert unit.device.driver is LteDriver.RUTOS
    (declared,) = preview_costs(declaration, [unit], Request(state=tmp_path))
    assert declared.link.name == "satellite"
    (named,) = preview_costs(declaration, [unit], Request(state=tmp_path, via={unit.name: "4g"}))
    assert named.link.name == "4g"
    assert preview_costs(declaration, [unit], Request(state=tmp_path, via={"te4sea-router": "lan"})) == ()
    assert preview_costs(declaration, [declaration.hosts["te4sea-sat"]], Request(state=tmp_path)) == ()
    with pytest.raises(CostRefusal, match="the cost was not accepted"):
        require_consent(declaration, [unit], Request(state=tmp_path, mode=Mode.PLAN))


@pytest.mark.parametrize(
    ("said", "meant"), [(True, True), ("true", True), ("Yes", True), (False, False), ("no", False), ("False", False)]
)
def test_ansible_booleans_are_parsed(said: object, *, meant: bool) -> None:
    assert of_variables({ACCEPT: said}) == {"accept_cost": meant}
    assert of_variables({REMOVE_FOREIGN: said}) == {"remove_foreign": meant}
    assert of_variables({}) == {}


@pytest.mark.parametrize("said", ["perhaps", "", 1, None])
def test_ambiguous_ansible_values_are_refused(said: object) -> None:
    for name in (ACCEPT, REMOVE_FOREIGN):
        with pytest.raises(UsageError, match=f"{name} is neither true nor false"):
            of_variables({name: said})


def test_device_costs_are_summed_and_reading_costs_less(declaration: Inventory, tmp_path: Path) -> None:
    router = declaration.hosts[ROUTER]
    (one,) = preview_costs(declaration, [router], request(tmp_path, mode=Mode.DRIFT))
    (two,) = preview_costs(declaration, [router, router], request(tmp_path, mode=Mode.DRIFT))
    (planned,) = preview_costs(declaration, [router], request(tmp_path, mode=Mode.PLAN))
    (saved,) = preview_costs(declaration, [router], request(tmp_path, mode=Mode.BACKUP))
    (written,) = preview_costs(declaration, [router], request(tmp_path))
    assert two.bill.payload_bytes == 2 * one.bill.payload_bytes
    assert saved.bill.payload_bytes < one.bill.payload_bytes < planned.bill.payload_bytes < written.bill.payload_bytes
    assert ": about " in one.words
    assert ": up to " in planned.words, "its parser may have to be shown a whole text"


def test_upper_bound_covers_every_text_of_the_pilot(declaration: Inventory, tmp_path: Path) -> None:
    texts = [
        text
        for host in declaration.hosts.values()
        if is_supported(host)
        for text in get_managed_device(declaration, host).texts()
    ]
    longest = max(len(text.text.encode()) for text in texts)
    assert longest < MOST_TEXT < 2 * longest
    (found,) = preview_costs(declaration, [declaration.hosts[ROUTER]], request(tmp_path))
    assert ": up to " in found.words
    assert (
        found.bill.payload_bytes
        > 2 * longest
        + 2
        * preview_costs(declaration, [declaration.hosts[ROUTER]], request(tmp_path, mode=Mode.DRIFT))[
            0
        ].bill.payload_bytes
    )


def test_direct_apply_call_needs_consent(
    declaration: Inventory, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    real = replace(declaration, pilot=declaration.pilot.model_copy(update={"example_values": False}))
    monkeypatch.setattr(apply, "open_inventory", lambda *_, **__: real)
    for plan_only in (True, False):
        with pytest.raises(CostRefusal, match="the cost was not accepted"):
            apply.perform(INVENTORY, ["te4sea-router"], {"state": str(tmp_path)}, plan_only=plan_only, decrypt=str)
    assert not (tmp_path / "real").exists()


def source_of(function: Callable[..., object]) -> str:
    """The source of a function and of all functions of its module that it reaches."""
    module = inspect.getmodule(function)
    tree = ast.parse(inspect.getsource(module)) if module is not None else ast.Module([], [])
    functions = {node.name: node for node in tree.body if isinstance(node, ast.FunctionDef)}
    reached: set[str] = set()
    names = {function.__name__}
    while names := (names - reached) & functions.keys():
        reached |= names
        nodes = [node for name in names for node in ast.walk(functions[name])]
        names = {node.id for node in nodes if isinstance(node, ast.Name)}
    return "\n".join(ast.unparse(functions[name]) for name in sorted(reached))


def test_every_command_over_a_link_accepts_the_cost_flag() -> None:
    """First contact goes over the technician's cable or a serial line only: there is nothing to pay."""
    opening = [name for name in COMMANDS if "cli.base.session import session" in source_of(load(name, COMMANDS).run)]
    assert len(opening) > 5
    for name in opening:
        assert ACCEPT_COST in load(name, COMMANDS).command.flags, name
    assert ACCEPT_COST not in load("device adopt", COMMANDS).command.flags


# --- beside the run ----------------------------------------------------------------------------------------------


def test_without_a_route_the_declared_link_is_assumed(declaration: Inventory, tmp_path: Path) -> None:
    meter = Meter(declaration, declaration.hosts[ROUTER], request(tmp_path, accept_cost=True))
    admission = meter.judge(routes(), SMALL, spends=True, is_plan=False)
    assert (admission.notes, admission.refusal) == ((), None)
    assert (meter.active, meter.link.name) == (None, "satellite")


def test_run_stops_when_traffic_falls_back_to_a_metered_link(declaration: Inventory, tmp_path: Path) -> None:
    meter = Meter(declaration, declaration.hosts[ROUTER], request(tmp_path, "wifi-ptp"))
    refused = meter.judge(routes("4g"), SMALL, spends=True, is_plan=False)
    (note,) = refused.notes
    assert note == (
        f"the inventory reaches {ROUTER} over wifi-ptp, but its traffic uses 4g now, which is metered: wifi-ptp is down"
    )
    assert refused.refusal is not None
    assert refused.refusal.startswith("the cost was not accepted: over metered link 4g of coastal: ")
    assert refused.hint == "run the same command with `--accept-cost`, or wait until wifi-ptp is up again"
    for harmless in ({"spends": False, "is_plan": False}, {"spends": True, "is_plan": True}):
        told = meter.judge(routes("4g"), SMALL, **harmless)
        assert (told.notes, told.refusal) == (refused.notes, None)
    accepted = Meter(declaration, declaration.hosts[ROUTER], request(tmp_path, "wifi-ptp", accept_cost=True))
    assert accepted.judge(routes("4g"), SMALL, spends=True, is_plan=False).refusal is None


def test_better_link_than_declared_is_noted_without_a_refusal(declaration: Inventory, tmp_path: Path) -> None:
    meter = Meter(declaration, declaration.hosts[ROUTER], request(tmp_path, accept_cost=True))
    admission = meter.judge(routes("wifi-ptp"), SMALL, spends=True, is_plan=False)
    assert admission.notes[0].endswith("but its traffic uses wifi-ptp now")
    assert admission.refusal is None
    assert not meter.link.is_metered


def test_session_over_the_cable_uses_no_link(declaration: Inventory, tmp_path: Path) -> None:
    meter = Meter(declaration, declaration.hosts[ROUTER], request(tmp_path, None))
    admission = meter.judge(routes("satellite"), HUGE, spends=True, is_plan=False)
    assert (admission.notes, admission.refusal, meter.link.name) == ((), None, "lan")


@pytest.mark.parametrize("planned", [True, False])
def test_plan_beyond_the_cap_is_refused_despite_consent(
    declaration: Inventory, tmp_path: Path, *, planned: bool
) -> None:
    meter = Meter(declaration, declaration.hosts[ROUTER], request(tmp_path, accept_cost=True))
    refused = meter.judge(routes(), HUGE, spends=True, is_plan=planned)
    assert "the limit for one action is 5.0 MB" in (refused.refusal or "")
    assert meter.judge(routes(), HUGE, spends=False, is_plan=planned).refusal is None


def test_rehearsal_continues_and_reports_what_would_be_refused(declaration: Inventory, tmp_path: Path) -> None:
    meter = Meter(declaration, declaration.hosts[ROUTER], request(tmp_path, rehearsed=True))
    admission = meter.judge(routes("wifi-ptp"), HUGE, spends=True, is_plan=False)
    assert admission.refusal is None
    assert admission.notes[0].startswith("a real run would be refused: this would send about")
    assert meter.link.name == "satellite"


# --- after it ----------------------------------------------------------------------------------------------------


class Journal(NoJournal):
    def __init__(self) -> None:
        self.records: list[Record] = []

    def write(self, record: Record) -> None:
        self.records.append(record)


def counts(rx: int, tx: int, at: datetime = NOON) -> PortCounts:
    return PortCounts(at, 3600.0, {"ether1": (0, 0), "ether2": (5, 5), "ether3": (rx, tx)})


def ended(**more: Any) -> DeviceResult:  # noqa: ANN401 - fields of DeviceResult
    return DeviceResult(
        ROUTER,
        Status.CHANGED,
        ExitCode.DONE,
        "done",
        **{"sent_bytes": 30_000, "received_bytes": 20_000, "sessions": 2, "seconds": 40.0, **more},
    )


def test_bill_is_reported_recorded_and_added_to_the_month(declaration: Inventory, tmp_path: Path) -> None:
    costs, journal, store = Costs(declaration, request(tmp_path, accept_cost=True)), Journal(), Store(tmp_path)
    costs._meter(ROUTER).judge(routes(), SMALL, spends=True, is_plan=False)
    told = costs.report(ended(counts=(counts(1000, 1000), counts(41_000, 31_000))), journal, store)
    cost = told["cost"]
    assert cost["bill"]["payload_bytes"] == 50_000 * 112 // 100 + 2 * 600
    assert cost["bill"]["price"] == "0.4576"
    assert cost["router"] == {"interface": "ether3", "rx_bytes": 40_000, "tx_bytes": 30_000, "bytes": 70_000}
    assert cost["bill_words"] == ("57 kB, 0.46 EUR; the router counted 70 kB on ether3, including other traffic")
    assert journal.records == [
        CostRecord(
            device=ROUTER,
            bearer="satellite",
            declared="satellite",
            accepted=True,
            expected_bytes=SMALL.wire_bytes,
            sent_bytes=57_200,
            router_bytes=70_000,
            billed_bytes=57_200,
            price="0.4576",
            currency="EUR",
        )
    ]
    last = store.usage("coastal").last("satellite")
    assert last is not None
    assert (last.interface, last.bytes, last.at, last.uptime_s) == ("ether3", 72_000, NOON, 3600.0)
    assert store.usage("coastal").last("wifi-ptp") is not None


def test_a_run_over_the_cable_is_not_billed_and_still_counts_for_the_month(
    declaration: Inventory, tmp_path: Path
) -> None:
    costs, journal, store = Costs(declaration, request(tmp_path, None)), Journal(), Store(tmp_path)
    told = costs.report(ended(counts=(counts(1, 1), counts(2, 2))), journal, store)
    assert dict(told) == {"notes": []}
    assert journal.records == []
    later = NOON.replace(hour=13)
    costs.report(ended(counts=(counts(1, 1), counts(500, 2, later))), journal, store)
    assert store.usage("coastal").month("satellite", later).bytes == 498


def test_missing_router_counters_are_not_reported_as_zero(declaration: Inventory, tmp_path: Path) -> None:
    for looks in ((), (counts(9000, 9000), counts(10, 10))):
        costs = Costs(declaration, request(tmp_path, accept_cost=True))
        cost = costs.report(ended(counts=looks), Journal(), Store(tmp_path))["cost"]
        assert cost["router"] is None
        assert cost["bill_words"].endswith("; not counted by the router")


def test_unreadable_monthly_usage_is_reported_and_results_are_kept(declaration: Inventory, tmp_path: Path) -> None:
    path = tmp_path / "real" / "coastal" / "usage.json"
    path.parent.mkdir(parents=True)
    path.write_text("torn")
    costs = Costs(declaration, request(tmp_path, accept_cost=True))
    told = costs.report(ended(counts=(counts(1, 1), counts(2, 2)), notes=("kept",)), Journal(), Store(tmp_path))
    assert told["notes"][0] == "kept"
    assert told["notes"][1].startswith("the data usage of this month cannot be read")
    assert told["cost"]["router"]["bytes"] == 2


def test_the_declared_links_and_ports_of_a_router(declaration: Inventory) -> None:
    router, terminal = declaration.hosts[ROUTER], declaration.hosts["coastal-sat"]
    assert dict(ports_of(router)) == {"ether1": "wifi-ptp", "ether2": "4g", "ether3": "satellite"}
    assert [(way.name, way.port, way.is_metered) for way in ways_of(declaration, router)] == [
        ("wifi-ptp", "ether1", False), ("4g", "ether2", True), ("satellite", "ether3", True),
    ]  # fmt: skip
    assert (ports_of(terminal), ways_of(declaration, terminal)) == ({}, ())
    links = links_of(declaration, "coastal")
    assert [(link.name, link.cap_bytes) for link in links.values()] == [
        ("lan", None), ("wifi-ptp", None), ("4g", 5_000_000), ("satellite", 5_000_000),
    ]  # fmt: skip
    assert links["4g"].tariff is None
    assert links["satellite"].tariff is not None


def test_job_gets_its_counted_ports_and_meter(declaration: Inventory, tmp_path: Path) -> None:
    target = Target(host="127.0.0.1", port=1, pin="00")
    asked = request(tmp_path, rehearsed=True, targets={ROUTER: target})
    job = Costs(declaration, asked).with_meter(
        device_job(declaration, declaration.hosts[ROUTER], asked, NoJournal(), ignore)
    )
    assert job.counted_ports == ("ether1", "ether2", "ether3")
    assert isinstance(job.cost_policy, Meter)
