"""Wrong streams of GPS, USBL and acoustic modems: none passes, and no true one fails.

A few seeds of every lie in CI, many with `make campaign`; a seed that is told is played again by its number:
`make campaign ARGS='tests/campaign/test_wrong_streams_positions.py -k LIE'`. Streams that gpsd's maintainers have
recorded are taken as well where they lie in `../shared/data/gpsd` (`test/daemon/*.log` of its source).
"""

import math
import re
from collections.abc import Callable, Mapping
from dataclasses import replace
from datetime import UTC, datetime
from functools import cache
from itertools import pairwise
from pathlib import Path
from random import Random

import pytest

from atlantis_netcfg.checklist.probes import (
    Cell,
    Listen,
    Place,
    Probe,
    ProbeResult,
    Rows,
    Transcript,
    Trouble,
    acoustic,
    usbl,
)
from atlantis_netcfg.checklist.probes.gps import GpsExpectation, RouterosGps, StreamGps
from atlantis_netcfg.core.events import Verdict
from atlantis_netcfg.inventory import Inventory, load
from atlantis_netcfg.inventory.model import Geofence, GpsDriver
from campaign import positions
from campaign.positions import Ride, Stream

CHECKOUT = Path(__file__).resolve().parents[2]
RECORDED = CHECKOUT.parent / "shared" / "data" / "gpsd"
GREEN = frozenset({Verdict.PASS, Verdict.WARN, Verdict.SKIP})
ONLY_WARNED = frozenset({("gpsd", "no satellites")})
"""gpsd does not tell how many satellites GGA names, and counts wrongly for some receivers: no more than a warning."""
SEEDS, SAMPLE = 25, 2
TRUE_SEEDS, TRUE_SAMPLE = 200, 12


def gps(heard: Stream, driver: GpsDriver) -> ProbeResult:
    fence = Geofence(latitude=heard.place[0], longitude=heard.place[1], radius_m=heard.radius_m)
    wanted = GpsExpectation("Sparus", driver, "a source", "an end", "this computer", fence, three=heard.flies)
    return StreamGps(wanted, Place.LAPTOP, address="127.0.0.1", port=1).judge({"positions": transcript(heard)})


def transcript(heard: Stream) -> Transcript:
    trouble = Trouble(heard.trouble) if heard.trouble else None
    return Transcript(trouble, heard.words, heard.chunks, heard.began, heard.ended_s)


def routeros(ridden: Ride) -> ProbeResult:
    fence = Geofence(latitude=ridden.place[0], longitude=ridden.place[1], radius_m=ridden.radius_m)
    wanted = GpsExpectation("Site", GpsDriver.ROUTEROS, "GPS of r", "r", "r", fence, three=ridden.flies)
    heard = ridden.began + (ridden.ended_s or ridden.epochs[-1].at_s) + 0.3
    answers = {
        "monitor": Rows(None, rows=(positions.row(ridden),), response_time=heard),
        "settings": Rows(None, rows=({"enabled": "true"},), response_time=heard),
        "clock": Rows(None, rows=({"gmt-offset": "+00:00"},), response_time=heard),
    }
    return RouterosGps(wanted, "r").judge(answers)


@cache
def declaration() -> Inventory:
    return load(CHECKOUT / "inventory")


ROWS = {"evologics": "girona500", "seatrac": "zarco"}
"""Each has the address 1, and hears the address 2."""


@cache
def of_modem(column: str, language: str) -> Probe:
    steps = acoustic.steps if column == "acoustic" else usbl.steps
    probe = steps(Cell(declaration(), "coastal", ROWS[language], column))[0].probe
    assert probe is not None
    return probe


def judged_modem(column: str, heard: Stream, language: str) -> ProbeResult:
    probe = of_modem(column, language)
    (question,) = probe.asks()
    assert isinstance(question, Listen)
    return probe.judge({question.name: transcript(heard)})


def nmea_lie(lie: str, rng: Random) -> ProbeResult | None:
    needs, tell = positions.RIDES[lie]
    styles = sorted(name for name, (_, told) in positions.STYLES.items() if needs <= told)
    ridden = tell(rng, positions.ride(rng, rng.choice(styles)))
    return gps(positions.stream(ridden), rng.choice((GpsDriver.NMEA_TCP, GpsDriver.NMEA_SERIAL)))


def gpsd_lie(lie: str, rng: Random) -> ProbeResult | None:
    needs, tell = positions.RIDES[lie]
    if not needs <= positions.GPSD_TELLS:
        return None
    return gps(positions.stream(tell(rng, positions.ride(rng, rng.choice(positions.VERSIONS)))), GpsDriver.GPSD)


def routeros_lie(lie: str, rng: Random) -> ProbeResult | None:
    needs, tell = positions.RIDES[lie]
    true = positions.ride(rng, "u-blox")
    if lie in positions.NO_STREAM or not needs <= positions.ROUTEROS_TELLS:
        return None
    ridden = tell(rng, true)
    told = (positions.row(ridden), ridden.flies)
    return None if told == (positions.row(true), true.flies) else routeros(ridden)


def stream_lie(lie: str, rng: Random) -> ProbeResult | None:
    if rng.random() < 0.5:
        heard = positions.stream(positions.ride(rng, rng.choice(sorted(positions.STYLES))))
        return gps(positions.STREAMS[lie](rng, heard), GpsDriver.NMEA_TCP)
    heard = positions.stream(positions.ride(rng, rng.choice(positions.VERSIONS)))
    return gps(positions.STREAMS[lie](rng, heard), GpsDriver.GPSD)


def modem_lie(column: str, language: str) -> Callable[[str, Random], ProbeResult | None]:
    lies = positions.FIXES if column == "usbl" else positions.STATES

    def lie_of(lie: str, rng: Random) -> ProbeResult | None:
        languages, tell = lies[lie]
        if language not in languages:
            return None
        return judged_modem(column, positions.spoken(tell(rng, positions.modem(rng, language, 1, 2))), language)

    return lie_of


def modem_stream_lie(lie: str, rng: Random) -> ProbeResult:
    """What is no modem at all, or says one thing only."""
    column, language = rng.choice(("acoustic", "usbl")), rng.choice(sorted(ROWS))
    heard = positions.STREAMS[lie](rng, positions.spoken(positions.modem(rng, language, 1, 2)))
    return judged_modem(column, heard, language)


LIARS: Mapping[str, tuple[Mapping[str, object], Callable[[str, Random], ProbeResult | None]]] = {
    "nmea": (positions.RIDES, nmea_lie),
    "gpsd": (positions.RIDES, gpsd_lie),
    "routeros": (positions.RIDES, routeros_lie),
    "streams": (positions.STREAMS, stream_lie),
    "modem streams": ({lie: positions.STREAMS[lie] for lie in ("another service", "` received at")}, modem_stream_lie),
    "usbl evologics": (positions.FIXES, modem_lie("usbl", "evologics")),
    "usbl seatrac": (positions.FIXES, modem_lie("usbl", "seatrac")),
    "acoustic evologics": (positions.STATES, modem_lie("acoustic", "evologics")),
    "acoustic seatrac": (positions.STATES, modem_lie("acoustic", "seatrac")),
}
LIES = [(liar, lie) for liar, (lies, _) in LIARS.items() for lie in lies]


def told(found: ProbeResult) -> str:
    return ", ".join(f"{one.verdict} {one.code}" for one in found.findings)


def believed(liar: str, lie: str, seeds: int) -> tuple[int, list[str]]:
    """How many wrong streams there were, and those that were believed."""
    found = {seed: LIARS[liar][1](lie, Random(f"{liar}/{lie}/{seed}")) for seed in range(seeds)}  # noqa: S311 - no secret
    played = {seed: one for seed, one in found.items() if one is not None}
    green = {Verdict.PASS} if (liar, lie) in ONLY_WARNED else GREEN
    return len(played), [f"seed {seed}: {told(one)}" for seed, one in played.items() if one.verdict in green]


@pytest.mark.parametrize(("liar", "lie"), LIES)
def test_sample_of_false_streams_is_never_accepted(liar: str, lie: str) -> None:
    assert believed(liar, lie, SAMPLE)[1] == []


@pytest.mark.campaign
@pytest.mark.parametrize(("liar", "lie"), LIES)
def test_false_streams_are_never_accepted(liar: str, lie: str) -> None:
    assert believed(liar, lie, SEEDS)[1] == []


@pytest.mark.campaign
def test_number_of_false_streams_is_sufficient() -> None:
    """At least a hundred for each probe and source, and with those of the other probes over two thousand."""
    played = {liar: sum(believed(liar, lie, SEEDS)[0] for lie in lies) for liar, (lies, _) in LIARS.items()}
    assert min(number for liar, number in played.items() if "streams" not in liar) >= 200
    assert sum(played.values()) > 2000


TRUTHS: Mapping[str, Callable[[Random], ProbeResult]] = {
    **{
        f"nmea: {style}": lambda rng, style=style: gps(  # type: ignore[misc]
            positions.stream(positions.ride(rng, style)), GpsDriver.NMEA_TCP
        )
        for style in positions.STYLES
    },
    **{
        f"gpsd: {version}": lambda rng, version=version: gps(  # type: ignore[misc]
            positions.stream(positions.ride(rng, version)), GpsDriver.GPSD
        )
        for version in positions.VERSIONS
    },
    "routeros": lambda rng: routeros(positions.ride(rng, "u-blox")),
    **{
        f"{column}: {language}": lambda rng, column=column, language=language: judged_modem(  # type: ignore[misc]
            column, positions.spoken(positions.modem(rng, language, 1, 2)), language
        )
        for column in ("usbl", "acoustic")
        for language in ROWS
    },
}
WITHOUT_A_DATE = frozenset({"nmea: GLL alone", "nmea: GGA alone"})
"""They warn; everything else passes."""


def doubted(truth: str, seeds: int) -> list[str]:
    good = {Verdict.WARN} if truth in WITHOUT_A_DATE else {Verdict.PASS}
    found = {seed: TRUTHS[truth](Random(f"{truth}/{seed}")) for seed in range(seeds)}  # noqa: S311 - no secret
    return [f"seed {seed}: {told(one)}" for seed, one in found.items() if one.verdict not in good]


@pytest.mark.parametrize("truth", TRUTHS)
def test_sample_of_true_streams_is_accepted(truth: str) -> None:
    assert doubted(truth, TRUE_SAMPLE) == []


@pytest.mark.campaign
@pytest.mark.parametrize("truth", TRUTHS)
def test_true_streams_are_accepted(truth: str) -> None:
    assert doubted(truth, TRUE_SEEDS) == []


# Recorded by others.

LOGS = sorted(RECORDED.glob("*.log"))
_RMC = re.compile(
    rb"\$..RMC,(\d{6})(?:\.\d+)?,A,(\d\d)(\d\d\.\d+),([NS]),(\d{3})(\d\d\.\d+),([EW]),[^,]*,[^,]*,(\d{6}),"
)
_LISTENED = 6


def recorded(path: Path) -> Stream | None:
    """The last seconds of a log in which each RMC has a fix, heard when they were recorded; None: it has none."""
    heard = None
    epochs: list[tuple[float, float, float, bytes]] = []
    for line in path.read_bytes().splitlines(keepends=True):
        found = _RMC.match(line)
        if found is not None:
            epochs = [*epochs, (*_when_and_where(found), line)][-_LISTENED - 1 :]
        elif b"RMC," in line:
            epochs = []
        elif epochs and line.startswith(b"$"):
            epochs[-1] = (*epochs[-1][:3], epochs[-1][3] + line)
        # The last one is not whole yet.
        if len(epochs) > _LISTENED and all(0 < then[0] - one[0] <= 2 for one, then in pairwise(epochs)):
            began, latitude, longitude, _ = epochs[0]
            chunks = tuple((at - began + 0.3, data) for at, _, _, data in epochs[:-1])
            heard = positions.Stream(chunks, began, chunks[-1][0] + 0.1, place=(latitude, longitude))
    return heard


def _when_and_where(found: re.Match[bytes]) -> tuple[float, float, float]:
    at = datetime.strptime((found[8] + found[1]).decode(), "%d%m%y%H%M%S").replace(tzinfo=UTC)
    latitude = (int(found[2]) + float(found[3]) / 60) * (1 if found[4] == b"N" else -1)
    longitude = (int(found[5]) + float(found[6]) / 60) * (1 if found[7] == b"E" else -1)
    return at.timestamp(), latitude, longitude


RECORDED_LIES: Mapping[str, Callable[[Stream], Stream]] = {
    "of an hour ago": lambda one: replace(one, began=one.began + 3700),
    "of two days ago": lambda one: replace(one, began=one.began + 2 * 86_400),
    "is dated in the future:": lambda one: replace(one, began=one.began - 500),
    "one epoch again and again": lambda one: replace(one, chunks=tuple((at, one.chunks[0][1]) for at, _ in one.chunks)),
    "in a loop": lambda one: replace(
        one, chunks=tuple((at, one.chunks[n % 3][1]) for n, (at, _) in enumerate(one.chunks))
    ),
    "stopped": lambda one: replace(one, ended_s=one.ended_s + 8),
    "somewhere else": lambda one: replace(one, place=(one.place[0] - math.copysign(1, one.place[0]), one.place[1])),
    "swapped": lambda one: replace(one, place=(max(-90.0, min(90.0, one.place[1])), one.place[0])),
}


RECORDED_IN_TROUBLE = {"foretrex-201.log": "FAIL no-satellites", "sl869.log": "FAIL position-jumps"}
"""The one holds a fix after its last satellite, the first fixes of the other are 72 m apart."""


@pytest.mark.skipif(not LOGS, reason="no logs of gpsd in ../shared/data/gpsd")
def test_recorded_streams_pass_and_their_falsified_copies_do_not() -> None:
    """Every log that has some seconds with a fix: true when it was recorded, and wrong in every other way."""
    streams = {path.name: heard for path in LOGS if (heard := recorded(path)) is not None}
    found = {name: gps(heard, GpsDriver.NMEA_TCP) for name, heard in streams.items()}
    assert len(found) > 20
    in_trouble = {name: told(one) for name, one in found.items() if one.verdict not in GREEN}
    assert in_trouble == {name: codes for name, codes in RECORDED_IN_TROUBLE.items() if name in found}
    lies = {
        f"{name}, {lie}": gps(tell(heard), GpsDriver.NMEA_TCP)
        for name, heard in streams.items()
        for lie, tell in RECORDED_LIES.items()
    }
    assert {name: told(one) for name, one in lies.items() if one.verdict in GREEN} == {}
