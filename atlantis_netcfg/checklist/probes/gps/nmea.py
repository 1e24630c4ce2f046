"""NMEA 0183 sentences of any talker (GP, GN, GL …): GGA, GNS, RMC, GLL, GSA and ZDA, combined per epoch.

GGA, GNS and GLL have a time of day and no date; RMC and GLL do not report whether a fix has three dimensions, which GSA
does, and so does an altitude in GGA. A receiver of several systems sends a GSA for each: the best of an epoch counts,
as in gpsd. A sentence counts only if its checksum is correct. Ship multiplexers put a TAG block in front (NMEA 0183
4.00): its source identifies the receiver.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime, timedelta
from typing import TYPE_CHECKING

from atlantis_netcfg.checklist.probes.gps import record

if TYPE_CHECKING:
    from collections.abc import Sequence

    from atlantis_netcfg.checklist.probes.base import Transcript

_FRAME = re.compile(rb"[$!]([\x20-\x23\x25-\x29\x2b-\x7e]{1,200})\*([0-9A-Fa-f]{2})\s*")
_TAG = re.compile(rb"\\([\x20-\x29\x2b-\x5b\x5d-\x7e]{0,200})\*([0-9A-Fa-f]{2})\\")
_NUMBER = re.compile(r"-?\d{1,12}(?:\.\d{1,12})?|-?\.\d{1,12}")
_QUALITY = {6: record.Nature.DEAD_RECKONING, 7: record.Nature.MANUAL, 8: record.Nature.SIMULATED}
_INDICATOR = {"E": record.Nature.DEAD_RECKONING, "M": record.Nature.MANUAL, "S": record.Nature.SIMULATED}
_CENTURY = 80
"""Years of two digits below it are after 2000."""
_KNOT_M_S = 1852 / 3600


def checksum(body: bytes) -> int:
    """Compute the exclusive or of all bytes between `$` and `*`."""
    result = 0
    for byte in body:
        result ^= byte
    return result


def sentence(line: bytes) -> list[str] | None:
    """Return the fields of a sentence, its address field first; None if invalid or if the checksum is wrong."""
    frame = _FRAME.fullmatch(line)
    if frame is None or checksum(frame[1]) != int(frame[2], 16):
        return None
    return frame[1].decode("ascii").split(",")


def _strip_tag(line: bytes, before: str) -> tuple[bytes, str] | None:
    r"""Strip a TAG block; `before`: previous source, for lines of a group. None if the checksum is wrong."""
    if not line.startswith(b"\\"):
        return line, ""
    tag = _TAG.match(line)
    if tag is None or checksum(tag[1]) != int(tag[2], 16):
        return None
    source = re.search(r"(?:^|,)s:([^,]{1,40})", tag[1].decode("ascii"))
    return line[tag.end() :], source[1] if source else before


def enough(reports: int) -> bytes:
    """Return the pattern that ends listening: `reports` consecutive RMC fixes with advancing time, or twice as many."""
    tag = rb"(?:\\[^\\\n]*\\)?"
    rmc, others = tag + rb"\$..RMC,%s[^\n]*\n", rb"(?:(?!" + tag + rb"\$..RMC,)[^\n]*\n)*"
    first, same, later = rmc % rb"(?P<first>[^,\n]*),A", rmc % rb"[^,\n]*,A", rmc % rb"(?!(?P=first),)[^,\n]*,A"
    fixes = first + (others + same) * (reports - 2) + others + later
    many = rb"(?:" + tag + rb"\$..%s,[^\n]*\n(?:(?!" + tag + rb"\$..%s,)[^\n]*\n)*){%d}"
    any_kind = rb"|".join(many % (kind, kind, 2 * reports) for kind in (rb"RMC", rb"GGA", rb"GLL"))
    return rb"(?m)^(?:%s|%s)" % (fixes, any_kind)


@dataclass
class _Epochs:
    """Groups sentences into epochs: a new one starts with another time, or a repeated type of sentence."""

    reports: list[record.Report] = field(default_factory=list)
    open: record.Report | None = None
    kinds: set[str] = field(default_factory=set)
    void: bool = False
    """Whether a sentence of this epoch reports that there is no fix."""
    dimensions: int | None = None
    """Dimensions in the best GSA since the last epoch was closed, otherwise in the epochs before."""
    fresh: bool = False
    """Whether a GSA has arrived since the last epoch was closed."""
    satellites: int | None = None
    hdop: float | None = None
    date: str = ""
    """Date of the last ZDA, for sources without RMC."""
    doubles: list[record.Report] = field(default_factory=list)
    """Other positions reported for an epoch; a receiver may round them differently, but not more."""

    def take(self, at_s: float, fields: Sequence[str]) -> None:
        kind = fields[0][2:] if len(fields[0]) == _ADDRESS else ""
        columns = [*fields, *[""] * 20]
        if kind in _POSITIONS:
            time = columns[5] if kind == "GLL" else columns[1]
            getattr(self, f"_{kind.lower()}")(self._epoch(at_s, kind, time), columns)
        elif kind == "GSA":
            self._gsa(int(columns[2]) if columns[2] in {"1", "2", "3"} else None)
        elif kind == "ZDA" and all(part.isdecimal() for part in columns[2:5]):
            self.date = f"{columns[2]:0>2}{columns[3]:0>2}{columns[4][-2:]}"

    def _epoch(self, at_s: float, kind: str, time: str) -> record.Report:
        of_day = _parse_time_of_day(time)
        if self.open is None or kind in self.kinds or of_day != self.open.of_day:
            self.close()
            self.open = record.Report(at_s, of_day=of_day)
        self.kinds.add(kind)
        return replace(self.open, at_s=at_s)

    def _gsa(self, result: int | None) -> None:
        best = max(result or 0, self.dimensions or 0) if self.fresh else result or 0
        self.dimensions, self.fresh = best or None, True

    def _gga(self, report: record.Report, fields: Sequence[str]) -> None:
        quality = int(fields[6]) if re.fullmatch(r"\d", fields[6]) else None
        if not quality:
            self.void = self.void or quality == 0
            self.open = report
            return
        self._used(fields[7:9])
        three = 3 if _number(fields[9]) is not None else 2
        self.open = replace(
            self._with_position(report, fields[2:6]), mode=three, nature=_QUALITY.get(quality, report.nature)
        )

    def _gns(self, report: record.Report, fields: Sequence[str]) -> None:
        """Process GNS, which has one mode indicator per system; `N`: not used."""
        used = fields[6].replace("N", "")
        if not used:
            self.void = self.void or bool(fields[6])
            self.open = report
            return
        self._used(fields[7:9])
        three = 3 if _number(fields[9]) is not None else 2
        nature = next((_INDICATOR[item] for item in "SME" if item in used), report.nature)
        self.open = replace(self._with_position(report, fields[2:6]), mode=three, nature=nature)

    def _used(self, fields: Sequence[str]) -> None:
        """Process the number of satellites used, and their dilution of precision."""
        used = _number(fields[0])
        self.satellites = int(used) if used is not None else self.satellites
        self.hdop = _number(fields[1]) or self.hdop

    def _rmc(self, report: record.Report, fields: Sequence[str]) -> None:
        new_report = replace(report, time=_parse_date(fields[9], report.of_day))
        knots = _number(fields[7])
        speed = None if knots is None else knots * _KNOT_M_S
        self._take_status(replace(new_report, speed_m_s=speed), fields[2], fields[12], fields[3:7])

    def _gll(self, report: record.Report, fields: Sequence[str]) -> None:
        self._take_status(report, fields[6], fields[7], fields[1:5])

    def _take_status(self, report: record.Report, status: str, indicator: str, place: Sequence[str]) -> None:
        """Process a sentence with status `A` or `V`, and perhaps the origin of the position."""
        self.void = self.void or status == "V" or indicator == "N"
        if status != "A":
            self.open = report
            return
        nature = _INDICATOR.get(indicator, report.nature)
        self.open = replace(self._with_position(report, place), mode=max(report.mode or 2, 2), nature=nature)

    def _with_position(self, report: record.Report, fields: Sequence[str]) -> record.Report:
        new_report = _set_position(report, fields)
        if report.latitude is not None and new_report != report:
            self.doubles.append(report)
        return new_report

    def close(self) -> None:
        """Complete the epoch that is open."""
        if self.open is not None:
            self.reports.append(self._complete_report(self.open))
        self.open, self.kinds, self.void, self.fresh = None, set(), False, False
        # GSA may come more rarely than positions: that there was no fix is over with its epoch.
        self.dimensions = None if self.dimensions == 1 else self.dimensions

    def _complete_report(self, report: record.Report) -> record.Report:
        if self.void or self.dimensions == 1:
            return replace(report, mode=1)
        mode = report.mode if report.mode is None or self.dimensions is None else self.dimensions
        time = report.time if report.time is not None else _parse_date(self.date, report.of_day)
        return replace(report, mode=mode, time=time)


_ADDRESS = 5
"""Length of an address: two letters of the talker, three of the sentence."""
_POSITIONS = frozenset({"GGA", "GNS", "RMC", "GLL"})


def read(transcript: Transcript) -> record.Reception:
    """Parse a stream of sentences, from any starting point; of several sources, use the one with the most fixes."""
    sources: dict[str, _Epochs] = {}
    good = bad = 0
    source = ""
    for number, (at_s, line) in enumerate(record.lines(transcript)):
        plain = _strip_tag(line, source)
        fields = None if plain is None else sentence(plain[0])
        if plain is not None and fields is not None:
            good += 1
            source = plain[1]
            sources.setdefault(source, _Epochs()).take(at_s, fields)
        elif number and line.strip():
            # The first line is cut where the listening began.
            bad += 1
    for source_epochs in sources.values():
        source_epochs.close()
    device, epochs = max(
        sources.items(), key=lambda entry: sum(r.has_fix for r in entry[1].reports), default=("", _Epochs())
    )
    others = {name: item for name, item in sources.items() if name != device and item.reports}
    return record.Reception(
        reports=tuple(epochs.reports),
        is_recognized=good > 0,
        heard_bytes=len(transcript.data),
        good=good,
        bad=bad,
        others=tuple(name or "an unnamed one" for name in others),
        rivals=(*epochs.doubles, *(other.reports[-1] for other in others.values() if other.reports[-1].has_fix)),
        device=device,
        satellites=epochs.satellites,
        hdop=epochs.hdop,
        began=transcript.began,
        ended_s=transcript.ended_s,
    )


def _number(text: str) -> float | None:
    return float(text) if _NUMBER.fullmatch(text) else None


def _parse_time_of_day(text: str) -> float | None:
    match = re.fullmatch(r"(\d\d)(\d\d)(\d\d(?:\.\d{1,9})?)", text)
    return int(match[1]) * 3600 + int(match[2]) * 60 + float(match[3]) if match else None


def _parse_date(text: str, of_day: float | None) -> float | None:
    match = re.fullmatch(r"(\d\d)(\d\d)(\d\d)", text)
    if match is None or of_day is None:
        return None
    day, month, year = (int(part) for part in match.groups())
    try:
        midnight = datetime(year + (2000 if year < _CENTURY else 1900), month, day, tzinfo=UTC)
    except ValueError:
        return None
    return (midnight + timedelta(seconds=of_day)).timestamp()


def _set_position(report: record.Report, fields: Sequence[str]) -> record.Report:
    latitude = _degrees(fields[0], fields[1], 2, "N", "S")
    longitude = _degrees(fields[2], fields[3], 3, "E", "W")
    return replace(report, latitude=latitude, longitude=longitude)


def _degrees(text: str, hemisphere: str, digits: int, plus: str, minus: str) -> float | None:
    match = re.fullmatch(rf"(\d{{{digits}}})(\d\d(?:\.\d{{1,12}})?)", text, re.ASCII)
    if match is None or hemisphere not in {plus, minus}:
        return None
    value = int(match[1]) + float(match[2]) / 60
    return value if hemisphere == plus else -value
