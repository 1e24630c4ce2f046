"""Stored surveys of a site on this computer, and the files exported from them.

They are in `<state>/<real|rehearsal>/<site>/survey/<survey>/`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from atlantis_netcfg import runs
from atlantis_netcfg.core import errors
from atlantis_netcfg.core.messages import arg, join, msg
from atlantis_netcfg.records.survey import points
from atlantis_netcfg.records.survey.exports import CSV_FILE, GEOJSON_FILE, csv_table, geojson
from atlantis_netcfg.records.survey.page import PAGE_FILE, render_page

if TYPE_CHECKING:
    from collections.abc import Mapping
    from datetime import datetime
    from pathlib import Path

    from atlantis_netcfg.records.survey.exports import Coast

EXPORTS: Final = (PAGE_FILE, GEOJSON_FILE, CSV_FILE)


def folder_of(store: runs.Store, site: str) -> Path:
    """Return the folder that holds the surveys of a site."""
    return store.root / site / "survey"


def new_folder(folder: Path, now: datetime) -> Path:
    """Create the empty folder of a new survey; its name is the survey id. Raises JournalError."""
    with runs.os_errors_as("the survey", folder):
        return runs.new_run(runs.make_private(folder), now)


def find_survey(folder: Path, name: str) -> Path:
    """Return the folder of an existing survey. Raises NoMatchError."""
    names = [path.name for path in folder.iterdir() if (path / points.SURVEY_FILE).is_file()] if folder.is_dir() else []
    if name in names:
        return folder / name
    near = errors.nearest(name, names)
    there = msg(f"available: {arg(join(', ', sorted(names)[-5:]))}" if names else "none yet")
    raise errors.NoMatchError(
        f"there is no saved survey `{arg(name)}`",
        hint=f"did you mean `from={arg(near)}`? {arg(there)}" if near else there,
    )


def exports(survey: points.Survey, coast: Coast | None = None) -> Mapping[str, bytes]:
    """Return the export files of a survey (HTML page, GeoJSON, CSV), by file name."""
    return {PAGE_FILE: render_page(survey, coast), GEOJSON_FILE: geojson(survey), CSV_FILE: csv_table(survey)}


def export(folder: Path, coast: Coast | None = None, to: Path | None = None) -> points.Survey:
    """Write the exports of a stored survey beside it; if `to` is given, also there with the survey file.

    Raises SurveyUnreadable, JournalError.
    """
    with runs.os_errors_as("the survey", folder):
        survey = points.read_survey(folder / points.SURVEY_FILE)
        files = dict(exports(survey, coast))
        for name, data in files.items():
            runs.write_atomically(folder / name, data)
    if to is not None:
        with runs.os_errors_as("the survey", to):
            to.mkdir(parents=True, exist_ok=True)
            files[points.SURVEY_FILE] = (folder / points.SURVEY_FILE).read_bytes()
            for name, data in files.items():
                runs.write_atomically(to / name, data)
    return survey


@dataclass(frozen=True, slots=True)
class SurveyOutcome:
    """Exit code and summary of a finished survey."""

    exit: errors.ExitCode
    words: str


def evaluate_survey(survey: points.Survey) -> SurveyOutcome:
    """Return exit code and summary; CHECKS_FAILED if a requested measurement is missing from every point."""
    if not survey.points:
        return SurveyOutcome(errors.ExitCode.NOTHING, "no point was recorded")
    tested_points = [point for point in survey.points if point.rtt_median_s is not None]
    levels = [point for point in survey.points if point.rsrp_dbm is not None]
    lacks = [] if survey.placed_points else [msg(f"no point has a position ({arg(survey.points[-1].no_position)})")]
    if not levels:
        lacks.append(msg(f"the unit reported no level ({arg(survey.points[-1].no_radio or 'it does not report it')})"))
    if survey.header.far_end is not None and not tested_points:
        reasons = list(dict.fromkeys(point.no_test for point in survey.points if point.no_test))
        lacks.append(msg(f"no test over the link got a response ({arg(join(', ', reasons))})"))
    if lacks:
        return SurveyOutcome(errors.ExitCode.CHECKS_FAILED, join("; ", lacks))
    whole = sum(point.position is not None and point.rsrp_dbm is not None for point in survey.points)
    return SurveyOutcome(
        errors.ExitCode.DONE, msg(f"{arg(whole)} of {arg(len(survey.points))} points have a position and a level")
    )
