"""What sources say, and every sentence that a technician is told of it."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import gps_said as say
from gps_said import NO_FIX, SKY, epoch, fixes, gga, gll, gns, gpsd, gsa, heard, nmea, no_fix, rmc, tagged, tpv

from atlantis_netcfg.checklist.probes import Trouble
from atlantis_netcfg.declaration.model import GpsDriver

if TYPE_CHECKING:
    from atlantis_netcfg.checklist.probes import Transcript

GPSD, TCP, SERIAL = GpsDriver.GPSD, GpsDriver.NMEA_TCP, GpsDriver.NMEA_SERIAL


@dataclass(frozen=True)
class Case:
    name: str
    driver: GpsDriver
    transcript: Transcript
    findings: tuple[str, ...]
    wanted: dict[str, Any] = field(default_factory=dict)


def troubled(trouble: Trouble, words: str = "") -> Transcript:
    return heard((), 0.0, trouble=trouble, words=words)


ROOF = {"clear_sky": False}
EPOCHS = [epoch(second) for second in range(5)]
SWAPPED = "0850.32959,S,04141.18520,E"
FAR = "3842.00000,N,00909.00000,W"
NEAR = "4141.20520,N,00850.32959,W"
"""Forty metres north."""
OTHER = "/dev/ttyS9"
WELL = "PASS fix: Girona 500 has a 3D fix of 9 satellites at 41.68642, -8.83883, 3 m from the middle of the geofence"
WELL_SPARUS = WELL.replace("Girona 500", "Sparus")


def both(*pairs: tuple[dict[str, Any], dict[str, Any]]) -> Transcript:
    """Two receivers behind one gpsd."""
    return heard(gpsd(*[one for pair in pairs for one in pair], every_s=0.5))


LIES = (
    # Each lie beside a neighbour that is true.
    Case(
        "NMEA, a fix of no satellites",
        TCP,
        heard(nmea(*[gga(s, used="00") + rmc(s) + gsa() for s in range(5)])),
        ("FAIL no-satellites: Girona 500's receiver claims a fix of 0 satellites: 3 are the fewest",),
    ),
    Case(
        "NMEA, a fix of three satellites",
        TCP,
        heard(nmea(*[gga(s, used="03") + rmc(s) + gsa(2) for s in range(5)])),
        (WELL.replace("3D fix of 9", "2D fix of 3"),),
    ),
    Case(
        "gpsd, satellites in view and none used",
        GPSD,
        heard(gpsd(*fixes(5), sky={**SKY, "uSat": 0})),
        ("WARN no-satellites: Sparus's receiver claims a fix of 0 satellites: 3 are the fewest",),
    ),
    Case(
        "gpsd, a receiver that tells no satellites",
        GPSD,
        heard(gpsd(*fixes(5), sky={**SKY, "uSat": 0, "nSat": 0})),
        (WELL_SPARUS.replace(" of 9 satellites", ""),),
    ),
    Case(
        "gpsd, the satellites of another receiver",
        GPSD,
        heard([*gpsd(*fixes(5)), (4.25, say.said({**SKY, "device": OTHER, "uSat": 0}))]),
        (WELL_SPARUS,),
    ),
    Case(
        "NMEA, one system of several has a fix",
        TCP,
        heard(nmea(*[gga(s) + rmc(s) + gsa(3) + gsa(1, talker="GL") for s in range(5)])),
        (WELL,),
    ),
    Case(
        "NMEA, no system of several has a fix",
        TCP,
        heard(nmea(*[gga(s) + rmc(s) + gsa(1) + gsa(1, talker="GL") for s in range(10)])),
        ("FAIL no-fix: Girona 500's receiver works and has no fix",),
    ),
    Case("NMEA, TAG blocks", TCP, heard(nmea(*[tagged(one) for one in EPOCHS])), (WELL,)),
    Case(
        "NMEA, a TAG block for the first of a group",
        TCP,
        heard(nmea(*[tagged(gga(s), "g:1-2-7,s:A") + tagged(rmc(s), "g:2-2-7") for s in range(5)])),
        (WELL,),
    ),
    Case(
        "NMEA, TAG blocks with a wrong checksum",
        TCP,
        heard(nmea(*[tagged(one).replace(b"s:GP0001", b"s:GP0002") for one in EPOCHS]), 15.0),
        ("FAIL not-nmea: 1391 bytes came from 10.64.1.21:10110, no whole NMEA sentence among them",),
    ),
    Case(
        "NMEA, two receivers of a multiplexer agree",
        TCP,
        heard(nmea(*[tagged(epoch(s), "s:A") + tagged(epoch(s, NEAR), "s:B") for s in range(5)])),
        (WELL,),
    ),
    Case(
        "NMEA, two receivers of a multiplexer are in two places",
        TCP,
        heard(nmea(*[tagged(epoch(s), "s:A") + tagged(epoch(s, FAR), "s:B") for s in range(5)])),
        (
            (
                "INCONCLUSIVE positions-differ: two positions come from 10.64.1.21:10110, "
                "333 km apart: which is Girona 500's?"
            ),
        ),
    ),
    Case(
        "gpsd, two receivers agree",
        GPSD,
        both(*[(tpv(s), tpv(s, device=OTHER, lat=say.LATITUDE + 0.0004)) for s in range(5)]),
        (WELL_SPARUS,),
    ),
    Case(
        "gpsd, two receivers are in two places",
        GPSD,
        both(*[(tpv(s), tpv(s, device=OTHER, lat=41.7)) for s in range(5)]),
        ("INCONCLUSIVE positions-differ: two positions come from 10.64.1.22:2947, 1510 m apart: which is Sparus's?",),
    ),
    Case(
        "NMEA, GGA and RMC are in two places",
        TCP,
        heard(nmea(*[rmc(s, SWAPPED) + gga(s) for s in range(5)])),
        (
            (
                "INCONCLUSIVE positions-differ: two positions come from 10.64.1.21:10110, "
                "7614 km apart: which is Girona 500's?"
            ),
        ),
    ),
    Case(
        "NMEA, GLL only",
        TCP,
        heard(nmea(*[gll(s) for s in range(5)])),
        ("WARN no-date: Girona 500's positions have a time and no date: GGA and GLL have none",),
    ),
    Case(
        "NMEA, GLL and ZDA",
        TCP,
        heard(nmea(*[say.framed(f"GPZDA,{say.clock(s)}.00,20,11,2026,00,00") + gll(s) for s in range(5)])),
        (WELL.replace("3D fix of 9 satellites", "2D fix"),),
    ),
    Case(
        "NMEA, GLL is void",
        TCP,
        heard(nmea(*[gga(s) + gll(s, status="V", mode="N") for s in range(10)])),
        ("FAIL no-fix: Girona 500's receiver works and has no fix",),
    ),
    Case(
        "NMEA, RMC is active and its mode is not",
        TCP,
        heard(nmea(*[rmc(s, mode="N") for s in range(10)])),
        ("FAIL no-fix: Girona 500's receiver works and has no fix",),
    ),
    Case(
        "NMEA, GNS in place of GGA",
        TCP,
        heard(nmea(*[gns(s) + rmc(s) for s in range(5)])),
        (WELL.replace("of 9", "of 14"),),
    ),
    Case(
        "NMEA, GNS of systems that are not used",
        TCP,
        heard(nmea(*[gns(s, "NN", "00") + rmc(s) for s in range(10)])),
        ("FAIL no-fix: Girona 500's receiver works and has no fix",),
    ),
    Case(
        "NMEA, GNS is simulated",
        TCP,
        heard(nmea(*[gns(s, "SN") + rmc(s) for s in range(5)])),
        ("FAIL position-simulated: Girona 500's position is simulated, not measured",),
    ),
    Case(
        "gpsd, one report among measured ones is simulated",
        GPSD,
        heard(gpsd(*fixes(2), tpv(2, status=8), tpv(3), tpv(4))),
        ("FAIL position-simulated: Sparus's position is simulated, not measured",),
    ),
    Case(
        "NMEA, a log of an hour ago",
        TCP,
        heard(nmea(*[epoch(s - 3700) for s in range(5)])),
        ("FAIL clock-differs: Girona 500's receiver is 62 min behind the clock of coastal-gateway",),
    ),
    Case(
        "NMEA, a log of two days ago at this time of day",
        TCP,
        heard(nmea(*[epoch(s - 2 * 86400) for s in range(5)])),
        ("FAIL clock-differs: Girona 500's receiver is 2 days behind the clock of coastal-gateway",),
    ),
    Case("NMEA, two seconds late", TCP, heard(nmea(*[epoch(s - 2) for s in range(5)])), (WELL,)),
    Case(
        "gpsd, a log ten times as fast",
        GPSD,
        heard(gpsd(*[tpv(10 * (s - 2)) for s in range(5)])),
        ("FAIL time-uneven: Sparus's time does not go as the clock of coastal-gateway does: they move 36.0 s apart",),
    ),
    Case(
        "gpsd, a log of three seconds in a loop",
        GPSD,
        heard(gpsd(*[tpv(s % 3) for s in range(9)])),
        ("FAIL time-goes-back: Sparus's time goes back by 2.0 s from one position to the next",),
    ),
    Case(
        "gpsd, ten reports a second", GPSD, heard(gpsd(*[tpv(s / 10) for s in range(10)], every_s=0.1)), (WELL_SPARUS,)
    ),
    Case(
        "NMEA, moving while the position stands still",
        TCP,
        heard(nmea(*[gga(s) + rmc(s, knots=6.0) for s in range(5)])),
        ("FAIL position-frozen: Girona 500's position stands still while its speed is 3.1 m/s",),
    ),
    Case(
        "NMEA, moving",
        TCP,
        heard(nmea(*[rmc(s, f"4141.{18520 + 170 * s},N,00850.32959,W", knots=6.0) for s in range(5)])),
        (WELL.replace("3D fix of 9 satellites at 41.68642, -8.83883, 3 m", "2D fix at 41.68653, -8.83883, 15 m"),),
    ),
    Case(
        "gpsd, an error wider than the site",
        GPSD,
        heard(gpsd(*fixes(5, eph=4200.0))),
        ("INCONCLUSIVE position-uncertain: Sparus's position is uncertain: the receiver's estimate is 4200 m",),
    ),
    Case(
        "NMEA, the HDOP of no fix",
        TCP,
        heard(nmea(*[gga(s, hdop=99.99) + rmc(s) for s in range(5)])),
        ("INCONCLUSIVE position-uncertain: Girona 500's satellites stand badly: HDOP 100.0",),
    ),
    Case(
        "NMEA, most lines are damaged",
        TCP,
        heard([*nmea(*EPOCHS), (4.25, b"$GPGGA,1*00\r\n" * 20)]),
        ("FAIL damaged: 20 of 35 lines from 10.64.1.21:10110 are damaged",),
    ),
    Case(
        "gpsd, nobody knows when it was heard",
        GPSD,
        replace(heard(gpsd(*fixes(5))), began=0.0),
        ("INCONCLUSIVE clock-unknown: nobody has compared the time of Sparus's receiver with a clock",),
    ),
)

CASES = (
    # Healthy.
    Case(
        "gpsd, healthy",
        GPSD,
        heard(gpsd(*fixes(5))),
        ("PASS fix: Sparus has a 3D fix of 9 satellites at 41.68642, -8.83883, 3 m from the middle of the geofence",),
    ),
    Case(
        "gpsd, healthy, without a sky",
        GPSD,
        heard(gpsd(*fixes(5), sky=None)),
        ("PASS fix: Sparus has a 3D fix at 41.68642, -8.83883, 3 m from the middle of the geofence",),
    ),
    Case(
        "gpsd, RTK fixed",
        GPSD,
        heard(gpsd(*fixes(5, status=3, eph=0.02))),
        ("PASS fix: Sparus has a 3D fix of 9 satellites at 41.68642, -8.83883, 3 m from the middle of the geofence",),
    ),
    Case(
        "gpsd, two dimensions are enough on water",
        GPSD,
        heard(gpsd(*fixes(5, mode=2))),
        ("PASS fix: Sparus has a 2D fix of 9 satellites at 41.68642, -8.83883, 3 m from the middle of the geofence",),
    ),
    Case(
        "gpsd, found its fix while we listened",
        GPSD,
        heard(gpsd(NO_FIX, NO_FIX, *[tpv(second + 2) for second in range(5)])),
        ("PASS fix: Sparus has a 3D fix of 9 satellites at 41.68642, -8.83883, 3 m from the middle of the geofence",),
    ),
    Case(
        "gpsd, two receivers, the other one without a fix",
        GPSD,
        heard(
            gpsd(
                *[one for second in range(5) for one in (tpv(second), {**NO_FIX, "device": "/dev/ttyS9"})], every_s=0.5
            )
        ),
        ("PASS fix: Sparus has a 3D fix of 9 satellites at 41.68642, -8.83883, 3 m from the middle of the geofence",),
    ),
    Case(
        "gpsd, listened to from the middle of an epoch on",
        GPSD,
        heard(gpsd({"class": "TPV", "device": say.PATH, "mode": 3, "eph": 17.1}, *fixes(5))),
        (("PASS fix: Sparus has a 3D fix of 9 satellites at 41.68642, -8.83883, 3 m from the middle of the geofence"),),
    ),
    Case(
        "gpsd, one epoch told three times",
        GPSD,
        heard(gpsd(tpv(0, time=None), tpv(0), tpv(0), tpv(1), tpv(2), every_s=0.5)),
        ("PASS fix: Sparus has a 3D fix of 9 satellites at 41.68642, -8.83883, 3 m from the middle of the geofence",),
    ),
    Case(
        "NMEA, healthy",
        TCP,
        heard(nmea(*EPOCHS)),
        (
            (
                "PASS fix: Girona 500 has a 3D fix of 9 satellites at 41.68642, -8.83883, 3 m "
                "from the middle of the geofence"
            ),
        ),
    ),
    Case(
        "NMEA, healthy, GNSS of several systems",
        TCP,
        heard(
            nmea(*[gga(s, talker="GN") + gsa(talker="GN") + gsa(talker="GN") + rmc(s, talker="GN") for s in range(5)])
        ),
        (
            (
                "PASS fix: Girona 500 has a 3D fix of 9 satellites at 41.68642, -8.83883, 3 m "
                "from the middle of the geofence"
            ),
        ),
    ),
    Case(
        "NMEA, healthy, RMC only",
        TCP,
        heard(nmea(*[rmc(second) for second in range(5)])),
        ("PASS fix: Girona 500 has a 2D fix at 41.68642, -8.83883, 3 m from the middle of the geofence",),
    ),
    Case(
        "serial, healthy",
        SERIAL,
        heard(nmea(*EPOCHS)),
        ("PASS fix: Zarco has a 3D fix of 9 satellites at 41.68642, -8.83883, 3 m from the middle of the geofence",),
    ),
    # Sick, without a fix.
    Case("gpsd, no fix", GPSD, heard(gpsd(*[NO_FIX] * 10)), ("FAIL no-fix: Sparus's receiver works and has no fix",)),
    Case(
        "gpsd, no fix under a roof",
        GPSD,
        heard(gpsd(*[NO_FIX] * 10)),
        (
            (
                "INCONCLUSIVE no-fix: Sparus's receiver works and has no fix, and the antenna "
                "may be under a roof (`clear_sky: false`)"
            ),
        ),
        ROOF,
    ),
    Case(
        "gpsd, mode is no number",
        GPSD,
        heard(gpsd(*fixes(5, mode="3"))),
        ("FAIL no-fix: Sparus's receiver works and has no fix",),
    ),
    Case(
        "NMEA, no fix",
        TCP,
        heard(nmea(*[no_fix(second) for second in range(10)])),
        ("FAIL no-fix: Girona 500's receiver works and has no fix",),
    ),
    Case(
        "NMEA, no fix under a roof",
        TCP,
        heard(nmea(*[no_fix(second) for second in range(10)])),
        (
            (
                "INCONCLUSIVE no-fix: Girona 500's receiver works and has no fix, and the "
                "antenna may be under a roof (`clear_sky: false`)"
            ),
        ),
        ROOF,
    ),
    Case(
        "NMEA, GGA has a fix and RMC is void",
        TCP,
        heard(nmea(*[gga(s) + rmc(s, status="V", mode="N") for s in range(10)])),
        ("FAIL no-fix: Girona 500's receiver works and has no fix",),
    ),
    # Sick, and not sustained.
    Case(
        "gpsd, fix lost",
        GPSD,
        heard(gpsd(*fixes(3), NO_FIX, NO_FIX)),
        ("FAIL fix-lost: Sparus's receiver had a fix and lost it while we listened",),
    ),
    Case(
        "gpsd, fix lost and hardly back",
        GPSD,
        heard(gpsd(*fixes(3), NO_FIX, tpv(4), tpv(5))),
        ("FAIL fix-lost: Sparus's receiver had a fix and lost it while we listened",),
    ),
    Case(
        "gpsd, fix lost under a roof",
        GPSD,
        heard(gpsd(*fixes(3), NO_FIX, NO_FIX)),
        (
            (
                "INCONCLUSIVE fix-lost: Sparus's receiver had a fix and lost it while we "
                "listened, and the antenna may be under a roof (`clear_sky: false`)"
            ),
        ),
        ROOF,
    ),
    Case(
        "gpsd, fix lost and back",
        GPSD,
        heard(gpsd(*fixes(2), NO_FIX, *[tpv(second + 3) for second in range(5)])),
        ("WARN fix-unsteady: Sparus's fix was lost and came back while we listened, once",),
    ),
    Case(
        "NMEA, fix lost",
        TCP,
        heard(nmea(*EPOCHS[:3], no_fix(3), no_fix(4))),
        ("FAIL fix-lost: Girona 500's receiver had a fix and lost it while we listened",),
    ),
    # Sick, with old positions.
    Case(
        "gpsd, time stands still",
        GPSD,
        heard(gpsd(*[tpv(0)] * 10)),
        ("FAIL fix-stale: Sparus's receiver tells the same position again and again: its time stands still",),
    ),
    Case(
        "gpsd, time stands still after a while",
        GPSD,
        heard(gpsd(*fixes(3), tpv(2), tpv(2), tpv(2))),
        ("FAIL fix-stale: Sparus's receiver tells the same position again and again: its time stands still",),
    ),
    Case(
        "gpsd, no more came",
        GPSD,
        heard(gpsd(*fixes(4)), 15.0),
        ("FAIL fix-stale: Sparus's last position is 12 s old: no more came",),
    ),
    Case(
        "NMEA, time stands still",
        TCP,
        heard(nmea(*[epoch(0)] * 10)),
        ("FAIL fix-stale: Girona 500's receiver tells the same position again and again: its time stands still",),
    ),
    Case(
        "NMEA, no more came",
        TCP,
        heard(nmea(*EPOCHS), 15.0),
        ("FAIL fix-stale: Girona 500's last position is 11 s old: no more came",),
    ),
    # Sick, in the wrong place.
    Case(
        "gpsd, swapped",
        GPSD,
        heard(gpsd(*fixes(5, lat=say.LONGITUDE, lon=say.LATITUDE))),
        (
            (
                "FAIL position-swapped: Sparus's latitude and longitude are swapped: -8.83883, "
                "41.68642 lies in the geofence the other way round"
            ),
        ),
    ),
    Case(
        "gpsd, somewhere else",
        GPSD,
        heard(gpsd(*fixes(5, lat=38.7, lon=-9.15))),
        ("FAIL outside-geofence: Sparus is at 38.70000, -9.15000, 333 km from the middle of the geofence of 1000 m",),
    ),
    Case(
        "gpsd, sign of the longitude lost",
        GPSD,
        heard(gpsd(*fixes(5, lon=-say.LONGITUDE))),
        ("FAIL outside-geofence: Sparus is at 41.68642, 8.83883, 1465 km from the middle of the geofence of 1000 m",),
    ),
    Case(
        "gpsd, sign of the latitude lost",
        GPSD,
        heard(gpsd(*fixes(5, lat=-say.LATITUDE))),
        ("FAIL outside-geofence: Sparus is at -41.68642, -8.83883, 9271 km from the middle of the geofence of 1000 m",),
    ),
    Case(
        "gpsd, zeros",
        GPSD,
        heard(gpsd(*fixes(5, lat=0.0, lon=0.0))),
        ("FAIL position-null: Sparus's position is 0, 0: its driver fills in zeros where it has nothing",),
    ),
    Case(
        "gpsd, no number",
        GPSD,
        heard(gpsd(*fixes(5, lat=float("nan")))),
        ("FAIL position-impossible: Sparus's receiver claims a fix at nan, -8.83883, which is no position",),
    ),
    Case(
        "gpsd, off the planet",
        GPSD,
        heard(gpsd(*fixes(5, lat=141.0))),
        ("FAIL position-impossible: Sparus's receiver claims a fix at 141.00000, -8.83883, which is no position",),
    ),
    Case(
        "gpsd, a fix without a position",
        GPSD,
        heard(gpsd(*fixes(5, lat=None, lon=None))),
        ("FAIL position-impossible: Sparus's receiver claims a fix at nowhere, which is no position",),
    ),
    Case(
        "gpsd, jumping",
        GPSD,
        heard(gpsd(*[tpv(s, lat=say.LATITUDE + 0.001 * (s % 2)) for s in range(5)])),
        ("FAIL position-jumps: Sparus's position jumps by 111 m from one report to the next",),
    ),
    Case(
        "gpsd, no geofence",
        GPSD,
        heard(gpsd(*fixes(5))),
        ("WARN no-geofence: Sparus is at 41.68642, -8.83883; nobody has declared where it should be",),
        {"fence": None},
    ),
    Case(
        "NMEA, swapped",
        TCP,
        heard(nmea(*[epoch(s, SWAPPED) for s in range(5)])),
        (
            (
                "FAIL position-swapped: Girona 500's latitude and longitude are swapped: "
                "-8.83883, 41.68642 lies in the geofence the other way round"
            ),
        ),
    ),
    Case(
        "NMEA, somewhere else",
        TCP,
        heard(nmea(*[epoch(s, FAR) for s in range(5)])),
        (
            (
                "FAIL outside-geofence: Girona 500 is at 38.70000, -9.15000, 333 km from the "
                "middle of the geofence of 1000 m"
            ),
        ),
    ),
    Case(
        "NMEA, impossible degrees",
        TCP,
        heard(nmea(*[epoch(s, "9941.18520,N,00850.32959,W") for s in range(5)])),
        ("FAIL position-impossible: Girona 500's receiver claims a fix at 99.68642, -8.83883, which is no position",),
    ),
    Case(
        "NMEA, a fix without a hemisphere",
        TCP,
        heard(nmea(*[epoch(s, "4141.18520,,00850.32959,W") for s in range(5)])),
        ("FAIL position-impossible: Girona 500's receiver claims a fix at nowhere, which is no position",),
    ),
    # Sick, in dimensions, time or quality.
    Case(
        "gpsd, two dimensions are too few in the air",
        GPSD,
        heard(gpsd(*fixes(5, mode=2))),
        ("FAIL fix-2d: Sparus has a 2D fix and flies: its height is not measured",),
        {"three": True},
    ),
    Case(
        "NMEA, RMC only, in the air",
        TCP,
        heard(nmea(*[rmc(second) for second in range(5)])),
        ("FAIL fix-2d: Girona 500 has a 2D fix and flies: its height is not measured",),
        {"three": True},
    ),
    Case(
        "gpsd, GGA only: no time",
        GPSD,
        heard(gpsd(*fixes(5, time=None))),
        ("INCONCLUSIVE no-time: Sparus's positions have no time: nobody can tell whether they are of now",),
    ),
    Case(
        "gpsd, time is nonsense",
        GPSD,
        heard(gpsd(*fixes(5, time="2026-13-45T99:00:00Z"))),
        ("INCONCLUSIVE no-time: Sparus's positions have no time: nobody can tell whether they are of now",),
    ),
    Case(
        "NMEA, GGA only: no date",
        TCP,
        heard(nmea(*[gga(s) for s in range(5)])),
        ("WARN no-date: Girona 500's positions have a time and no date: GGA and GLL have none",),
    ),
    Case(
        "NMEA, GGA and ZDA",
        TCP,
        heard(nmea(*[say.framed(f"GPZDA,{say.clock(s)}.00,20,11,2026,00,00") + gga(s) for s in range(5)])),
        (
            (
                "PASS fix: Girona 500 has a 3D fix of 9 satellites at 41.68642, -8.83883, 3 m "
                "from the middle of the geofence"
            ),
        ),
    ),
    Case(
        "gpsd, clock behind",
        GPSD,
        heard(gpsd(*[tpv(second - 40) for second in range(5)])),
        ("FAIL clock-differs: Sparus's receiver is 40.2 s behind the clock of coastal-gateway",),
    ),
    Case(
        "gpsd, clock ahead by a time zone",
        GPSD,
        heard(gpsd(*[tpv(second + 3600) for second in range(5)])),
        ("INCONCLUSIVE clock-differs: Sparus's receiver is 60 min ahead of the clock of coastal-gateway",),
    ),
    Case(
        "gpsd, week rolled over",
        GPSD,
        heard(gpsd(*[tpv(second - 1024 * 7 * 86400) for second in range(5)])),
        ("INCONCLUSIVE clock-differs: Sparus's receiver is 7168 days behind the clock of coastal-gateway",),
    ),
    Case(
        "gpsd, a replayed log",
        GPSD,
        heard(gpsd(*[tpv(second - 30 * 86400) for second in range(5)])),
        ("FAIL clock-differs: Sparus's receiver is 30 days behind the clock of coastal-gateway",),
    ),
    Case(
        "NMEA, GGA only, clock behind",
        TCP,
        heard(nmea(*[gga(second - 40) for second in range(5)])),
        (
            "WARN no-date: Girona 500's positions have a time and no date: GGA and GLL have none",
            "FAIL clock-differs: Girona 500's receiver is 40.2 s behind the clock of coastal-gateway",
        ),
    ),
    Case(
        "gpsd, dead reckoning",
        GPSD,
        heard(gpsd(*fixes(5, status=5))),
        ("WARN position-dead-reckoning: Sparus's position is dead reckoning, not measured",),
    ),
    Case(
        "gpsd, set by hand",
        GPSD,
        heard(gpsd(*fixes(5, status=7))),
        ("INCONCLUSIVE position-manual: Sparus's position is set by hand, not measured",),
    ),
    Case(
        "gpsd, simulated",
        GPSD,
        heard(gpsd(*fixes(5, status=8))),
        ("FAIL position-simulated: Sparus's position is simulated, not measured",),
    ),
    Case(
        "gpsd, uncertain",
        GPSD,
        heard(gpsd(*fixes(5, eph=88.0))),
        ("WARN position-uncertain: Sparus's position is uncertain: the receiver's estimate is 88 m",),
    ),
    Case(
        "gpsd, satellites stand badly",
        GPSD,
        heard(gpsd(*fixes(5, eph=None), sky={**SKY, "hdop": 7.25})),
        ("WARN position-uncertain: Sparus's satellites stand badly: HDOP 7.2",),
    ),
    Case(
        "NMEA, dead reckoning",
        TCP,
        heard(nmea(*[epoch(s, quality=6, mode="E") for s in range(5)])),
        ("WARN position-dead-reckoning: Girona 500's position is dead reckoning, not measured",),
    ),
    Case(
        "NMEA, set by hand",
        TCP,
        heard(nmea(*[epoch(s, quality=7, mode="M") for s in range(5)])),
        ("INCONCLUSIVE position-manual: Girona 500's position is set by hand, not measured",),
    ),
    Case(
        "NMEA, simulated",
        TCP,
        heard(nmea(*[epoch(s, quality=8, mode="S") for s in range(5)])),
        ("FAIL position-simulated: Girona 500's position is simulated, not measured",),
    ),
    Case(
        "NMEA, satellites stand badly",
        TCP,
        heard(nmea(*[gga(s, hdop=7.2) + rmc(s) for s in range(5)])),
        ("WARN position-uncertain: Girona 500's satellites stand badly: HDOP 7.2",),
    ),
    Case(
        "NMEA, RTK fixed",
        TCP,
        heard(nmea(*[epoch(s, quality=4, mode="R") for s in range(5)])),
        (
            (
                "PASS fix: Girona 500 has a 3D fix of 9 satellites at 41.68642, -8.83883, 3 m "
                "from the middle of the geofence"
            ),
        ),
    ),
    # Absent.
    Case(
        "gpsd, not started",
        GPSD,
        troubled(Trouble.REFUSED, "10.64.1.22 port 2947: Connection refused"),
        ("FAIL driver-not-started: Sparus is there, but no gpsd listens at 10.64.1.22:2947",),
    ),
    Case(
        "gpsd, no receiver",
        GPSD,
        heard([(0.05, say.greeting())], 15.0),
        ("FAIL device-missing: gpsd at 10.64.1.22:2947 runs, but has no receiver open",),
    ),
    Case(
        "gpsd, receiver pulled out",
        GPSD,
        heard([*gpsd()[:1], (3.0, say.said({"class": "DEVICE", "path": say.PATH, "activated": 0}))], 15.0),
        ("FAIL device-missing: gpsd at 10.64.1.22:2947 runs, but has no receiver open",),
    ),
    Case(
        "gpsd, receiver says nothing",
        GPSD,
        heard(gpsd(), 15.0),
        ("FAIL no-data: gpsd at 10.64.1.22:2947 has opened /dev/ttyACM0, which says nothing in 15 s",),
    ),
    Case(
        "gpsd, vehicle off",
        GPSD,
        troubled(Trouble.SILENT, "10.64.1.22 port 2947: no answer within 10 s"),
        ("INCONCLUSIVE no-answer: nobody answers at 10.64.1.22:2947: Sparus is off, or not in the network",),
    ),
    Case(
        "gpsd, no way",
        GPSD,
        troubled(Trouble.UNREACHABLE, "10.64.1.22 port 2947: Network is unreachable"),
        ("INCONCLUSIVE no-route: coastal-gateway has no way to 10.64.1.22:2947",),
    ),
    Case(
        "gpsd, gateway not reached",
        GPSD,
        troubled(Trouble.NO_PLACE, "Connection timed out"),
        (
            (
                "INCONCLUSIVE place-not-reached: nobody has listened to gpsd at "
                "10.64.1.22:2947: coastal-gateway was not reached: Connection timed out"
            ),
        ),
    ),
    Case(
        "NMEA, not started or in use",
        TCP,
        troubled(Trouble.REFUSED, "10.64.1.21 port 10110: Connection refused"),
        (
            (
                "INCONCLUSIVE refused: 10.64.1.21:10110 turns us away: its program is not "
                "started, or serves one client and has it"
            ),
        ),
    ),
    Case(
        "NMEA, takes the connection and is silent",
        TCP,
        heard((), 15.0),
        ("INCONCLUSIVE no-data: 10.64.1.21:10110 takes the connection and says nothing in 15 s",),
    ),
    Case(
        "NMEA, other sentences only",
        TCP,
        heard([(0.1, b"x\r\n" + say.framed("HEHDT,231.2,T") * 9)], 15.0),
        ("FAIL no-data: 9 NMEA sentences came from 10.64.1.21:10110 in 15 s, no position among them (GGA, RMC, GLL)",),
    ),
    Case(
        "serial, not plugged in",
        SERIAL,
        troubled(Trouble.MISSING, "/dev/ttyUSB0: No such file or directory"),
        ("FAIL device-missing: there is no /dev/ttyUSB0 of gw: the receiver is not plugged in, or has another name",),
    ),
    Case(
        "serial, silent",
        SERIAL,
        heard((), 15.0),
        ("FAIL no-data: /dev/ttyUSB0 of gw is there and says nothing in 15 s",),
    ),
    Case(
        "serial, not allowed",
        SERIAL,
        troubled(Trouble.DENIED, "/dev/ttyUSB0: Permission denied"),
        ("INCONCLUSIVE not-allowed: /dev/ttyUSB0 of gw may not be read: /dev/ttyUSB0: Permission denied",),
    ),
    # Garbage.
    Case(
        "gpsd, another service",
        GPSD,
        heard([(0.1, b"SSH-2.0-OpenSSH_9.2p1\r\n")], 15.0),
        ("FAIL not-gpsd: what answers at 10.64.1.22:2947 is not gpsd: 23 bytes, no line of its JSON among them",),
    ),
    Case(
        "gpsd, objects of another program",
        GPSD,
        heard([(0.1, b'{"class":"HELLO"}\n[1,2]\n"TPV"\n{"class":5}\n')], 15.0),
        ("FAIL not-gpsd: what answers at 10.64.1.22:2947 is not gpsd: 42 bytes, no line of its JSON among them",),
    ),
    Case(
        "gpsd, damaged lines among good ones",
        GPSD,
        heard([*gpsd(*fixes(5)), (4.25, b'{"class":"TPV","mode":\n{{{{\n\xff\xfe\n')]),
        ("WARN damaged: 3 of 16 lines from 10.64.1.22:2947 are damaged",),
    ),
    Case(
        "gpsd, nested for ever",
        GPSD,
        heard([(0.05, say.greeting(say.DEVICE)), (0.1, b"[" * 20_000 + b"\n")], 15.0),
        ("FAIL no-data: gpsd at 10.64.1.22:2947 has opened /dev/ttyACM0, which says nothing in 15 s",),
    ),
    Case(
        "gpsd, numbers too large",
        GPSD,
        heard(gpsd(*fixes(5, lat=10**400, eph=10**400))),
        ("FAIL position-impossible: Sparus's receiver claims a fix at nowhere, which is no position",),
    ),
    Case(
        "NMEA, wrong baud rate",
        SERIAL,
        heard([(0.1, bytes(range(128, 256)) * 4 + b"\n")], 15.0),
        ("FAIL not-nmea: 513 bytes came from /dev/ttyUSB0 of gw, no whole NMEA sentence among them",),
    ),
    Case(
        "NMEA, another service",
        TCP,
        heard([(0.1, b"HTTP/1.0 400 Bad Request\r\n\r\n")], 15.0),
        ("FAIL not-nmea: 28 bytes came from 10.64.1.21:10110, no whole NMEA sentence among them",),
    ),
    Case(
        "NMEA, checksums wrong among good ones",
        TCP,
        heard([*nmea(*EPOCHS), (4.25, b"$GPGGA,1*00\r\n$GPRMC,2*00\r\nGPGSA\r\n")]),
        ("WARN damaged: 3 of 18 lines from 10.64.1.21:10110 are damaged",),
    ),
    Case(
        "NMEA, fields missing",
        TCP,
        heard(nmea(*[say.framed("GPRMC,A"), say.framed("GPGGA"), say.framed("GP"), say.framed(",")] * 5)),
        ("FAIL no-fix: Girona 500's receiver works and has no fix",),
    ),
    # Slow.
    Case(
        "gpsd, a report every four seconds",
        GPSD,
        heard(gpsd(*[tpv(4 * second) for second in range(4)], every_s=4.0), 15.0),
        ("WARN few-reports: 4 of 5 positions came in 15 s",),
    ),
    Case(
        "gpsd, one report only, at the end",
        GPSD,
        heard([*gpsd()[:1], (14.0, say.said(tpv(13.8)))], 15.0),
        ("INCONCLUSIVE few-reports: 1 of 5 positions came in 15 s",),
    ),
    Case(
        "gpsd, it hung up in between",
        GPSD,
        heard(gpsd(*fixes(2)), words="the other end hung up after 1.3 s"),
        ("INCONCLUSIVE few-reports: 2 of 5 positions came in 1 s",),
    ),
    Case(
        "NMEA, a report every four seconds",
        TCP,
        heard(nmea(*[epoch(4 * second) for second in range(4)], every_s=4.0), 15.0),
        ("WARN few-reports: 4 of 5 positions came in 15 s",),
    ),
    # In use.
    Case(
        "NMEA, serves one client and has it",
        TCP,
        troubled(Trouble.CLOSED, "the other end hung up after 0.0 s"),
        ("INCONCLUSIVE in-use: 10.64.1.21:10110 hung up at once, as a server does that serves one client and has it",),
    ),
    Case(
        "serial, in use",
        SERIAL,
        troubled(Trouble.BUSY, "/dev/ttyUSB0 is held by gpsd (pid 412)"),
        (
            (
                "INCONCLUSIVE in-use: /dev/ttyUSB0 of gw is in use by another program, and was "
                "left alone: /dev/ttyUSB0 is held by gpsd (pid 412)"
            ),
        ),
    ),
    *LIES,
)
