"""The survey file in JSON Lines: a header, one line per point, and an end line. Append-only.

Values that a device did not report are null, and so are unknown positions. If the last line is cut off, the file is
valid without it. A file without an end line belongs to a survey that was killed.
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from datetime import datetime
from typing import TYPE_CHECKING, Annotated, Final, Literal, TextIO

from pydantic import Field, TypeAdapter

from atlantis_netcfg.core import stored_messages
from atlantis_netcfg.core.errors import UsageError
from atlantis_netcfg.core.message_models import MessageModel
from atlantis_netcfg.core.messages import arg

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

VERSION: Final = 1
SURVEY_FILE: Final = "survey.jsonl"
SAMPLES_FILE: Final = "samples.jsonl"


class SurveyUnreadable(UsageError, ValueError):
    """Raised when a file is not a survey written by this version."""


class SurveyHeader(MessageModel):
    """Site, link and settings of a survey."""

    kind: Literal["survey"] = "survey"
    version: int = VERSION
    id: str
    tool: str
    """Version of this program."""
    site: str
    title: str
    link: str
    unit: str
    """Name of the 4G unit that is read."""
    far_end: str | None
    """Destination that answers the test packets; None: none are sent."""
    positions_by: str
    """Source of the positions: `gpsd at 127.0.0.1:2947`, `a person`."""
    emulated: bool
    """Whether track, unit and link were emulated: then the values do not describe a real place."""
    begun: datetime
    time_zone: str
    step_m: float | None
    step_s: float
    max_age_s: float
    """Maximum age of a position fix; an older fix is ignored."""
    max_hdop: float
    hourly_bytes: int
    test_every_s: float | None
    """Interval of tests that the hourly budget allows; None: no tests are made."""
    train_packets: int
    packet_size: int
    """UDP payload of each test packet."""
    message_size: int


class SurveyPoint(MessageModel):
    """Signal values and measurements at one place."""

    kind: Literal["point"] = "point"
    number: int
    at: datetime
    at_s: float
    """Seconds since the beginning."""
    read_s: float = 0.0
    """Seconds that reading the unit took; the position is that at its end."""
    latitude: float | None = None
    longitude: float | None = None
    """WGS 84, decimal degrees; None: no position, and `no_position` says why."""
    no_position: str = ""
    fix_age_s: float | None = None
    hdop: float | None = None
    place: str = ""
    """Name given to the place by a person."""
    moved_m: float | None = None
    """Distance from here to where this point's tests ended; None: not known, or no tests were made."""
    registration: str | None = None
    technology: str | None = None
    operator: str | None = None
    band: str | None = None
    cell: str | None = None
    rsrp_dbm: float | None = None
    rsrq_db: float | None = None
    sinr_db: float | None = None
    no_radio: str = ""
    """Why the unit was not read."""
    carried_by: str | None = None
    """Link that carries the site's traffic by the router's routes; None: not known."""
    sent: int | None = None
    """Packets sent to measure the round trip; None: no test was made, and `no_test` says why."""
    lost: int | None = None
    rtt_min_s: float | None = None
    rtt_median_s: float | None = None
    rtt_max_s: float | None = None
    goodput_up_bps: float | None = None
    no_test: str = ""
    test_bytes: int = 0
    """Bytes sent and received, IP and UDP headers included."""

    @property
    def position(self) -> tuple[float, float] | None:
        """Latitude and longitude, if both are known."""
        return None if self.latitude is None or self.longitude is None else (self.latitude, self.longitude)


class SurveyEnd(MessageModel):
    """End of a survey, with the reason."""

    kind: Literal["end"] = "end"
    at: datetime
    reason: str
    """End reason: `done` or `stopped`."""


SurveyLine = Annotated[SurveyHeader | SurveyPoint | SurveyEnd, Field(discriminator="kind")]
_ADAPTER: Final[TypeAdapter[SurveyHeader | SurveyPoint | SurveyEnd]] = TypeAdapter(SurveyLine)


@dataclass(frozen=True, slots=True)
class Survey:
    """A survey as read from its file."""

    header: SurveyHeader
    points: tuple[SurveyPoint, ...]
    end: SurveyEnd | None
    """None: the program was killed, or the survey is still running."""

    @property
    def placed_points(self) -> tuple[SurveyPoint, ...]:
        """Points that have a position."""
        return tuple(point for point in self.points if point.position is not None)

    @property
    def reason(self) -> str:
        """The reason why the survey ended; "cut off" if there is no end line."""
        return "cut off" if self.end is None else self.end.reason


@dataclass(frozen=True, slots=True)
class SurveyWriter:
    """Appends lines to an open survey file; each line is on disk before the next is written."""

    file: TextIO

    def __call__(self, line: SurveyHeader | SurveyPoint | SurveyEnd) -> None:
        """Append a line and sync it to disk."""
        self.file.write(f"{line.to_json()}\n")
        self.file.flush()
        os.fsync(self.file.fileno())


def read_survey(path: Path) -> Survey:
    """Read a survey file. Raises SurveyUnreadable (with line number) and OSError."""
    lines = [*_lines(path)]
    if not lines or not isinstance(lines[0], SurveyHeader):
        raise SurveyUnreadable(f"{arg(path)}:1: this is not the start of a survey", hint=f"use a `{arg(SURVEY_FILE)}`")
    points = tuple(line for line in lines if isinstance(line, SurveyPoint))
    end = next((line for line in lines if isinstance(line, SurveyEnd)), None)
    return Survey(lines[0], points, end)


def _lines(path: Path) -> Iterator[SurveyHeader | SurveyPoint | SurveyEnd]:
    with path.open(encoding="utf-8") as file:
        for number, line in enumerate(file, start=1):
            if not line.endswith("\n"):
                return
            try:
                yield _ADAPTER.validate_python(stored_messages.parse(line))
            except ValueError as error:
                raise SurveyUnreadable(
                    f"{arg(path)}:{arg(number)}: this line does not belong to a survey",
                    hint="use the original file: it must not be edited",
                ) from error
