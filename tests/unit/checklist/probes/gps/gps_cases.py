"""What sources say; what a technician is told of it stands in `gps_cases.yml`."""

from dataclasses import dataclass, field, replace
from typing import Any

import gps_said as say
from gps_said import NO_FIX, SKY, epoch, fixes, gga, gll, gns, gpsd, gsa, heard, nmea, no_fix, rmc, tagged, tpv

from atlantis_netcfg.checklist.probes import Transcript, Trouble
from atlantis_netcfg.inventory.model import GpsDriver

GPSD, TCP, SERIAL = GpsDriver.GPSD, GpsDriver.NMEA_TCP, GpsDriver.NMEA_SERIAL


@dataclass(frozen=True)
class Case:
    driver: GpsDriver
    transcript: Transcript
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


def both(*pairs: tuple[dict[str, Any], dict[str, Any]]) -> Transcript:
    """Two receivers behind one gpsd."""
    return heard(gpsd(*[one for pair in pairs for one in pair], every_s=0.5))


LIES = {
    # Each lie beside a neighbour that is true.
    "NMEA, a fix of no satellites": Case(TCP, heard(nmea(*[gga(s, used="00") + rmc(s) + gsa() for s in range(5)]))),
    "NMEA, a fix of three satellites": Case(TCP, heard(nmea(*[gga(s, used="03") + rmc(s) + gsa(2) for s in range(5)]))),
    "gpsd, satellites in view and none used": Case(GPSD, heard(gpsd(*fixes(5), sky={**SKY, "uSat": 0}))),
    "gpsd, a receiver that tells no satellites": Case(GPSD, heard(gpsd(*fixes(5), sky={**SKY, "uSat": 0, "nSat": 0}))),
    "gpsd, the satellites of another receiver": Case(
        GPSD, heard([*gpsd(*fixes(5)), (4.25, say.said({**SKY, "device": OTHER, "uSat": 0}))])
    ),
    "NMEA, one system of several has a fix": Case(
        TCP, heard(nmea(*[gga(s) + rmc(s) + gsa(3) + gsa(1, talker="GL") for s in range(5)]))
    ),
    "NMEA, no system of several has a fix": Case(
        TCP, heard(nmea(*[gga(s) + rmc(s) + gsa(1) + gsa(1, talker="GL") for s in range(10)]))
    ),
    "NMEA, TAG blocks": Case(TCP, heard(nmea(*[tagged(one) for one in EPOCHS]))),
    "NMEA, a TAG block for the first of a group": Case(
        TCP, heard(nmea(*[tagged(gga(s), "g:1-2-7,s:A") + tagged(rmc(s), "g:2-2-7") for s in range(5)]))
    ),
    "NMEA, TAG blocks with a wrong checksum": Case(
        TCP, heard(nmea(*[tagged(one).replace(b"s:GP0001", b"s:GP0002") for one in EPOCHS]), 15.0)
    ),
    "NMEA, two receivers of a multiplexer agree": Case(
        TCP, heard(nmea(*[tagged(epoch(s), "s:A") + tagged(epoch(s, NEAR), "s:B") for s in range(5)]))
    ),
    "NMEA, two receivers of a multiplexer are in two places": Case(
        TCP, heard(nmea(*[tagged(epoch(s), "s:A") + tagged(epoch(s, FAR), "s:B") for s in range(5)]))
    ),
    "gpsd, two receivers agree": Case(
        GPSD, both(*[(tpv(s), tpv(s, device=OTHER, lat=say.LATITUDE + 0.0004)) for s in range(5)])
    ),
    "gpsd, two receivers are in two places": Case(
        GPSD, both(*[(tpv(s), tpv(s, device=OTHER, lat=41.7)) for s in range(5)])
    ),
    "NMEA, GGA and RMC are in two places": Case(TCP, heard(nmea(*[rmc(s, SWAPPED) + gga(s) for s in range(5)]))),
    "NMEA, GLL only": Case(TCP, heard(nmea(*[gll(s) for s in range(5)]))),
    "NMEA, GLL and ZDA": Case(
        TCP, heard(nmea(*[say.framed(f"GPZDA,{say.clock(s)}.00,20,11,2026,00,00") + gll(s) for s in range(5)]))
    ),
    "NMEA, GLL is void": Case(TCP, heard(nmea(*[gga(s) + gll(s, status="V", mode="N") for s in range(10)]))),
    "NMEA, RMC is active and its mode is not": Case(TCP, heard(nmea(*[rmc(s, mode="N") for s in range(10)]))),
    "NMEA, GNS in place of GGA": Case(TCP, heard(nmea(*[gns(s) + rmc(s) for s in range(5)]))),
    "NMEA, GNS of systems that are not used": Case(TCP, heard(nmea(*[gns(s, "NN", "00") + rmc(s) for s in range(10)]))),
    "NMEA, GNS is simulated": Case(TCP, heard(nmea(*[gns(s, "SN") + rmc(s) for s in range(5)]))),
    "gpsd, one report among measured ones is simulated": Case(
        GPSD, heard(gpsd(*fixes(2), tpv(2, status=8), tpv(3), tpv(4)))
    ),
    "NMEA, a log of an hour ago": Case(TCP, heard(nmea(*[epoch(s - 3700) for s in range(5)]))),
    "NMEA, a log of two days ago at this time of day": Case(
        TCP, heard(nmea(*[epoch(s - 2 * 86400) for s in range(5)]))
    ),
    "NMEA, two seconds late": Case(TCP, heard(nmea(*[epoch(s - 2) for s in range(5)]))),
    "gpsd, a log ten times as fast": Case(GPSD, heard(gpsd(*[tpv(10 * (s - 2)) for s in range(5)]))),
    "gpsd, a log of three seconds in a loop": Case(GPSD, heard(gpsd(*[tpv(s % 3) for s in range(9)]))),
    "gpsd, ten reports a second": Case(GPSD, heard(gpsd(*[tpv(s / 10) for s in range(10)], every_s=0.1))),
    "NMEA, moving while the position stands still": Case(
        TCP, heard(nmea(*[gga(s) + rmc(s, knots=6.0) for s in range(5)]))
    ),
    "NMEA, moving": Case(
        TCP, heard(nmea(*[rmc(s, f"4141.{18520 + 170 * s},N,00850.32959,W", knots=6.0) for s in range(5)]))
    ),
    "gpsd, an error wider than the site": Case(GPSD, heard(gpsd(*fixes(5, eph=4200.0)))),
    "NMEA, the HDOP of no fix": Case(TCP, heard(nmea(*[gga(s, hdop=99.99) + rmc(s) for s in range(5)]))),
    "NMEA, most lines are damaged": Case(TCP, heard([*nmea(*EPOCHS), (4.25, b"$GPGGA,1*00\r\n" * 20)])),
    "gpsd, nobody knows when it was heard": Case(GPSD, replace(heard(gpsd(*fixes(5))), began=0.0)),
}

CASES = {
    # Healthy.
    "gpsd, healthy": Case(GPSD, heard(gpsd(*fixes(5)))),
    "gpsd, healthy, without a sky": Case(GPSD, heard(gpsd(*fixes(5), sky=None))),
    "gpsd, RTK fixed": Case(GPSD, heard(gpsd(*fixes(5, status=3, eph=0.02)))),
    "gpsd, two dimensions are enough on water": Case(GPSD, heard(gpsd(*fixes(5, mode=2)))),
    "gpsd, found its fix while we listened": Case(
        GPSD, heard(gpsd(NO_FIX, NO_FIX, *[tpv(second + 2) for second in range(5)]))
    ),
    "gpsd, two receivers, the other one without a fix": Case(
        GPSD,
        heard(
            gpsd(
                *[one for second in range(5) for one in (tpv(second), {**NO_FIX, "device": "/dev/ttyS9"})], every_s=0.5
            )
        ),
    ),
    "gpsd, listened to from the middle of an epoch on": Case(
        GPSD, heard(gpsd({"class": "TPV", "device": say.PATH, "mode": 3, "eph": 17.1}, *fixes(5)))
    ),
    "gpsd, one epoch told three times": Case(
        GPSD, heard(gpsd(tpv(0, time=None), tpv(0), tpv(0), tpv(1), tpv(2), every_s=0.5))
    ),
    "NMEA, healthy": Case(TCP, heard(nmea(*EPOCHS))),
    "NMEA, healthy, GNSS of several systems": Case(
        TCP,
        heard(
            nmea(*[gga(s, talker="GN") + gsa(talker="GN") + gsa(talker="GN") + rmc(s, talker="GN") for s in range(5)])
        ),
    ),
    "NMEA, healthy, RMC only": Case(TCP, heard(nmea(*[rmc(second) for second in range(5)]))),
    "serial, healthy": Case(SERIAL, heard(nmea(*EPOCHS))),
    # Sick, without a fix.
    "gpsd, no fix": Case(GPSD, heard(gpsd(*[NO_FIX] * 10))),
    "gpsd, no fix under a roof": Case(GPSD, heard(gpsd(*[NO_FIX] * 10)), ROOF),
    "gpsd, mode is no number": Case(GPSD, heard(gpsd(*fixes(5, mode="3")))),
    "NMEA, no fix": Case(TCP, heard(nmea(*[no_fix(second) for second in range(10)]))),
    "NMEA, no fix under a roof": Case(TCP, heard(nmea(*[no_fix(second) for second in range(10)])), ROOF),
    "NMEA, GGA has a fix and RMC is void": Case(
        TCP, heard(nmea(*[gga(s) + rmc(s, status="V", mode="N") for s in range(10)]))
    ),
    # Sick, and not sustained.
    "gpsd, fix lost": Case(GPSD, heard(gpsd(*fixes(3), NO_FIX, NO_FIX))),
    "gpsd, fix lost and hardly back": Case(GPSD, heard(gpsd(*fixes(3), NO_FIX, tpv(4), tpv(5)))),
    "gpsd, fix lost under a roof": Case(GPSD, heard(gpsd(*fixes(3), NO_FIX, NO_FIX)), ROOF),
    "gpsd, fix lost and back": Case(GPSD, heard(gpsd(*fixes(2), NO_FIX, *[tpv(second + 3) for second in range(5)]))),
    "NMEA, fix lost": Case(TCP, heard(nmea(*EPOCHS[:3], no_fix(3), no_fix(4)))),
    # Sick, with old positions.
    "gpsd, time stands still": Case(GPSD, heard(gpsd(*[tpv(0)] * 10))),
    "gpsd, time stands still after a while": Case(GPSD, heard(gpsd(*fixes(3), tpv(2), tpv(2), tpv(2)))),
    "gpsd, no more came": Case(GPSD, heard(gpsd(*fixes(4)), 15.0)),
    "NMEA, time stands still": Case(TCP, heard(nmea(*[epoch(0)] * 10))),
    "NMEA, no more came": Case(TCP, heard(nmea(*EPOCHS), 15.0)),
    # Sick, in the wrong place.
    "gpsd, swapped": Case(GPSD, heard(gpsd(*fixes(5, lat=say.LONGITUDE, lon=say.LATITUDE)))),
    "gpsd, somewhere else": Case(GPSD, heard(gpsd(*fixes(5, lat=38.7, lon=-9.15)))),
    "gpsd, sign of the longitude lost": Case(GPSD, heard(gpsd(*fixes(5, lon=-say.LONGITUDE)))),
    "gpsd, sign of the latitude lost": Case(GPSD, heard(gpsd(*fixes(5, lat=-say.LATITUDE)))),
    "gpsd, zeros": Case(GPSD, heard(gpsd(*fixes(5, lat=0.0, lon=0.0)))),
    "gpsd, no number": Case(GPSD, heard(gpsd(*fixes(5, lat=float("nan"))))),
    "gpsd, off the planet": Case(GPSD, heard(gpsd(*fixes(5, lat=141.0)))),
    "gpsd, a fix without a position": Case(GPSD, heard(gpsd(*fixes(5, lat=None, lon=None)))),
    "gpsd, jumping": Case(GPSD, heard(gpsd(*[tpv(s, lat=say.LATITUDE + 0.001 * (s % 2)) for s in range(5)]))),
    "gpsd, in tow, a report every two seconds": Case(
        GPSD, heard(gpsd(*[tpv(2 * s, lat=say.LATITUDE + 0.00045 * (s % 2)) for s in range(6)], every_s=2.0))
    ),
    "gpsd, slowly moving while the position stands still": Case(GPSD, heard(gpsd(*fixes(5, speed=1.5)))),
    "gpsd, a report every five seconds": Case(GPSD, heard(gpsd(*[tpv(5 * s) for s in range(3)], every_s=5.0), 12.0)),
    "gpsd, no geofence": Case(GPSD, heard(gpsd(*fixes(5))), {"fence": None}),
    "NMEA, swapped": Case(TCP, heard(nmea(*[epoch(s, SWAPPED) for s in range(5)]))),
    "NMEA, somewhere else": Case(TCP, heard(nmea(*[epoch(s, FAR) for s in range(5)]))),
    "NMEA, impossible degrees": Case(TCP, heard(nmea(*[epoch(s, "9941.18520,N,00850.32959,W") for s in range(5)]))),
    "NMEA, a fix without a hemisphere": Case(
        TCP, heard(nmea(*[epoch(s, "4141.18520,,00850.32959,W") for s in range(5)]))
    ),
    # Sick, in dimensions, time or quality.
    "gpsd, two dimensions are too few in the air": Case(GPSD, heard(gpsd(*fixes(5, mode=2))), {"three": True}),
    "NMEA, RMC only, in the air": Case(TCP, heard(nmea(*[rmc(second) for second in range(5)])), {"three": True}),
    "gpsd, GGA only: no time": Case(GPSD, heard(gpsd(*fixes(5, time=None)))),
    "gpsd, time is nonsense": Case(GPSD, heard(gpsd(*fixes(5, time="2026-13-45T99:00:00Z")))),
    "NMEA, GGA only: no date": Case(TCP, heard(nmea(*[gga(s) for s in range(5)]))),
    "NMEA, GGA and ZDA": Case(
        TCP, heard(nmea(*[say.framed(f"GPZDA,{say.clock(s)}.00,20,11,2026,00,00") + gga(s) for s in range(5)]))
    ),
    "gpsd, clock behind": Case(GPSD, heard(gpsd(*[tpv(second - 40) for second in range(5)]))),
    "gpsd, clock ahead by a time zone": Case(GPSD, heard(gpsd(*[tpv(second + 3600) for second in range(5)]))),
    "gpsd, week rolled over": Case(GPSD, heard(gpsd(*[tpv(second - 1024 * 7 * 86400) for second in range(5)]))),
    "gpsd, a replayed log": Case(GPSD, heard(gpsd(*[tpv(second - 30 * 86400) for second in range(5)]))),
    "NMEA, GGA only, clock behind": Case(TCP, heard(nmea(*[gga(second - 40) for second in range(5)]))),
    "gpsd, dead reckoning": Case(GPSD, heard(gpsd(*fixes(5, status=5)))),
    "gpsd, set by hand": Case(GPSD, heard(gpsd(*fixes(5, status=7)))),
    "gpsd, simulated": Case(GPSD, heard(gpsd(*fixes(5, status=8)))),
    "gpsd, uncertain": Case(GPSD, heard(gpsd(*fixes(5, eph=88.0)))),
    "gpsd, satellites stand badly": Case(GPSD, heard(gpsd(*fixes(5, eph=None), sky={**SKY, "hdop": 7.25}))),
    "NMEA, dead reckoning": Case(TCP, heard(nmea(*[epoch(s, quality=6, mode="E") for s in range(5)]))),
    "NMEA, set by hand": Case(TCP, heard(nmea(*[epoch(s, quality=7, mode="M") for s in range(5)]))),
    "NMEA, simulated": Case(TCP, heard(nmea(*[epoch(s, quality=8, mode="S") for s in range(5)]))),
    "NMEA, satellites stand badly": Case(TCP, heard(nmea(*[gga(s, hdop=7.2) + rmc(s) for s in range(5)]))),
    "NMEA, RTK fixed": Case(TCP, heard(nmea(*[epoch(s, quality=4, mode="R") for s in range(5)]))),
    # Absent.
    "gpsd, not started": Case(GPSD, troubled(Trouble.REFUSED, "10.64.1.22 port 2947: Connection refused")),
    "gpsd, no receiver": Case(GPSD, heard([(0.05, say.greeting())], 15.0)),
    "gpsd, receiver pulled out": Case(
        GPSD, heard([*gpsd()[:1], (3.0, say.said({"class": "DEVICE", "path": say.PATH, "activated": 0}))], 15.0)
    ),
    "gpsd, receiver says nothing": Case(GPSD, heard(gpsd(), 15.0)),
    "gpsd, vehicle off": Case(GPSD, troubled(Trouble.SILENT, "10.64.1.22 port 2947: no response within 10 s")),
    "gpsd, no way": Case(GPSD, troubled(Trouble.UNREACHABLE, "10.64.1.22 port 2947: Network is unreachable")),
    "gpsd, gateway not reached": Case(GPSD, troubled(Trouble.NO_PLACE, "Connection timed out")),
    "NMEA, not started or in use": Case(TCP, troubled(Trouble.REFUSED, "10.64.1.21 port 10110: Connection refused")),
    "NMEA, takes the connection and is silent": Case(TCP, heard((), 15.0)),
    "NMEA, other sentences only": Case(TCP, heard([(0.1, b"x\r\n" + say.framed("HEHDT,231.2,T") * 9)], 15.0)),
    "serial, not plugged in": Case(SERIAL, troubled(Trouble.MISSING, "/dev/ttyUSB0: No such file or directory")),
    "serial, silent": Case(SERIAL, heard((), 15.0)),
    "serial, not allowed": Case(SERIAL, troubled(Trouble.DENIED, "/dev/ttyUSB0: Permission denied")),
    # Garbage.
    "gpsd, another service": Case(GPSD, heard([(0.1, b"SSH-2.0-OpenSSH_9.2p1\r\n")], 15.0)),
    "gpsd, objects of another program": Case(
        GPSD, heard([(0.1, b'{"class":"HELLO"}\n[1,2]\n"TPV"\n{"class":5}\n')], 15.0)
    ),
    "gpsd, damaged lines among good ones": Case(
        GPSD, heard([*gpsd(*fixes(5)), (4.25, b'{"class":"TPV","mode":\n{{{{\n\xff\xfe\n')])
    ),
    "gpsd, nested for ever": Case(GPSD, heard([(0.05, say.greeting(say.DEVICE)), (0.1, b"[" * 20_000 + b"\n")], 15.0)),
    "gpsd, numbers too large": Case(GPSD, heard(gpsd(*fixes(5, lat=10**400, eph=10**400)))),
    "NMEA, wrong baud rate": Case(SERIAL, heard([(0.1, bytes(range(128, 256)) * 4 + b"\n")], 15.0)),
    "NMEA, another service": Case(TCP, heard([(0.1, b"HTTP/1.0 400 Bad Request\r\n\r\n")], 15.0)),
    "NMEA, checksums wrong among good ones": Case(
        TCP, heard([*nmea(*EPOCHS), (4.25, b"$GPGGA,1*00\r\n$GPRMC,2*00\r\nGPGSA\r\n")])
    ),
    "NMEA, fields missing": Case(
        TCP, heard(nmea(*[say.framed("GPRMC,A"), say.framed("GPGGA"), say.framed("GP"), say.framed(",")] * 5))
    ),
    # Slow.
    "gpsd, a report every four seconds": Case(
        GPSD, heard(gpsd(*[tpv(4 * second) for second in range(4)], every_s=4.0), 15.0)
    ),
    "gpsd, one report only, at the end": Case(GPSD, heard([*gpsd()[:1], (14.0, say.said(tpv(13.8)))], 15.0)),
    "gpsd, it hung up in between": Case(GPSD, heard(gpsd(*fixes(2)), words="the other end hung up after 1.3 s")),
    "NMEA, a report every four seconds": Case(
        TCP, heard(nmea(*[epoch(4 * second) for second in range(4)], every_s=4.0), 15.0)
    ),
    # In use.
    "NMEA, serves one client and has it": Case(TCP, troubled(Trouble.CLOSED, "the other end hung up after 0.0 s")),
    "serial, in use": Case(SERIAL, troubled(Trouble.BUSY, "/dev/ttyUSB0 is held by gpsd (pid 412)")),
    **LIES,
}
