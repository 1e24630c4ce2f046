"""`provision links` of coastal, well and sick in several ways: golden/*.txt is what a technician reads."""

import json
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from links_bench import Bench, bench, inventory, masked
from waiting import wait_until

from atlantis_netcfg.core.errors import ExitCode
from atlantis_netcfg.emulator.routeros import EmulatorSpec
from atlantis_netcfg.records.survey.radio import UnitRadio
from atlantis_netcfg.runs import Store
from atlantis_netcfg.runs.report.links import LinksReport

pytestmark = pytest.mark.slow

GOLDEN = Path(__file__).with_name("golden")
ROUTER, NEAR, FAR, UNIT, TERMINAL = "coastal-router", "coastal-cpe", "scc-cpe", "coastal-4g", "coastal-sat"
KEYS = {"kind", "state", "active", "metered", "quality", "month_bytes", "findings"}
PLAIN_80211 = ("protocol: nv2", 'protocol: "802.11"\n    menus: wifi')
PROVISION = str(Path(sys.executable).with_name("provision"))


@pytest.fixture(scope="module")
def running(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Bench]:
    with bench(tmp_path_factory.mktemp("coastal"), "coastal", spoil=with_larger_antennas) as opened:
        yield opened


def with_larger_antennas(twin: EmulatorSpec) -> EmulatorSpec:
    """Radios whose antennas are 3 dB better than declared, so that full power is too much for the other end."""
    radios = tuple(radio.model_copy(update={"gain_dbi": 19.0}) for radio in twin.router.radios)
    return twin.model_copy(update={"router": twin.router.model_copy(update={"radios": radios})})


@pytest.fixture
def coastal(running: Bench) -> Iterator[Bench]:
    yield running
    running.heal()


def golden(name: str, report: LinksReport) -> None:
    path = GOLDEN / f"{name}.txt"
    shown = f"{masked(report.as_text())}\nexit {int(report.exit)}\n"
    assert shown == path.read_text(encoding="utf-8"), f"{path}\n{shown}"


def codes(report: LinksReport, bearer: str) -> list[str]:
    return [f"{one['verdict']} {one['code']}" for one in report.bearers[bearer]["findings"]]


@pytest.mark.smoke
def test_healthy_site_passes(coastal: Bench) -> None:
    report = coastal.report()
    golden("coastal-well", report)
    assert report.exit is ExitCode.DONE
    assert [one["state"] for one in report.bearers.values()] == ["up", "up", "unknown"]


def test_survey_reads_the_unit_and_the_active_link(coastal: Bench) -> None:
    hosts, store = coastal.declaration.hosts, Store(coastal.request.state, is_rehearsal=True)
    radio = UnitRadio(coastal.declaration, hosts[UNIT], coastal.request, store, hosts[ROUTER])
    heard = radio.read()
    assert (heard.cell, heard.rsrp_dbm, heard.technology, heard.no_radio) == ("3103242", -97.0, "lte", "")
    assert radio.carried_by() == "wifi-ptp"
    coastal.lose("wifi-ptp")
    assert radio.carried_by() == "4g"
    coastal.away(ROUTER, UNIT)
    radio.request = coastal.request.model_copy(update={"targets": coastal.request.targets | coastal.targets})
    assert radio.carried_by() is None
    silent = radio.read()
    assert silent.rsrp_dbm is None
    assert silent.no_radio


def test_json_has_the_documented_fields(coastal: Bench) -> None:
    told = json.loads(json.dumps(coastal.report().as_json()))
    assert list(told["bearers"]) == ["wifi-ptp", "4g", "satellite"]
    assert all(set(one) >= KEYS for one in told["bearers"].values())
    assert [one["active"] for one in told["bearers"].values()] == [True, False, False]
    assert [one["metered"] for one in told["bearers"].values()] == [False, True, True]
    wifi, unit, satellite = (one["quality"] for one in told["bearers"].values())
    assert (wifi["signal_dbm"], wifi["far_signal_dbm"], wifi["tx_ccq_percent"]) == (-43.0, -43.0, 90.0)
    assert (unit["rsrp_dbm"], unit["registration"]) == (-97.0, "registered_home")
    assert (satellite["rtt_ms"], satellite["kept_off_packets"]) == (None, 0)
    assert (told["site"], told["exit"], list(told["not_asked"])) == ("coastal", 0, [TERMINAL])


def test_reading_takes_few_round_trips_and_changes_nothing(coastal: Bench) -> None:
    names = (ROUTER, NEAR, FAR, UNIT)
    before = [plain_export(coastal, name) for name in names]
    history = [coastal.do(name, "console", words=["/system/history/print"]) for name in names]
    for name in names:
        coastal.do(name, "reset")
    trips = coastal.look().round_trips
    assert trips[ROUTER] <= 5
    assert max(trips[NEAR], trips[FAR]) <= 6
    assert trips[UNIT] <= 5
    assert all(coastal.do(name, "counters")["turns"] <= 4 for name in names)
    assert [plain_export(coastal, name) for name in names] == before
    assert [coastal.do(name, "console", words=["/system/history/print"]) for name in names] == history


def plain_export(at: Bench, name: str) -> str:
    lines = str(at.do(name, "export", show_sensitive=True)).splitlines()
    return "\n".join(line for line in lines if not line.startswith("#"))


def test_no_secret_or_identity_is_printed(coastal: Bench) -> None:
    report = coastal.report()
    said = json.dumps(report.as_json()) + report.as_text()
    assert "EXAMPLE-ptp-key" not in said
    assert "EXAMPLE-provision" not in said
    assert not any(word in said for word in ("imei", "imsi", "iccid"))


def test_unreachable_radio_is_reported_on_its_link(coastal: Bench) -> None:
    coastal.away(NEAR)
    report = coastal.report()
    golden("coastal-cpe-unreachable", report)
    assert codes(report, "wifi-ptp") == ["INCONCLUSIVE device-unreachable"]
    assert report.exit is ExitCode.CHECKS_FAILED


def test_unreachable_router_does_not_hide_the_other_devices(coastal: Bench) -> None:
    coastal.away(ROUTER)
    report = coastal.report()
    golden("coastal-router-unreachable", report)
    assert all(one["active"] is None for one in report.bearers.values())
    assert report.bearers["wifi-ptp"]["state"] == "up"
    assert report.exit is ExitCode.CHECKS_FAILED


def test_no_device_responds(coastal: Bench) -> None:
    coastal.away(ROUTER, NEAR, FAR, UNIT)
    report = coastal.report()
    assert [one["device"] for one in report.unreachable] == [ROUTER, NEAR, FAR, UNIT]
    assert {one["state"] for one in report.bearers.values()} == {"unknown"}
    assert report.exit is ExitCode.CHECKS_FAILED


def test_selected_devices_are_queried(coastal: Bench) -> None:
    report = coastal.report(ROUTER)
    assert report.queried_devices == (ROUTER,)
    assert set(report.not_asked) == {NEAR, FAR, UNIT, TERMINAL}
    assert report.bearers["wifi-ptp"]["state"] == "up"
    assert report.exit is ExitCode.DONE
    radios = coastal.report(NEAR)
    assert set(radios.queried_devices) == {NEAR, FAR}
    assert radios.as_text().endswith("is not known: the router was not read")


def test_selection_without_readable_devices_knows_nothing(coastal: Bench) -> None:
    report = coastal.report(TERMINAL)
    assert report.exit is ExitCode.NOTHING
    assert report.queried_devices == ()
    assert report.as_text().endswith("No device was queried, so nothing is known about coastal")


def test_bridge_is_lost_behind_its_radios_and_4g_is_active(coastal: Bench) -> None:
    coastal.lose("wifi-ptp")
    report = coastal.report()
    golden("coastal-canaries-lost", report)
    assert codes(report, "wifi-ptp") == ["FAIL canaries-silent"]
    assert codes(report, "4g") == ["WARN in-place-of-a-better-one"]
    assert report.exit is ExitCode.CHECKS_FAILED


def test_recovered_preferred_link_is_not_yet_active(coastal: Bench) -> None:
    coastal.lose("wifi-ptp")
    coastal.do(ROUTER, "silence", addresses=[])
    report = coastal.report()
    assert codes(report, "wifi-ptp") == ["WARN not-taken-yet"]
    assert report.exit is ExitCode.DONE


def test_both_are_lost_and_the_satellite_carries(coastal: Bench) -> None:
    coastal.lose("wifi-ptp")
    coastal.lose("4g")
    report = coastal.report()
    assert report.bearers["satellite"]["active"] is True
    assert report.bearers["satellite"]["state"] == "unknown"
    assert "satellite carries the traffic of coastal: it is NOT the preferred link" in report.as_text()


def test_a_radio_on_another_network_name(coastal: Bench) -> None:
    coastal.types(NEAR, "/interface/wireless/set", "=.id=wlan1", "=ssid=another")
    coastal.lose("wifi-ptp")
    try:
        golden("coastal-not-associated", coastal.report())
    finally:
        coastal.types(NEAR, "/interface/wireless/set", "=.id=wlan1", "=ssid=EXAMPLE-ATLANTIS-PTP")
        associated(coastal)


def test_too_strong_radio_signal_is_a_warning(coastal: Bench) -> None:
    power = ("=tx-power-mode=all-rates-fixed", "=tx-power=30", "=frequency-mode=superchannel")
    before = [word for word in radio(coastal, NEAR) if word.startswith(("=tx-power", "=frequency-mode="))]
    coastal.types(NEAR, "/interface/wireless/set", "=.id=wlan1", *power)
    try:
        associated(coastal)
        report = coastal.report()
    finally:
        coastal.types(NEAR, "/interface/wireless/set", "=.id=wlan1", *before)
        associated(coastal)
    golden("coastal-too-loud", report)
    assert codes(report, "wifi-ptp") == ["WARN signal-strong"]
    assert report.exit is ExitCode.DONE


def radio(at: Bench, name: str) -> list[str]:
    """How the radio of a device is set."""
    return next(words for kind, *words in at.do(name, "console", words=["/interface/wireless/print"]) if kind == "!re")


def associated(at: Bench) -> None:
    """Wait until both radios have found each other again."""
    wait_until(lambda: at.hears(NEAR) and at.hears(FAR), every_s=0)


def test_rehearsal_over_a_link_that_the_other_end_lacks(tmp_path: Path) -> None:
    done = subprocess.run(
        [PROVISION, "links", "site=coastal", "via=4g", "--rehearse", "--json"],
        env={**os.environ, "ATLANTIS_STATE": str(tmp_path)},
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    told = json.loads(done.stdout)
    assert list(told["costs"]) == ["4g"]
    assert [one["state"] for one in told["bearers"].values()] == ["up", "up", "unknown"]


def test_wifi_radios_without_ccq(tmp_path: Path) -> None:
    """The menus `wifi` have no CCQ, which is left out and not shown as 0."""
    files = {f"host_vars/{name}.yml": PLAIN_80211 for name in (NEAR, FAR)}
    with bench(tmp_path, "coastal", root=inventory(tmp_path, files)) as opened:
        report = opened.report()
        trips = report.round_trips
    quality = report.bearers["wifi-ptp"]["quality"]
    assert (quality["signal_dbm"], quality["far_signal_dbm"]) == (-49.0, -49.0)
    assert quality["tx_ccq_percent"] is None
    assert "CCQ" not in report.as_text()
    assert codes(report, "wifi-ptp") == []
    assert max(trips[NEAR], trips[FAR]) <= 6
