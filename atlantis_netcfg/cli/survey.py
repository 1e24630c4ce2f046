"""`provision measure coverage`: coverage of a 4G link along a track, as points, a page, GeoJSON and CSV."""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.cli.base import syntax
from atlantis_netcfg.cli.base.output import json_text
from atlantis_netcfg.core.language import translate
from atlantis_netcfg.core.messages import arg, msg

if TYPE_CHECKING:
    from pathlib import Path

    from atlantis_netcfg.cli.base.session import CommandSession
    from atlantis_netcfg.core.errors import ExitCode
    from atlantis_netcfg.emulator.coverage import PlaceTruth
    from atlantis_netcfg.inventory import Host, Inventory
    from atlantis_netcfg.inventory.model import Link
    from atlantis_netcfg.links.qualify.samples import Sample
    from atlantis_netcfg.records.survey.exports import Coast
    from atlantis_netcfg.records.survey.measure import RunningSurvey, SurveyPlan
    from atlantis_netcfg.records.survey.points import SurveyLine, SurveyPoint
    from atlantis_netcfg.records.survey.site import SiteSurvey

SURVEY = syntax.CommandSpec(
    "measure coverage",
    "measure the coverage of a 4G link along a track",
    words=(
        syntax.Word("site", "the site", is_required=True, example="te4sea"),
        syntax.Word("link", "4G link (optional if the site has only one)", example="4g"),
        syntax.Word("gps", "`gateway`, `here` or a gpsd address (default: the gateway)", example="here"),
        syntax.Word("every", "metres and seconds between points", example="50m,30s"),
        syntax.Word("for", "duration, from 1 minute to 24 hours (default: until Ctrl-C)", example="1h"),
        syntax.Word("to", "also copy the files to this folder", example="coverage"),
        syntax.Word("coast", "GeoJSON coastline, or `natural-earth` (coarse, up to 1 km off)", example="coast.geojson"),
        syntax.Word("from", "an earlier survey: only rewrite its files", example="20261120T101500Z"),
        syntax.INVENTORY,
    ),
    flags=(
        syntax.Flag("clicks", "type each position yourself, instead of gpsd"),
        syntax.Flag("radio-only", "read only the unit, send nothing over the link"),
        syntax.Flag("max-mb", "at most MB per hour, headers included (default: 2)", takes="MB"),
        syntax.Flag("rehearse", "use an emulated voyage and unit, at the link's rate"),
        syntax.ACCEPT_COST,
        syntax.ASK_VAULT_PASS,
        syntax.JSON,
    ),
    details=(
        "Nothing is changed. A point without a fresh fix has no position; nothing is interpolated. Ctrl-C ends "
        "the survey and keeps all results. Exit code 0: there are positions, levels and responses, 6: one of "
        "these is missing everywhere, 7: no point was recorded."
    ),
)


def run_survey(arguments: syntax.Arguments) -> ExitCode:
    """Take points until the time is over or a person stops it, then make the files."""
    from atlantis_netcfg.cli.base.session import session
    from atlantis_netcfg.inventory import choose
    from atlantis_netcfg.records.survey.radio import find_lte_unit, find_survey_link

    plan = _plan(arguments)
    coast = _coast(arguments)
    if arguments.optional("from") is not None:
        return _rebuild_exports(arguments, coast)

    def choose_hosts(inventory: Inventory) -> tuple[Host, ...]:
        choose(inventory, arguments.word("site"), ())
        link = find_survey_link(inventory, arguments.word("site"), arguments.optional("link"))
        return (find_lte_unit(inventory, link),)

    _check_arguments(arguments)
    with session(arguments, rehearse=arguments.flag("rehearse"), choose_hosts=choose_hosts) as site_session:
        folder = _measure(site_session, plan)
        return _report(site_session.arguments, folder, coast, site_session.is_rehearsal)


def _check_arguments(arguments: syntax.Arguments) -> None:
    from atlantis_netcfg.core.errors import UsageError
    from atlantis_netcfg.inventory import ALL

    if arguments.word("site") == ALL:
        raise UsageError("`provision measure coverage` takes one site at a time", hint="type its name: `site=te4sea`")
    if arguments.flag("clicks") and arguments.flag("rehearse"):
        raise UsageError(
            "typed positions cannot be rehearsed: the emulated coverage needs the emulated track",
            hint="remove `--clicks` or `--rehearse`",
        )


def _plan(arguments: syntax.Arguments) -> SurveyPlan:
    """Parse steps, time and budget. Raises UsageError."""
    from dataclasses import replace

    from atlantis_netcfg.operations.use import span_s
    from atlantis_netcfg.records.survey.measure import SurveyPlan, parse_hourly_budget, parse_steps

    step_m, step_s = parse_steps(arguments.optional("every"))
    span = arguments.optional("for")
    limit = span_s(span) if span is not None else _REHEARSED_S if arguments.flag("rehearse") else None
    plan = replace(SurveyPlan(), step_m=step_m, step_s=step_s, max_seconds=limit)
    most = arguments.value("max-mb")
    return plan if most is None else replace(plan, hourly_bytes=parse_hourly_budget(most))


_REHEARSED_S = 1200.0
"""Length of an emulated voyage on its own clock, if `for=` is not given."""


def _coast(arguments: syntax.Arguments) -> Coast | None:
    from atlantis_netcfg.records.survey.exports import find_coast

    coast_name = arguments.optional("coast")
    return None if coast_name is None else find_coast(coast_name)


def _rebuild_exports(arguments: syntax.Arguments, coast: Coast | None) -> ExitCode:
    from atlantis_netcfg.core import paths
    from atlantis_netcfg.records.survey.archive import find_survey, folder_of
    from atlantis_netcfg.runs import Store

    is_rehearsal = arguments.flag("rehearse")
    store = Store(paths.state_dir(), is_rehearsal=is_rehearsal)
    folder = find_survey(folder_of(store, arguments.word("site")), arguments.optional("from") or "")
    return _report(arguments, folder, coast, is_rehearsal)


def _measure(session: CommandSession, plan: SurveyPlan) -> Path:
    """Run the survey; return the folder with its files."""
    from contextlib import ExitStack

    from atlantis_netcfg.links.qualify.samples import SampleWriter
    from atlantis_netcfg.operations.common.request import refuse_examples
    from atlantis_netcfg.operations.qualify.far_end import open_far_end
    from atlantis_netcfg.records.survey.archive import folder_of, new_folder
    from atlantis_netcfg.records.survey.points import SAMPLES_FILE, SURVEY_FILE, SurveyEnd, SurveyWriter
    from atlantis_netcfg.records.survey.positions import GpsdSource
    from atlantis_netcfg.runs import os_errors_as, utc_now

    refuse_examples(session.inventory, is_rehearsal=session.is_rehearsal)
    site = _site(session, plan)
    _confirm_cost(session, site.link, plan)
    if not session.is_rehearsal and not site.radio_only:
        open_far_end(session.inventory, site.request)
    folder = new_folder(folder_of(session.store, session.site), utc_now())
    with ExitStack() as stack:
        with os_errors_as("the survey", folder):
            lines = stack.enter_context((folder / SURVEY_FILE).open("x", encoding="utf-8"))
            raw = stack.enter_context((folder / SAMPLES_FILE).open("x", encoding="utf-8"))
        add, add_sample = SurveyWriter(lines), SampleWriter(raw)

        def write(line: SurveyLine) -> None:
            with os_errors_as("the survey", folder):
                add(line)

        def sample_taken(sample: Sample) -> None:
            with os_errors_as("the survey", folder):
                add_sample(sample)

        def point_taken(point: SurveyPoint) -> None:
            write(point)
            if not session.as_json and not session.is_rehearsal:
                print(_line(point), flush=True)

        survey = site.build_survey(stack, sample_taken, point_taken)
        write(site.header(survey, folder.name))
        _begin_words(session, survey)
        reason = _by_clicks(survey) if session.arguments.flag("clicks") else survey.run()
        write(SurveyEnd(at=survey.clock.utc(), reason=reason))
    if isinstance(survey.positions, GpsdSource) and survey.positions.trouble and not session.as_json:
        print(translate(f"{arg(survey.positions.name)}: {arg(survey.positions.trouble)}"), flush=True)
    return folder


def _site(session: CommandSession, plan: SurveyPlan) -> SiteSurvey:
    from atlantis_netcfg.operations import Mode
    from atlantis_netcfg.records.survey.radio import find_survey_link
    from atlantis_netcfg.records.survey.site import SiteSurvey

    arguments, unit, emulators = session.arguments, session.hosts[0], session.rehearsal

    def tune(truth: PlaceTruth) -> None:
        assert emulators is not None  # noqa: S101 - only a rehearsal tunes
        emulators.tune(unit.name, truth)

    return SiteSurvey(
        session.inventory,
        find_survey_link(session.inventory, session.site, arguments.optional("link")),
        unit,
        session.request(Mode.DRIFT),
        session.store,
        plan,
        radio_only=arguments.flag("radio-only"),
        clicks=arguments.flag("clicks"),
        gps=arguments.optional("gps"),
        tune=None if emulators is None else tune,
    )


def _confirm_cost(session: CommandSession, link: Link, plan: SurveyPlan) -> None:
    """Show the possible cost and ask for consent. Raises CostRefusal."""
    from atlantis_netcfg.cli.base.consent import pay
    from atlantis_netcfg.links.cost import preview
    from atlantis_netcfg.operations.common.site_links import link_of

    site_link = link_of(session.inventory, session.site, link.name)
    if not site_link.is_metered or session.arguments.flag("radio-only"):
        return
    hours = 1.0 if plan.max_seconds is None else max(1.0, plan.max_seconds / 3600.0)
    cost_preview = preview(round(plan.hourly_bytes * hours), 3600.0 * hours, site_link, at_most=True)
    words = msg(f"{arg(cost_preview.words)}{': each hour, until you stop it' if plan.max_seconds is None else ''}")
    if session.is_rehearsal:
        if not session.as_json:
            print(translate(f"a real survey asks first: {arg(words)}"))
        return
    if cost_preview.over_cap:
        raise cost_preview.refusal()
    pay([words], is_accepted=session.arguments.flag(syntax.ACCEPT_COST.name), as_json=session.as_json)


def _begin_words(session: CommandSession, survey: RunningSurvey) -> None:
    """Print how the survey works, and how to stop it."""
    if session.as_json:
        return
    link, plan = survey.link, survey.plan
    if survey.tester is None:
        print(translate(f"Reading the unit of {arg(link)}; nothing is sent over the link"), flush=True)
    else:
        pace = plan.test_every_s(survey.tester.transport.headers)
        most = plan.hourly_bytes / 1_000_000
        print(
            translate(f"One test over {arg(link)} every {arg(pace):.0f} s: up to {arg(most):g} MB an hour"), flush=True
        )
    if not session.is_rehearsal and plan.max_seconds is None and not session.arguments.flag("clicks"):
        print(translate("Ctrl-C ends the survey and keeps all results"), flush=True)


def _by_clicks(survey: RunningSurvey) -> str:
    """Take a point for each position that the user types; return why it ended."""
    from atlantis_netcfg.links.qualify.session import EndReason
    from atlantis_netcfg.records.survey.measure import STOP_REASON
    from atlantis_netcfg.records.survey.site import TypedPositions

    assert isinstance(survey.positions, TypedPositions)  # noqa: S101 - `--clicks` has chosen it
    survey.begin()
    question = translate("Your position? LAT, LON, or NAME: LAT, LON, or NAME (Enter: same position; Ctrl-D ends): ")
    try:
        while True:
            if not survey.positions.type(input(question)):
                print(translate("  not a position: type it like 41.6864, -8.8388"))
            elif survey.take().no_test == STOP_REASON:
                return EndReason.STOPPED
    except EOFError:
        return EndReason.DONE
    except KeyboardInterrupt:
        return EndReason.STOPPED


def _line(point: SurveyPoint) -> str:
    """Format a point for the screen, translated."""
    where = translate(point.no_position)
    if point.position is not None:
        where = msg(f"{arg(point.latitude):.5f}, {arg(point.longitude):.5f}")
    levels = (("RSRP", point.rsrp_dbm), ("RSRQ", point.rsrq_db), ("SINR", point.sinr_db))
    radio = " ".join(f"{name} {value:g}" for name, value in levels if value is not None)
    test = translate(point.no_test)
    if point.rtt_median_s is not None and not test:
        test = translate(
            f"{arg(point.rtt_median_s * 1000):.0f} ms, {arg((point.goodput_up_bps or 0) / 1e6):.2f} Mbit/s up"
        )
    return f"{point.number:>4}  {where}  {radio or translate(point.no_radio or 'no level')}  {test}"


def _report(arguments: syntax.Arguments, folder: Path, coast: Coast | None, is_rehearsal: bool) -> ExitCode:  # noqa: FBT001 - as it is
    """Generate the files, and list them."""
    from pathlib import Path

    from atlantis_netcfg.records.survey.archive import EXPORTS, evaluate_survey, export
    from atlantis_netcfg.records.survey.page import count_unplaced, summary
    from atlantis_netcfg.records.survey.rehearsal import NOT_REHEARSED
    from atlantis_netcfg.runs.report.summary import count_limits

    folder_name = arguments.optional("to")
    survey = export(folder, coast, None if folder_name is None else Path(folder_name))
    result = evaluate_survey(survey)
    beyond = NOT_REHEARSED if is_rehearsal else ()
    if arguments.flag("json"):
        document = {
            "survey": survey.header.model_dump(mode="json", exclude={"kind"}),
            "ended": survey.reason,
            "points": len(survey.points),
            "placed": len(survey.placed_points),
            "bytes": sum(point.test_bytes for point in survey.points),
            "without_position": dict(count_unplaced(survey)),
            "kept": str(folder),
            "files": list(EXPORTS),
            "message": result.words,
            "rehearsed": is_rehearsal,
            "not_rehearsed": list(beyond),
            "exit": int(result.exit),
        }
        print(json_text(document))
        return result.exit
    lines = [
        msg(f"Survey of {arg(survey.header.link)} of {arg(survey.header.site)}, {arg(survey.header.id)}"),
        *(["emulated devices; no real device was contacted"] if is_rehearsal else []),
        *(msg(f"  {arg(line)}") for line in summary(survey)),
        *([msg(f"  {arg(count_limits(len(beyond)))}")] if beyond else []),
        msg(f"saved: {arg(folder)}"),
        result.words,
    ]
    for line in lines:
        print(translate(line))
    return result.exit
