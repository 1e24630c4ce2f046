"""Words for a source that tells nothing: missing, not started, in use, or not reached are four different things."""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.bearers import Finding
from atlantis_netcfg.checklist.probes.results import Trouble
from atlantis_netcfg.core.verdicts import Verdict
from atlantis_netcfg.declaration.model import GpsDriver

if TYPE_CHECKING:
    from atlantis_netcfg.checklist.probes.gps.record import Reception, Wanted

__all__ = ["speechless", "troubled"]

_INCONCLUSIVE, _FAIL = Verdict.INCONCLUSIVE, Verdict.FAIL
_STREAM = "read what the program that has it passes on: declare `driver: gpsd` or `nmea_tcp`"


def troubled(trouble: Trouble, words: str, expected: Wanted) -> Finding:
    """Say why nothing could be heard."""
    text = f": {words}" if words else ""
    return {
        Trouble.NO_PLACE: lambda: Finding(
            _INCONCLUSIVE,
            "place-not-reached",
            f"nobody has listened to {expected.source}: {expected.place} was not reached{text}",
            f"bring {expected.place} back first, then repeat this item",
        ),
        Trouble.SILENT: lambda: Finding(
            _INCONCLUSIVE,
            "no-answer",
            f"nobody answers at {expected.end}: {expected.name} is off, or not in the network",
            f"switch {expected.name} on and look at its Wi-Fi or cable first",
        ),
        Trouble.UNREACHABLE: lambda: Finding(
            _INCONCLUSIVE,
            "no-route",
            f"{expected.place} has no way to {expected.end}",
            f"connect {expected.place} with the network of {expected.name} first",
        ),
        Trouble.REFUSED: lambda: _refused(expected),
        Trouble.BUSY: lambda: Finding(
            _INCONCLUSIVE,
            "in-use",
            f"{expected.end} is in use by another program, and was left alone{text}",
            _STREAM,
        ),
        Trouble.CLOSED: lambda: Finding(
            _INCONCLUSIVE,
            "in-use",
            f"{expected.end} hung up at once, as a server does that serves one client and has it",
            "repeat this item while the vehicle's own software is stopped, or " + _STREAM,
        ),
        Trouble.MISSING: lambda: Finding(
            _FAIL,
            "device-missing",
            f"there is no {expected.end}: the receiver is not plugged in, or has another name",
            "plug the receiver in, and compare `device:` with /dev/serial/by-id",
        ),
        Trouble.DENIED: lambda: Finding(
            _INCONCLUSIVE,
            "not-allowed",
            f"{expected.end} may not be read{text}",
            "put the account that listens into the group of the port: dialout",
        ),
    }[trouble]()


def _refused(expected: Wanted) -> Finding:
    if expected.driver is GpsDriver.GPSD:
        return Finding(
            _FAIL,
            "driver-not-started",
            f"{expected.name} is there, but no gpsd listens at {expected.end}",
            f"start gpsd on {expected.name}, with its option -G: without it gpsd serves its own computer only",
        )
    return Finding(
        _INCONCLUSIVE,
        "refused",
        f"{expected.end} turns us away: its program is not started, or serves one client and has it",
        f"look on {expected.name} whether the program that passes NMEA on runs, and who is connected to it",
    )


def speechless(reception: Reception, expected: Wanted) -> Finding | None:
    """Say what is wrong with a source that is there and tells no position at all; None: it tells."""
    if reception.reports:
        return None
    if not reception.understood and reception.heard_bytes:
        return _foreign(reception, expected)
    if reception.devices is not None and not reception.devices:
        return Finding(
            _FAIL,
            "device-missing",
            f"{expected.source} runs, but has no receiver open",
            "plug the receiver in; DEVICES of /etc/default/gpsd names its port, and gpsd's log says why it fails",
        )
    return _no_data(reception, expected)


def _foreign(reception: Reception, expected: Wanted) -> Finding:
    if expected.driver is GpsDriver.GPSD:
        return Finding(
            _FAIL,
            "not-gpsd",
            f"what answers at {expected.end} is not gpsd: {reception.heard_bytes} bytes,"
            " no line of its JSON among them",
            "compare `port:` with the port on which gpsd listens (2947 unless its option -S says otherwise)",
        )
    hint = "compare `port:` with the port of the NMEA stream"
    if expected.driver is GpsDriver.NMEA_SERIAL:
        hint = "compare `baud:` with the receiver's rate: 4800, 9600, 38400 and 115200 are usual"
    message = f"{reception.heard_bytes} bytes came from {expected.end}, no whole NMEA sentence among them"
    return Finding(_FAIL, "not-nmea", message, hint)


def _no_data(reception: Reception, expected: Wanted) -> Finding:
    after = f"in {reception.ended_s:.0f} s"
    if expected.driver is GpsDriver.GPSD:
        devices = ", ".join(reception.devices or ()) or "its receiver"
        message = f"{expected.source} has opened {devices}, which says nothing {after}"
        return Finding(
            _FAIL, "no-data", message, "look at the receiver's power and wires; gpsd tries the baud rates itself"
        )
    if expected.driver is GpsDriver.ROUTEROS:
        hint = "compare `port` of `/system gps` with the port of the receiver"
        return Finding(_FAIL, "no-data", f"{expected.source} tells nothing of its receiver", hint)
    if reception.understood:
        message = (
            f"{reception.good} NMEA sentences came from {expected.end} {after}, no position among them (GGA, RMC, GLL)"
        )
        return Finding(_FAIL, "no-data", message, "let the receiver send GGA, RMC and GSA")
    if expected.driver is GpsDriver.NMEA_SERIAL:
        message = f"{expected.end} is there and says nothing {after}"
        return Finding(_FAIL, "no-data", message, "look at the receiver's power and wires")
    # A server for one client may as well let the second one wait.
    message = f"{expected.end} takes the connection and says nothing {after}"
    hint = f"look on {expected.name} whether the receiver is on, and whether its program serves one client and has it"
    return Finding(_INCONCLUSIVE, "no-data", message, hint)
