"""Whether the telemetry of a vehicle fits: capacities declared and measured, thinning, verdicts, money."""

from dataclasses import replace
from datetime import timedelta
from decimal import Decimal
from pathlib import Path
from typing import Any

import pytest
from example_runs import BEGUN, idle_text, measured_run, put_run, samples_text

from atlantis_netcfg.core.errors import ExitCode, NoMatchError, UsageError
from atlantis_netcfg.core.events import Verdict
from atlantis_netcfg.inventory import Inventory, load
from atlantis_netcfg.inventory.model import KEY_OCTETS, LinkThresholds, Qualify, TelemetryTopic, ThresholdsName
from atlantis_netcfg.links.qualify.archive import folder_of
from atlantis_netcfg.links.qualify.judgement import QualifyProfile, profiles
from atlantis_netcfg.links.qualify.reflector.stamp import MIN_KEY_SIZE, PORT
from atlantis_netcfg.operations.common.traffic_budget import standing_traffic
from atlantis_netcfg.operations.fit import LinkFit, VehicleFit, unfit_vehicles, vehicle_fit
from atlantis_netcfg.operations.fit.link_capacity import USABLE
from atlantis_netcfg.runs import NoSuchRun, Store

SHIPPED = Path(__file__).parents[4] / "inventory"
NOW = BEGUN + timedelta(days=1)
POSE = {"topic": "/pose", "data": "numbers", "rate_hz": 2.0, "size_bytes": 120}
CAMERA = {"topic": "/camera", "data": "images", "rate_hz": 4.0, "size_bytes": 20_000}
SONAR = {"topic": "/sonar", "data": "point_clouds", "rate_hz": 0.5, "size_bytes": 20_000}


@pytest.fixture(scope="module")
def shipped() -> Inventory:
    """DDS crosses every link of the coastal site, and nobody publishes anything yet."""
    declaration = load(SHIPPED)
    coastal = declaration.sites["coastal"]
    bearers = tuple(bearer.model_copy(update={"dds": True}) for bearer in coastal.bearers)
    silent = {name: each.model_copy(update={"telemetry": ()}) for name, each in declaration.vehicles.items()}
    sites = {**declaration.sites, "coastal": coastal.model_copy(update={"bearers": bearers})}
    return replace(declaration, vehicles=silent, sites=sites)


def test_link_closed_to_dds_is_reported(tmp_path: Path) -> None:
    """It is said what would go over it; that it fits there is no reason to leave a warning out."""
    declaration = load(SHIPPED)
    links = fit(declaration, tmp_path, POSE).links
    told = "DDS does not use satellite: set `dds: true` at the link to allow it"
    assert [told in link.warnings for link in links] == [False, False, True]
    slow = declaration.sites["coastal"].bearers[-1]
    only = declaration.sites["coastal"].model_copy(update={"bearers": (slow,)})
    alone = publishing(replace(declaration, sites={**declaration.sites, "coastal": only}), POSE)
    told = "no DDS link of coastal carries what `sparus` publishes, even at the lowest useful rates"
    assert told in [found.message for found in unfit_vehicles(alone, NOW)]


def publishing(declaration: Inventory, *topics: dict[str, Any]) -> Inventory:
    telemetry = tuple(TelemetryTopic.model_validate(topic) for topic in topics)
    sparus = declaration.vehicles["sparus"].model_copy(update={"telemetry": telemetry})
    return replace(declaration, vehicles={**declaration.vehicles, "sparus": sparus})


def fit(declaration: Inventory, state: Path, *topics: dict[str, Any], **more: Any) -> VehicleFit:  # noqa: ANN401
    stores = [Store(state), Store(state, is_rehearsal=True)]
    return vehicle_fit(publishing(declaration, *topics), stores, "coastal", "sparus", NOW, **more)


def satellite(declaration: Inventory, state: Path, *topics: dict[str, Any], **more: Any) -> LinkFit:  # noqa: ANN401
    (link,) = fit(declaration, state, *topics, link="satellite", **more).links
    return link


def kept(state: Path, *, text: str | None = None, rehearsed: bool = False, **changes: Any) -> str:  # noqa: ANN401
    run = measured_run(**{"emulated": False, **changes})
    put_run(folder_of(Store(state, is_rehearsal=rehearsed), "coastal"), run, text)
    return run.id


def test_declared_rate_is_inconclusive(shipped: Inventory, tmp_path: Path) -> None:
    found = fit(shipped, tmp_path, POSE)
    assert [link.link.name for link in found.links] == ["wifi-ptp", "4g", "satellite"]
    assert {(link.verdict, link.word) for link in found.links} == {(Verdict.INCONCLUSIVE, "fits")}
    assert {link.reason for link in found.links} == {
        "only the rate in the inventory is known: this link was not measured"
    }
    assert found.exit is ExitCode.CHECKS_FAILED


def test_bytes_equal_those_of_the_standing_traffic(shipped: Inventory, tmp_path: Path) -> None:
    """One arithmetic for both: `provision links` and `provision measure fit` agree to the byte."""
    topics = (POSE, CAMERA, {**SONAR, "reliable": True})
    (traffic,) = (each for each in standing_traffic(publishing(shipped, *topics), "coastal") if each.link.name == "4g")
    (link,) = fit(shipped, tmp_path, *topics, link="4g").links
    assert link.up_bps == pytest.approx(sum(flow.up for flow in traffic.flows) * 8 / 86_400)
    assert link.down_bps == pytest.approx(sum(flow.down for flow in traffic.flows) * 8 / 86_400)
    assert link.costs(86_400).payload_bytes == pytest.approx(traffic.day_bytes, abs=2)


def test_unmeasured_direction_is_reported(shipped: Inventory, tmp_path: Path) -> None:
    run = kept(tmp_path)
    link = satellite(shipped, tmp_path, POSE)
    assert link.capacity.source == "measured up, from inventory down"
    assert link.capacity.run == run
    # The run has filled the link upwards only, so the way to the site is the declared one, and that is said.
    assert link.capacity.pace.up_bps == pytest.approx(352_000 - 4 * 200 * 8, rel=0.05)  # less the train beside it
    assert link.capacity.down_bps == 704_000
    assert (link.verdict, link.reason) == (
        Verdict.INCONCLUSIVE,
        "the run measured no capacity to the site: the inventory's is used",
    )
    assert link.capacity.loss == 0.0
    assert link.topics[0].message_loss == 0.0


def both_ways() -> str:
    """A run that has filled the link to the site as well: the same messages under the other name."""
    lines = samples_text().splitlines(keepends=True)
    return "".join([*lines, *(line.replace('"load up"', '"load down"') for line in lines if '"load up"' in line)])


def test_measured_run_in_both_directions_passes(shipped: Inventory, tmp_path: Path) -> None:
    run = kept(tmp_path, text=both_ways())
    found = fit(shipped, tmp_path, POSE, link="satellite")
    (link,) = found.links
    assert (link.verdict, link.word, link.reason) == (Verdict.PASS, "fits", f"measured, {run}")
    assert link.capacity.source == "measured"
    assert found.exit is ExitCode.DONE
    assert link.capacity.pace.rtt_s == pytest.approx(0.596, abs=0.02)


@pytest.mark.parametrize(
    ("changes", "doubt"),
    [
        ({"way": Verdict.FAIL}, "the run does not prove that it used satellite"),
        ({"way": Verdict.INCONCLUSIVE}, "the run does not prove that it used satellite"),
        (
            {"begun": NOW - timedelta(days=30, seconds=1)},
            "the run is older than `qualified_within_days` of the checklist allows",
        ),
    ],
)
def test_doubtful_run_is_inconclusive(shipped: Inventory, tmp_path: Path, changes: dict[str, Any], doubt: str) -> None:
    kept(tmp_path, text=both_ways(), **changes)
    link = satellite(shipped, tmp_path, POSE)
    assert (link.verdict, link.reason) == (Verdict.INCONCLUSIVE, doubt)


def test_emulated_run_is_used_only_by_name(shipped: Inventory, tmp_path: Path) -> None:
    run = kept(tmp_path, text=both_ways(), rehearsed=True, emulated=True)
    assert satellite(shipped, tmp_path, POSE).capacity.run is None
    named = satellite(shipped, tmp_path, POSE, run=run)
    assert named.capacity.run == run
    assert (named.verdict, named.reason) == (
        Verdict.INCONCLUSIVE,
        "the run was emulated: it proves nothing about the real link",
    )


def test_newest_run_that_filled_the_link_is_used(shipped: Inventory, tmp_path: Path) -> None:
    full = kept(tmp_path, text=both_ways())
    kept(tmp_path, text=idle_text(loss=0.02), id="satellite-20261120T110000Z", begun=BEGUN + timedelta(hours=2))
    assert satellite(shipped, tmp_path, POSE).capacity.run == full
    kept(tmp_path, text=both_ways(), id="satellite-20261120T120000Z", begun=BEGUN + timedelta(hours=3))
    assert satellite(shipped, tmp_path, POSE).capacity.run == "satellite-20261120T120000Z"


def test_loss_applies_to_each_fragment(shipped: Inventory, tmp_path: Path) -> None:
    """1 - (1 - p)^n; a reliable topic is not warned of: it goes again."""
    kept(tmp_path, text=idle_text(loss=0.04))
    small = {**CAMERA, "size_bytes": 6000, "rate_hz": 0.5}
    link = satellite(shipped, tmp_path, POSE, small, {**small, "topic": "/again", "reliable": True})
    loss = link.capacity.loss
    assert loss == pytest.approx(0.04, abs=0.02)
    assert loss is not None
    pose, camera, again = link.topics
    assert pose.message_loss == pytest.approx(loss)
    assert camera.cost.fragments == 6
    assert camera.message_loss == again.message_loss == pytest.approx(1 - (1 - loss) ** 6)
    said = [words for words in link.warnings if "of the messages would be incomplete" in words]
    assert [words.split()[1] for words in said] == ["/camera,"]
    assert any("a reliable message of /again takes 22 packets" in words for words in link.warnings)


def test_point_clouds_are_thinned_before_images_and_numbers(shipped: Inventory, tmp_path: Path) -> None:
    """To rates that fit, as high as they may be."""
    link = satellite(shipped, tmp_path, POSE, CAMERA, SONAR)
    assert (link.verdict, link.word) == (Verdict.FAIL, "fits at reduced rates")
    pose, camera, sonar = link.topics
    assert (pose.rate_hz, pose.is_thinned) == (2.0, False)
    assert sonar.rate_hz == 0.1
    assert 0.1 < camera.rate_hz < 4.0
    room = USABLE * link.capacity.pace.up_bps
    assert room * 0.95 < link.thinned_up_bps <= room < link.up_bps
    assert f"{CAMERA['topic']} at {camera.rate_hz:g} Hz is below the report's guideline" in link.warnings[0]


def test_only_point_clouds_are_thinned_when_that_is_enough(shipped: Inventory, tmp_path: Path) -> None:
    link = satellite(shipped, tmp_path, POSE, {**CAMERA, "rate_hz": 0.5}, {**SONAR, "rate_hz": 0.9})
    rates = [topic.rate_hz for topic in link.topics]
    assert rates[:2] == [2.0, 0.5]
    assert 0.1 < rates[2] < 0.9
    assert rates[2] == float(f"{rates[2]:.2g}")


def test_topic_with_too_high_minimum_rate_does_not_fit(shipped: Inventory, tmp_path: Path) -> None:
    link = satellite(shipped, tmp_path, POSE, {**CAMERA, "least_hz": 3.0})
    assert (link.verdict, link.word) == (Verdict.FAIL, "does not fit")
    camera = link.topics[1]
    assert camera.rate_hz == 3.0
    # f_max of facts/devices.md: 0.7 C / (8 (S + n H)), to two digits.
    assert camera.most_hz == pytest.approx(0.7 * 352_000 / (8 * camera.cost.bytes_up), rel=0.1)
    assert camera.most_hz < 3.0


def test_reliable_topics_are_thinned_when_necessary(shipped: Inventory, tmp_path: Path) -> None:
    """Their cost depends on the rate: what comes out still fits."""
    image = {**CAMERA, "size_bytes": 3000, "rate_hz": 5.0, "reliable": True}
    link = satellite(shipped, tmp_path, POSE, image)
    assert link.word == "fits at reduced rates"
    assert link.capacity.admits(link.thinned_up_bps, link.thinned_down_bps)
    assert link.down_bps > link.other_down_bps


def test_capacity_through_the_vpn_includes_its_overhead(shipped: Inventory, tmp_path: Path) -> None:
    kept(tmp_path / "beside", text=both_ways())
    kept(tmp_path / "vpn", text=both_ways(), far_end=measured_run().far_end.model_copy(update={"over_vpn": True}))
    beside, through = (satellite(shipped, tmp_path / name, POSE).capacity for name in ("beside", "vpn"))
    # 52 octets more around each chunk of 1000 and around each answer.
    assert 1.04 < through.down_bps / beside.down_bps < 1.07


def test_exceeded_guideline_is_a_warning(shipped: Inventory, tmp_path: Path) -> None:
    kept(tmp_path, text=both_ways())
    link = satellite(shipped, tmp_path, {**POSE, "rate_hz": 5.0})
    assert link.verdict is Verdict.WARN
    assert link.warnings == ("/pose at 5 Hz is above the report's guideline (numbers and poses: 1 to 4 Hz)",)


def test_long_message_that_delays_others_is_a_warning(shipped: Inventory, tmp_path: Path) -> None:
    (link,) = fit(shipped, tmp_path, {**SONAR, "rate_hz": 0.1, "size_bytes": 100_000}, link="satellite").links
    assert link.fits
    assert link.topics[0].seconds == pytest.approx(100_000 * 8 / 352_000, rel=0.25)
    assert "s to leave the site and delays those behind it" in link.warnings[-1]


def test_cost_per_hour_and_per_day(shipped: Inventory, tmp_path: Path) -> None:
    link = satellite(shipped, tmp_path, POSE)
    hour, day = link.costs(3600), link.costs(86_400)
    assert hour.payload_bytes == round((link.up_bps + link.down_bps) * 3600 / 8)
    assert (hour.price, hour.currency) == (Decimal(8) * hour.billed_bytes / 1_000_000, "EUR")
    assert day.payload_bytes == pytest.approx(24 * hour.payload_bytes, abs=24)
    told = link.as_dict()
    assert told["declared"]["hour"]["price"] == str(hour.price)
    assert told["thinned"] is None


@pytest.mark.parametrize(
    ("more", "error", "words"),
    [
        ({"link": "satelite"}, UsageError, "`coastal` has no link `satelite`"),
        ({"run": "satellite-20200101T000000Z"}, NoSuchRun, "coastal has no measurement"),
    ],
)
def test_unknown_names_are_reported(
    shipped: Inventory, tmp_path: Path, more: dict[str, str], error: type[Exception], words: str
) -> None:
    with pytest.raises(error, match=words):
        fit(shipped, tmp_path, POSE, **more)


def test_run_applies_to_its_link_only(shipped: Inventory, tmp_path: Path) -> None:
    run = kept(tmp_path)
    with pytest.raises(UsageError, match="Z measured satellite, not 4g"):
        fit(shipped, tmp_path, POSE, run=run, link="4g")
    assert [link.link.name for link in fit(shipped, tmp_path, POSE, run=run).links] == ["satellite"]


def test_vehicle_without_telemetry_is_an_error(shipped: Inventory, tmp_path: Path) -> None:
    with pytest.raises(NoMatchError, match="has no `telemetry:`"):
        fit(shipped, tmp_path)


# What the declaration says of measured links, beside what is shipped for them.


def test_inventory_accepts_the_shipped_threshold_names() -> None:
    assert [name.value for name in ThresholdsName] == list(profiles())


def test_every_threshold_can_be_set_in_the_inventory() -> None:
    assert LinkThresholds.model_fields.keys() == {"profile", *QualifyProfile.model_fields}


def test_key_and_port_are_those_of_the_far_end() -> None:
    assert KEY_OCTETS == MIN_KEY_SIZE
    assert Qualify.model_fields["port"].default == PORT
