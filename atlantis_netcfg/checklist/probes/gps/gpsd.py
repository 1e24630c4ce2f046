"""gpsd's JSON (protocol 3, gpsd_json(5)): one object per line, of which TPV, SKY, DEVICES, VERSION and ERROR are read.

A TPV without a fix has neither time nor position; after a lone GGA it has a position and no time, and after a lone GSA,
when listening begins in the middle of an epoch, a mode and neither of them; `status` is omitted for a plain fix, so its
absence means nothing (all observed with gpsd 3.22).
"""

from __future__ import annotations

import json
import re
from dataclasses import dataclass, field
from datetime import datetime
from typing import TYPE_CHECKING, Any

from atlantis_netcfg.checklist.probes.gps import record

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from atlantis_netcfg.checklist.probes.base import Transcript

WATCH = b'?WATCH={"enable":true,"json":true};\n'
WATCH_REPLY = rb'"class":"WATCH"'
_STATUS = {5: record.Nature.DEAD_RECKONING, 7: record.Nature.MANUAL, 8: record.Nature.SIMULATED}
_TPV = rb'\{"class":"TPV"'
_OTHERS = rb'(?:(?!\{"class":"TPV")[^\n]*\n)*'


def enough(reports: int) -> bytes:
    """Return the pattern that ends listening: so many fixes in a row with advancing time, or twice as many reports."""
    fix = _TPV + rb'(?=[^\n]*"mode":[23])(?=[^\n]*"time":"%s")[^\n]*\n'
    first, same, later = fix % rb'(?P<first>[^"\n]*)', fix % rb'[^"\n]*', fix % rb'(?!(?P=first)")[^"\n]*'
    fixes = first + (_OTHERS + same) * (reports - 2) + _OTHERS + later
    return rb"(?m)^(?:%s|(?:%s[^\n]*\n%s){%d})" % (fixes, _TPV, _OTHERS, 2 * reports)


@dataclass
class _GpsdReading:
    reports: dict[str, list[record.Report]] = field(default_factory=dict)
    open_devices: dict[str, bool] | None = None
    version: str = ""
    satellites: dict[str, int] = field(default_factory=dict)
    """Most satellites used, by receiver; only of receivers whose satellites gpsd sees at all."""
    hdop: dict[str, float] = field(default_factory=dict)
    complaints: list[str] = field(default_factory=list)
    is_recognized: bool = False
    good: int = 0
    bad: int = 0

    def take(self, at_s: float, line: bytes) -> None:
        values = _parse_line(line)
        if values is None:
            self.bad += 1
            return
        self.good += 1
        take = getattr(self, f"_{values['class'].lower()}", None) if values["class"] in _CLASSES else None
        self.is_recognized = self.is_recognized or take is not None
        if take is not None:
            take(at_s, values)

    def _version(self, _: float, values: Mapping[str, Any]) -> None:
        self.version = _words(values, "release")

    def _devices(self, at_s: float, values: Mapping[str, Any]) -> None:
        devices = values.get("devices")
        self.open_devices = {}
        for item in devices if isinstance(devices, list) else ():
            if isinstance(item, dict):
                self._device(at_s, item)

    def _device(self, _: float, values: Mapping[str, Any]) -> None:
        self.open_devices = self.open_devices or {}
        self.open_devices[_words(values, "path")] = values.get("activated") != 0

    def _tpv(self, at_s: float, values: Mapping[str, Any]) -> None:
        self.reports.setdefault(_words(values, "device"), []).append(_report(at_s, values))

    def _sky(self, _: float, values: Mapping[str, Any]) -> None:
        device = _words(values, "device")
        used, hdop, in_view = _number(values.get("uSat")), _number(values.get("hdop")), _number(values.get("nSat"))
        satellites = values.get("satellites")
        if used is None and isinstance(satellites, list):
            used = sum(isinstance(item, dict) and item.get("used") is True for item in satellites)
        # Of a receiver that tells no satellites gpsd says that 0 of 0 are used: nothing follows from that.
        if used is not None and abs(used) < _MANY and (used or in_view or satellites):
            self.satellites[device] = max(int(used), self.satellites.get(device, 0))
        if hdop is not None:
            self.hdop[device] = hdop

    def _error(self, _: float, values: Mapping[str, Any]) -> None:
        self.complaints.append(_words(values, "message") or "an error without a message")


_MANY = 1000
_LONGEST = 120
_CLASSES = frozenset({"VERSION", "DEVICES", "DEVICE", "TPV", "SKY", "ERROR"})


def read(transcript: Transcript) -> record.Reception:
    """Parse gpsd's output; of several receivers, use the one with the most fixes. Raises nothing."""
    reading = _GpsdReading()
    for at_s, line in record.lines(transcript):
        if line.strip():
            reading.take(at_s, line)
    device, reports = max(reading.reports.items(), key=lambda item: sum(r.has_fix for r in item[1]), default=("", []))
    others = {path: its for path, its in reading.reports.items() if path != device}
    open_devices = reading.open_devices
    return record.Reception(
        reports=_complete(reports),
        is_recognized=reading.is_recognized,
        heard_bytes=len(transcript.data),
        good=reading.good,
        bad=reading.bad,
        devices=None if open_devices is None else tuple(path for path, is_open in open_devices.items() if is_open),
        others=tuple(path or "an unnamed one" for path in others),
        rivals=tuple(_complete(its)[-1] for its in others.values() if _complete(its)[-1].has_fix),
        device=device,
        version=reading.version,
        satellites=reading.satellites.get(device, reading.satellites.get("")),
        hdop=reading.hdop.get(device, reading.hdop.get("")),
        complaints=tuple(reading.complaints),
        began=transcript.began,
        ended_s=transcript.ended_s,
    )


def _complete(reports: Sequence[record.Report]) -> tuple[record.Report, ...]:
    """Remove incomplete reports, unless there are no others."""
    whole = tuple(item for item in reports if not item.has_fix or item.latitude is not None or item.time is not None)
    return whole if any(report.has_fix for report in whole) else tuple(reports)


def _parse_line(line: bytes) -> dict[str, Any] | None:
    try:
        reply = json.loads(line)
    except (ValueError, RecursionError):
        return None
    return reply if isinstance(reply, dict) and isinstance(reply.get("class"), str) else None


def _report(at_s: float, values: Mapping[str, Any]) -> record.Report:
    mode, status = values.get("mode"), values.get("status")
    return record.Report(
        at_s=at_s,
        mode=mode if isinstance(mode, int) and not isinstance(mode, bool) else None,
        latitude=_number(values.get("lat")),
        longitude=_number(values.get("lon")),
        time=_time(values.get("time")),
        nature=_STATUS.get(status, record.Nature.MEASURED) if isinstance(status, int) else record.Nature.MEASURED,
        eph_m=_number(values.get("eph")),
        speed_m_s=_number(values.get("speed")),
    )


def _words(values: Mapping[str, Any], name: str) -> str:
    """Return a text safe for printing: truncated, and without terminal control characters."""
    value = values.get(name)
    return "".join(item if item.isprintable() else "?" for item in value[:_LONGEST]) if isinstance(value, str) else ""


def _number(value: object) -> float | None:
    if isinstance(value, bool) or not isinstance(value, int | float):
        return None
    try:
        return float(value)
    except OverflowError:
        return None


def _time(value: object) -> float | None:
    if not isinstance(value, str) or not re.fullmatch(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d(\.\d+)?Z", value):
        return None
    try:
        return datetime.fromisoformat(value).timestamp()
    except ValueError:
        return None
