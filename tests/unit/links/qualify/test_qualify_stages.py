"""What a run plans, what it sends of it, and what is concluded: against a link of known truth, on a simulated clock."""

import os
import threading
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import pytest
from hints_said import advised
from simulated_network import KEY, SECOND, SimulatedNetwork, network, run_train
from tolerances import tolerances

from atlantis_netcfg.cli import main
from atlantis_netcfg.cli.base.syntax import Arguments
from atlantis_netcfg.core.errors import ExitCode, NoMatchError, UsageError
from atlantis_netcfg.core.events import Verdict
from atlantis_netcfg.emulator.udp_link import HEADERS, LinkShape
from atlantis_netcfg.inventory import load
from atlantis_netcfg.inventory.model import Link, LinkThresholds, Transport
from atlantis_netcfg.links.qualify.budget import VPN_HEADERS, Budget, BudgetGuard
from atlantis_netcfg.links.qualify.grids import train_bytes
from atlantis_netcfg.links.qualify.judgement import profile
from atlantis_netcfg.links.qualify.measured_run import BudgetLimits, FarEnd, MeasuredRun, Selection
from atlantis_netcfg.links.qualify.record import make_record
from atlantis_netcfg.links.qualify.reflector.stamp import reflector_key
from atlantis_netcfg.links.qualify.samples import Sample, StreamEnd, TrainBegan
from atlantis_netcfg.links.qualify.search import RateLimit
from atlantis_netcfg.links.qualify.session import ReflectorPeer, TrainPlan
from atlantis_netcfg.links.qualify.transfers import message_figures
from atlantis_netcfg.operations import Request
from atlantis_netcfg.operations.common.link_shapes import link_shapes
from atlantis_netcfg.operations.qualify.far_end import (
    FarEndUnavailable,
    MeasuredFarEnd,
    far_end_of,
    open_far_end,
    source_in_vpn,
    source_of,
)
from atlantis_netcfg.operations.qualify.measure import CountedTransport, Measurement, lost_packets
from atlantis_netcfg.operations.qualify.plan import QualifyPlan, build_plan, thresholds_of
from atlantis_netcfg.operations.qualify.result import QualifyResult
from atlantis_netcfg.operations.qualify.run import links_of_site

DECLARED = load(Path(__file__).parents[4] / "inventory")
BEARERS = {bearer.name: bearer for bearer in DECLARED.sites["coastal"].bearers}


def measurement(
    bearer: Link, selection: Selection, budget: Budget | None = None, net: SimulatedNetwork | None = None
) -> tuple[Measurement, SimulatedNetwork]:
    net = network(*link_shapes(bearer)) if net is None else net
    kept: list[Sample] = []
    guard = BudgetGuard(budget or Budget(), lambda: net.now / SECOND)
    plan = build_plan(bearer, selection, is_rehearsal=True)
    return Measurement(plan, ReflectorPeer(KEY), CountedTransport(net), guard, kept.append), net


def described(measured: Measurement, selection: Selection, **changes: object) -> QualifyResult:
    name, thresholds = thresholds_of(BEARERS["satellite"])
    # A rehearsed train is too short to show a gap of 90 s.
    thresholds = thresholds.model_copy(update={"gap_s": 5.0})
    run = MeasuredRun(
        id="satellite-1",
        tool="1",
        site="coastal",
        link="satellite",
        kind="satellite",
        emulated=True,
        selection=selection,
        far_end=FarEnd(
            name="scc-control", address="192.0.2.1", port=862, over_vpn=False, authenticated=True, source="192.0.2.2"
        ),
        begun=datetime(2026, 1, 1, tzinfo=UTC),
        ended=datetime(2026, 1, 1, 0, 1, tzinfo=UTC),
        reason=measured.reason,
        clock_synchronised=False,
        budget=BudgetLimits(),
        sent_bytes=measured.transport.sent_bytes,
        received_bytes=measured.transport.received_bytes,
        way=Verdict.PASS,
        thresholds_name=name,
        thresholds=thresholds,
    )
    run = run.model_copy(update=changes)
    return QualifyResult(make_record(run, measured.samples), Path("/nowhere"))


@pytest.mark.parametrize("name", list(BEARERS))
@pytest.mark.parametrize("selection", list(Selection))
def test_plan_stays_within_the_link_rate(name: str, selection: Selection) -> None:
    plan = build_plan(BEARERS[name], selection)
    whole = {Selection.TELEMETRY: 12, Selection.IMAGES: 24, Selection.THROUGHPUT: 0, Selection.ALL: 36}[selection]
    assert len(plan.cells) + plan.left_out == whole
    assert bool(plan.left_out) == (name == "satellite" and selection in {Selection.IMAGES, Selection.ALL})
    assert plan.idle.packets >= profile("satellite").min_samples
    assert (plan.load is not None) == (selection in {Selection.THROUGHPUT, Selection.ALL})
    assert plan.bytes > 2 * 600 * (112 + HEADERS)
    assert plan.seconds > plan.idle.duration_s


@pytest.mark.parametrize("selection", [Selection.TELEMETRY, Selection.IMAGES, Selection.THROUGHPUT])
def test_bytes_sent_stay_within_the_announced_amount(selection: Selection) -> None:
    measured, net = measurement(BEARERS["satellite"], selection)
    assert measured.measure() == "done"
    counted = measured.transport
    assert counted.sent_bytes == net.up.sent_bytes
    assert counted.sent_bytes + counted.received_bytes <= measured.plan.bytes
    assert net.now / SECOND <= measured.plan.seconds + 30
    streams = [sample.stream for sample in measured.samples if isinstance(sample, StreamEnd)]
    assert streams[0] == "idle"
    assert set(streams) >= {cell.stream for cell in measured.plan.cells}
    assert (measured.mtu.up, measured.mtu.both) == (1500, 1500)
    (rate,) = measured.rates
    assert rate.size == measured.plan.sizes[0]
    assert rate.rate_hz is not None


@pytest.mark.parametrize("name", ["satellite", "4g"])
def test_rehearsal_takes_under_a_minute_and_passes_on_good_links(name: str) -> None:
    """It took 67 s over the satellite, and could not pass: no train of 6 s shows a gap of 90 s."""
    measured, net = measurement(BEARERS[name], Selection.TELEMETRY)
    assert measured.measure() == "done"
    assert net.now / SECOND < 50, "a minute with its emulated devices"
    limits = thresholds_of(BEARERS[name], is_rehearsal=True)
    found = described(measured, Selection.TELEMETRY, thresholds=limits[1], thresholds_name=limits[0])
    assert found.record.verdict is Verdict.PASS
    assert found.exit is ExitCode.DONE


def test_rehearsal_states_which_gaps_it_can_detect() -> None:
    assert thresholds_of(BEARERS["satellite"], is_rehearsal=True) == (
        "satellite, outages up to 5 s in a rehearsal",
        profile("satellite").model_copy(update={"gap_s": 5.0}),
    )
    assert thresholds_of(BEARERS["4g"], is_rehearsal=True) == thresholds_of(BEARERS["4g"])
    bearer = BEARERS["satellite"]
    broken = replace(link_shapes(bearer)[0], gaps_s=((1.0, 100.0),))
    measured, _ = measurement(bearer, Selection.TELEMETRY, net=network(broken, link_shapes(bearer)[1]))
    measured._measure_idle()
    assert described(measured, Selection.TELEMETRY, reason="done").record.verdict is not Verdict.PASS


def test_fully_answered_train_ends_without_waiting() -> None:
    _, samples = run_train(network(LinkShape(delay_s=0.3), LinkShape(delay_s=0.3)), TrainPlan(112, 0.2, 10))
    (end,) = (each for each in samples if isinstance(each, StreamEnd))
    assert end.ended_at_ns / SECOND == pytest.approx(9.8 + 2 * 0.6, abs=0.01), (
        "the last answer, and that with the count"
    )


def test_goodput_is_measured_in_both_directions() -> None:
    bearer = BEARERS["satellite"]
    measured, _ = measurement(bearer, Selection.THROUGHPUT)
    # The round trips beside the load take a part of the link: in a rehearsal, which hurries, a large one.
    measured.plan = build_plan(bearer, Selection.THROUGHPUT)
    measured._measure_load()
    measured._measure_load_down()
    assert measured.reason == "done"
    for stream, kbps in (("load up", bearer.rate.up_kbps), ("load down", bearer.rate.down_kbps)):
        figures = message_figures(measured.samples, stream)
        assert figures is not None
        carries = kbps * 1000 * 1048 / (1200 + HEADERS)
        assert figures.receiver_bps == pytest.approx(carries, rel=tolerances()["goodput_share"]), stream
        assert figures.busy_bps == pytest.approx(carries, rel=tolerances()["goodput_share"]), stream


@pytest.mark.parametrize("selection", [Selection.TELEMETRY, Selection.THROUGHPUT])
def test_a_rehearsed_satellite_is_measured_within_54_seconds(selection: Selection) -> None:
    """Of a minute: the emulated router takes six seconds more."""
    measured, net = measurement(BEARERS["satellite"], selection)
    assert measured.measure() == "done"
    assert net.now < 54 * SECOND


def test_good_link_passes_every_criterion_and_tables_are_printed() -> None:
    measured, _ = measurement(BEARERS["satellite"], Selection.TELEMETRY)
    measured.measure()
    found = described(measured, Selection.TELEMETRY)
    assert {each.verdict for each in found.record.judgements} == {Verdict.PASS}
    assert len(found.record.telemetry) == 12
    assert found.exit is ExitCode.DONE
    lines = [*found.lines()]
    assert max(map(len, lines)) <= 100
    assert any("emulated: these figures prove nothing about a real link" in line for line in lines)
    assert found.as_json()["exit"] == 0


@pytest.mark.parametrize(
    ("changes", "code"),
    [
        ({"way": Verdict.INCONCLUSIVE}, ExitCode.CHECKS_FAILED),
        ({"way": Verdict.FAIL}, ExitCode.CHECKS_FAILED),
        ({"reason": "bytes"}, ExitCode.CHECKS_FAILED),
        ({"reason": "stopped"}, ExitCode.CHECKS_FAILED),
        ({"sent_bytes": 0}, ExitCode.NOTHING),
    ],
)
def test_only_a_complete_run_over_the_right_route_is_done(changes: dict[str, object], code: ExitCode) -> None:
    measured, _ = measurement(BEARERS["satellite"], Selection.TELEMETRY, Budget(max_bytes=200_000))
    measured.measure()
    assert described(measured, Selection.TELEMETRY, reason="done").exit is ExitCode.DONE
    assert described(measured, Selection.TELEMETRY, **{"reason": "done", **changes}).exit is code


def test_silent_link_never_passes() -> None:
    dead = network(LinkShape(loss=1.0), LinkShape())
    measured, _ = measurement(BEARERS["satellite"], Selection.TELEMETRY, net=dead)
    assert measured.measure() == "no answer"
    for cell in measured.plan.cells[:2]:
        measured._measure_cell(cell)
    measured._search_rate(200)
    found = described(measured, Selection.TELEMETRY)
    assert {each.verdict for each in found.record.judgements} <= {Verdict.FAIL, Verdict.INCONCLUSIVE}
    assert [row.verdict for row in found.record.telemetry] == 2 * [Verdict.INCONCLUSIVE]
    assert found.exit is ExitCode.CHECKS_FAILED
    assert measured.max_lost >= 600
    assert [(rate.rate_hz, rate.limited_by) for rate in measured.rates] == [(None, RateLimit.SILENCE)]


def test_budget_ends_the_run_and_keeps_the_results() -> None:
    measured, _ = measurement(BEARERS["satellite"], Selection.ALL, Budget(max_bytes=250_000))
    assert measured.measure() == "bytes"
    assert measured.transport.sent_bytes + measured.transport.received_bytes <= 250_000
    found = described(measured, Selection.ALL)
    assert found.exit is ExitCode.CHECKS_FAILED
    assert any("the limit of bytes was reached; what was measured is kept" in line for line in found.lines())
    assert [each.criterion for each in found.record.judgements if each.verdict is Verdict.PASS]


def test_stop_ends_the_run_and_keeps_the_results() -> None:
    stop = threading.Event()
    measured, net = measurement(BEARERS["satellite"], Selection.ALL)
    measured.transport = CountedTransport(net, stop)
    seen: list[str] = []

    def say(message: str, _done: int, _total: int) -> None:
        seen.append(message)
        if message == "path MTU":
            stop.set()

    measured.say = say
    assert measured.measure() == "stopped"
    assert seen == ["round trips without load", "path MTU"]
    assert lost_packets(measured.samples) == 0
    assert described(measured, Selection.ALL).exit is ExitCode.CHECKS_FAILED


def test_thresholds_come_from_the_link_kind_and_the_inventory() -> None:
    plain = BEARERS["4g"]
    assert thresholds_of(plain) == ("lte", profile("lte"))
    own = plain.model_copy(update={"qualify": LinkThresholds.model_validate({"profile": "wifi", "flr": 0.25})})
    name, limits = thresholds_of(own)
    assert name == "wifi, with its own flr"
    assert limits == profile("wifi").model_copy(update={"flr": 0.25})


def test_links_are_selected_by_site_and_name() -> None:
    assert [each.name for each in links_of_site(DECLARED, "coastal", "all")] == ["wifi-ptp", "4g", "satellite"]
    assert [each.name for each in links_of_site(DECLARED, "coastal", "4g")] == ["4g"]
    assert [each.name for each in links_of_site(DECLARED, "scc", None)] == ["uplink"]
    for site, link, words in (
        ("coastal", None, "several links"),
        ("coastal", "5g", "no link `5g`"),
        ("all", "4g", "one"),
    ):
        with pytest.raises(NoMatchError, match=words):
            links_of_site(DECLARED, site, link)


def test_the_far_end_is_the_public_address_or_that_in_the_vpn() -> None:
    key = reflector_key(b"EXAMPLE-key-of-the-far-end", "scc-control")
    assert far_end_of(DECLARED, over_vpn=False) == MeasuredFarEnd("scc-control", "203.0.113.2", 862, key)
    assert far_end_of(DECLARED, over_vpn=True) == MeasuredFarEnd("scc-control", "10.80.0.2", 862, key)


@pytest.fixture
def ssh(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A program of that name, which notes what it is asked, says what stands in `says`, and ends as that does."""
    (tmp_path / "ssh").write_text(f'#!/bin/sh\necho "$@" >>{tmp_path}/asked\n. {tmp_path}/says\n', encoding="utf-8")
    (tmp_path / "ssh").chmod(0o755)
    monkeypatch.setenv("PATH", str(tmp_path), prepend=os.pathsep)
    monkeypatch.setenv("ANSIBLE_SSH_CONTROL_PATH_DIR", str(tmp_path))
    return tmp_path


def test_a_measurement_starts_the_program_at_the_far_end(ssh: Path) -> None:
    (ssh / "says").write_text("exit 0")
    open_far_end(DECLARED, Request(state=ssh))
    (asked,) = (ssh / "asked").read_text(encoding="utf-8").splitlines()
    assert asked.endswith("root@10.64.0.11 systemctl start atlantis-qualify.service")
    assert "HostKeyAlias=scc-control" in asked


def test_far_end_with_another_host_key_is_reported(ssh: Path) -> None:
    (ssh / "says").write_text("echo '@ REMOTE HOST IDENTIFICATION HAS CHANGED! @' >&2; exit 255")
    with pytest.raises(
        FarEndUnavailable, match=r"scc-control at 10\.64\.0\.11: it shows a different SSH host key than before"
    ) as closed:
        open_far_end(DECLARED, Request(state=ssh))
    assert "`ssh-keygen -R scc-control`" in str(closed.value.hint)


def test_nothing_is_measured_when_the_far_end_cannot_be_opened(ssh: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (ssh / "says").write_text("echo 'Unit atlantis-qualify.service not found.' >&2; exit 5")
    words = "scc-control did not start the far end of the measurement: Unit atlantis-qualify.service not found."
    with pytest.raises(FarEndUnavailable, match=words) as closed:
        open_far_end(DECLARED, Request(state=ssh))
    assert closed.value.exit is ExitCode.FAILED
    (command,) = advised(str(closed.value.hint))
    typed: list[tuple[str, str | None]] = []

    def run_site(arguments: Arguments) -> ExitCode:
        typed.append((arguments.word("site"), ",".join(arguments.many("device"))))
        return ExitCode.DONE

    monkeypatch.setattr("atlantis_netcfg.cli.runs.run_site", run_site)
    assert main(command) == 0
    assert typed == [("scc", "scc-control")]


def test_tunnel_over_tcp_cannot_be_rerouted() -> None:
    vpn = DECLARED.pilot.vpn.model_copy(update={"transport": Transport.TCP})
    over_tcp = replace(DECLARED, pilot=DECLARED.pilot.model_copy(update={"vpn": vpn}))
    with pytest.raises(NoMatchError, match="without breaking"):
        far_end_of(over_tcp, over_vpn=True)


def test_a_computer_without_a_tunnel_measures_nothing_in_the_vpn() -> None:
    with pytest.raises(UsageError, match=r"this computer has no active tunnel: it would send to 127\.0\.0\.1 from 127"):
        source_in_vpn(DECLARED, "127.0.0.1", 862)


@pytest.mark.parametrize("selection", [Selection.TELEMETRY, Selection.THROUGHPUT])
def test_vpn_overhead_is_charged_and_within_the_announced_bytes(selection: Selection) -> None:
    bearer = BEARERS["satellite"]
    net = network(*link_shapes(bearer))
    plan = build_plan(bearer, selection, is_rehearsal=True, over_vpn=True)
    counted = CountedTransport(net, tunnel_headers=VPN_HEADERS)
    guard = BudgetGuard(Budget(), lambda: net.now / SECOND, counted.headers)
    kept: list[Sample] = []
    measured = Measurement(plan, ReflectorPeer(KEY), counted, guard, kept.append)
    assert measured.measure() == "done"
    assert counted.sent_bytes == net.up.sent_bytes + net.up.sent_count * VPN_HEADERS == guard.sent_bytes
    assert counted.received_bytes == guard.received_bytes
    assert counted.sent_bytes + counted.received_bytes <= plan.bytes
    assert measured.mtu.both == 1500 - VPN_HEADERS, "longer ones would be cut in two"
    assert [each.stream for each in kept if isinstance(each, TrainBegan)][:2] == ["led", "idle"]
    hour = [row.mb_per_hour for row in described(measured, selection).record.telemetry]
    beside = [
        train_bytes(TrainPlan(cell.plan.size, 1 / cell.rate_hz, 3600), 80)
        for cell in plan.cells
        if isinstance(cell.plan, TrainPlan)
    ]
    assert hour == [pytest.approx(octets / 1e6) for octets in beside]


def test_computer_outside_the_site_is_refused_with_a_reason() -> None:
    with pytest.raises(
        UsageError,
        match=r"would send from 127\.0\.0\.1, but the router forwards only packets from networks of `coastal`",
    ):
        source_of(DECLARED, "coastal", "127.0.0.1", 862)


def test_unstarted_run_is_not_done() -> None:
    measured, _ = measurement(BEARERS["satellite"], Selection.TELEMETRY)
    assert measured.reason == "cut off"
    found = described(measured, Selection.TELEMETRY)
    assert found.exit is ExitCode.NOTHING
    assert any("nothing was measured without load" in line for line in found.lines())


def test_a_plan_is_pure() -> None:
    first: QualifyPlan = build_plan(BEARERS["4g"], Selection.ALL)
    assert first == build_plan(BEARERS["4g"], Selection.ALL)
