"""Every mood of the receivers' twins, heard by the program that listens on site, is told as what it is."""

from contextlib import ExitStack

from gnss_stand import Asked, codes, judged

from atlantis_netcfg.emulator.gnss import GnssAccess, GnssSpec, RunningGpsd, RunningNmea, RunningNmeaPort, Speech
from atlantis_netcfg.inventory.model import GpsDriver

GPSD, TCP, SERIAL = GpsDriver.GPSD, GpsDriver.NMEA_TCP, GpsDriver.NMEA_SERIAL

CASES: dict[str, tuple[GpsDriver, GnssSpec, list[str]]] = {
    "gpsd, healthy": (GPSD, GnssSpec(), ["PASS fix"]),
    "gpsd, byte by byte": (GPSD, GnssSpec(piecewise=True), ["PASS fix"]),
    "gpsd, stale": (GPSD, GnssSpec(stale=True), ["FAIL fix-stale"]),
    "gpsd, stops": (GPSD, GnssSpec(silent_after=3), ["FAIL fix-stale"]),
    "gpsd, fix lost": (GPSD, GnssSpec(lost_after=3), ["FAIL fix-lost"]),
    "gpsd, zeros": (GPSD, GnssSpec(null=True), ["FAIL position-null"]),
    "gpsd, far away": (GPSD, GnssSpec(latitude=38.7), ["FAIL outside-geofence"]),
    "gpsd, surveyed": (GPSD, GnssSpec(status=7), ["INCONCLUSIVE position-manual"]),
    "gpsd, uncertain": (GPSD, GnssSpec(eph_m=90.0), ["WARN position-uncertain"]),
    "gpsd, damaged": (GPSD, GnssSpec(damage_interval=2, every_s=0.1), ["WARN damaged"]),
    "gpsd, silent": (GPSD, GnssSpec(speech=Speech.NOTHING), ["FAIL no-data"]),
    "gpsd, garbage": (GPSD, GnssSpec(speech=Speech.GARBAGE), ["FAIL no-data"]),
    "gpsd, not started": (GPSD, GnssSpec(access=GnssAccess.UNREACHABLE), ["FAIL driver-not-started"]),
    "gpsd, mute": (GPSD, GnssSpec(access=GnssAccess.MUTE), ["FAIL no-data"]),
    "NMEA, healthy": (TCP, GnssSpec(), ["PASS fix"]),
    "NMEA, byte by byte": (TCP, GnssSpec(piecewise=True), ["PASS fix"]),
    "NMEA, no fix": (TCP, GnssSpec(mode=1), ["FAIL no-fix"]),
    "NMEA, stale": (TCP, GnssSpec(stale=True), ["FAIL fix-stale"]),
    "NMEA, swapped": (TCP, GnssSpec(has_swapped_axes=True), ["FAIL position-swapped"]),
    "NMEA, jumping": (TCP, GnssSpec(jumping_m=200.0), ["FAIL position-jumps"]),
    "NMEA, simulated": (TCP, GnssSpec(status=8), ["FAIL position-simulated"]),
    "NMEA, clock": (TCP, GnssSpec(time_offset_s=40.0), ["INCONCLUSIVE clock-differs"]),
    "NMEA, no date": (TCP, GnssSpec(has_time=False), ["WARN no-date"]),
    "NMEA, poor": (TCP, GnssSpec(hdop=9.0), ["WARN position-uncertain"]),
    "NMEA, garbage": (TCP, GnssSpec(speech=Speech.GARBAGE), ["FAIL not-nmea"]),
    "NMEA, silent": (TCP, GnssSpec(speech=Speech.NOTHING), ["INCONCLUSIVE no-data"]),
    "NMEA, in use": (TCP, GnssSpec(access=GnssAccess.IN_USE), ["INCONCLUSIVE in-use"]),
    "NMEA, refused": (TCP, GnssSpec(access=GnssAccess.UNREACHABLE), ["INCONCLUSIVE refused"]),
    "serial, healthy": (SERIAL, GnssSpec(), ["PASS fix"]),
    "serial, byte by byte": (SERIAL, GnssSpec(piecewise=True), ["PASS fix"]),
    "serial, no fix": (SERIAL, GnssSpec(mode=1), ["FAIL no-fix"]),
    "serial, wrong rate": (SERIAL, GnssSpec(speech=Speech.GARBAGE), ["FAIL not-nmea"]),
    "serial, stops": (SERIAL, GnssSpec(silent_after=3), ["FAIL fix-stale"]),
    "serial, silent": (SERIAL, GnssSpec(speech=Speech.NOTHING), ["FAIL no-data"]),
}
SHORT_S = 0.8
LONG_S = 2.2
"""For those that would be listened to until the end: so long is enough to tell."""


def listened(name: str, spec: GnssSpec) -> float | None:
    if spec.speech is not Speech.POSITIONS or spec.access is not GnssAccess.OPEN:
        return SHORT_S
    until_the_end = spec.silent_after is not None or spec.damage_interval or "no date" in name
    return LONG_S if until_the_end else None


def test_every_mood_gets_its_verdict() -> None:
    """All of them at once; none is sent what a receiver must not be sent."""
    running: list[RunningGpsd | RunningNmea | RunningNmeaPort] = []
    asked = {}
    with ExitStack() as stack:
        for name, (driver, spec, _) in CASES.items():
            max_age_s = 3.0 if spec.silent_after is None else 0.7
            if driver is SERIAL:
                port = stack.enter_context(RunningNmeaPort(spec))
                asked[name] = Asked(driver, path=port.path, listen_s=listened(name, spec), max_age_s=max_age_s)
                running.append(port)
                continue
            server: RunningGpsd | RunningNmea = RunningGpsd(spec) if driver is GPSD else RunningNmea(spec)
            stack.enter_context(server)
            asked[name] = Asked(driver, server.port, listen_s=listened(name, spec), max_age_s=max_age_s)
            running.append(server)
        found = judged(asked)
        assert [twin.forbidden for twin in running if twin.forbidden] == []
    assert {name: codes(one) for name, one in found.items()} == {name: case[2] for name, case in CASES.items()}


def test_missing_serial_port_is_reported() -> None:
    found = judged({"gone": Asked(SERIAL, path="/dev/ttyEXAMPLE")})["gone"]
    assert codes(found) == ["FAIL device-missing"]
