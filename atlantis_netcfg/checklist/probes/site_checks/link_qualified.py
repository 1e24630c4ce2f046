"""Each link of the site was measured recently, and has the required quality.

Nothing is measured here: the newest stored measurement (`provision measure link`) is judged again, from its samples.
Without one, or with an old one, the present state of the link is unknown, and that never passes.
"""

from __future__ import annotations

from dataclasses import dataclass
from datetime import timedelta
from typing import TYPE_CHECKING

from atlantis_netcfg.checklist.probes import base
from atlantis_netcfg.checklist.probes.site_checks import parse
from atlantis_netcfg.core.events import Verdict
from atlantis_netcfg.core.messages import arg, msg
from atlantis_netcfg.links import LinkFinding
from atlantis_netcfg.links.qualify.session import EndReason

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping
    from datetime import datetime

    from atlantis_netcfg.checklist.report import Evidence
    from atlantis_netcfg.inventory.model import Link
    from atlantis_netcfg.links.qualify.record import QualifyRecord

NAME = "link-qualified"
_AHEAD = timedelta(minutes=5)
"""Permitted clock difference of two computers."""


def link_qualified_checks(site: parse.OwnSite) -> tuple[base.Step, ...]:
    """Return one step per link, if the inventory has a measurement server; otherwise none."""
    if site.inventory.pilot.qualify is None:
        return ()
    return tuple(
        parse.step(
            f"{NAME}-{link.name}",
            msg(f"Link {arg(link.name)} was measured and meets its criteria"),
            _LinkQualificationCheck(site, link),
            (*site.hosts[:1], *((link.device,) if link.device else ())),
        )
        for link in site.site_config.bearers
    )


@dataclass(frozen=True, slots=True)
class _LinkQualificationCheck:
    """Check that the link was measured recently, and has the required quality."""

    site: parse.OwnSite
    link: Link

    def asks(self) -> tuple[base.Question, ...]:
        return (base.LinkRecordRequest("record", self.site.name, self.link.name),)

    def judge(self, results: Mapping[str, base.Answer]) -> base.ProbeResult:
        answer = results["record"]
        if not isinstance(answer, base.LinkRecordResult) or answer.trouble is not None or answer.now is None:
            why = msg(f": {arg(answer.words)}" if isinstance(answer, base.LinkRecordResult) and answer.words else "")
            hint = msg(f"check `provision measure history site={arg(self.site.name)} link={arg(self.link.name)}`")
            return base.ProbeResult(
                (
                    parse.unknown(
                        "not-readable", msg(f"the measurements of {arg(self.link.name)} cannot be read{arg(why)}"), hint
                    ),
                )
            )
        again = msg(f"`provision measure link site={arg(self.site.name)} link={arg(self.link.name)}` measures it")
        record = answer.record
        if record is None:
            message = msg(f"{arg(self.link.name)} was never measured by this computer")
            return base.ProbeResult((parse.unknown("never-measured", message, again),))
        if record.run.emulated and not answer.is_rehearsal:
            message = msg(f"the measurement of {arg(self.link.name)} used an emulated link")
            return base.ProbeResult((parse.unknown("emulated", message, again),))
        wrong = (*self._wrong(record, answer.now, is_rehearsal=answer.is_rehearsal),)
        if answer.is_rehearsal:  # the record is made up: it shows what a fault looks like, and is evidence of nothing
            return base.ProbeResult(wrong or (self._not_measured(),))
        return base.ProbeResult(wrong or (self._good_finding(record, answer.now),), tuple(_evidence(record)))

    def _wrong(self, record: QualifyRecord, now: datetime, *, is_rehearsal: bool) -> Iterator[LinkFinding]:
        """Yield everything that prevents passing, failures first. Simulated rehearsal results are not stored."""
        run, name = record.run, self.link.name
        again = msg(f"`provision measure link site={arg(self.site.name)} link={arg(self.link.name)}` measures it")
        failed_criteria = [item.criterion for item in record.judgements if item.verdict is Verdict.FAIL]
        open_ = [item.criterion for item in record.judgements if item.verdict not in {Verdict.FAIL, Verdict.PASS}]
        why = msg(f": {arg(run.way_reason)}" if run.way_reason else "")
        if failed_criteria:
            message = msg(
                f"{arg(name)} does not meet `{arg(record.thresholds_name)}`: {arg(parse.join_words(failed_criteria))}"
            )
            show_hint = msg(
                f"`provision measure show site={arg(self.site.name)} run={arg(run.id)}` shows the full result"
            )
            yield parse.fail("beyond-the-limit", message, again if is_rehearsal else show_hint)
        if run.way is Verdict.FAIL:
            yield parse.fail(
                "other-link", msg(f"the measurement of {arg(name)} went over another link{arg(why)}"), again
            )
        elif run.way is not Verdict.PASS:
            yield parse.unknown(
                "way-not-proved", msg(f"no proof that the measurement of {arg(name)} went over it{arg(why)}"), again
            )
        if not run.far_end.authenticated:
            message = msg(
                f"{arg(run.far_end.name)}, which responded to the measurement of {arg(name)}, is not an authenticated "
                "far end"
            )
            yield parse.unknown("other-far-end", message, again)
        if run.reason != EndReason.DONE:
            yield parse.unknown(
                "cut-short", msg(f"the measurement of {arg(name)} was not completed: {arg(run.reason)}"), again
            )
        if open_ or not record.judgements:
            what = parse.join_words(open_) or "no round trips without load"
            yield parse.unknown(
                "not-proved", msg(f"the measurement of {arg(name)} does not decide: {arg(what)}"), again
            )
        if run.kind != self.link.kind.value:
            kinds = msg(f"its kind was {arg(run.kind)}, and is now {arg(self.link.kind.value)}")
            yield parse.unknown(
                "other-kind", msg(f"{arg(name)} has changed since it was measured: {arg(kinds)}"), again
            )
        yield from self._check_age(run.begun, now)

    def _check_age(self, start: datetime, now: datetime) -> Iterator[LinkFinding]:
        days = self.site.site_config.checklist.qualified_within_days
        again = msg(f"`provision measure link site={arg(self.site.name)} link={arg(self.link.name)}` measures it")
        if start > now + _AHEAD:
            message = msg(
                f"the measurement of {arg(self.link.name)} is dated in the future: {arg(start):%Y-%m-%d %H:%M} UTC"
            )
            yield parse.unknown("of-the-future", message, "check this computer's clock, then measure again")
        elif now - start > timedelta(days=days):
            age = (now - start).days
            old = msg(f"the last measurement of {arg(self.link.name)} is {arg(age)} days old; the limit is {arg(days)}")
            yield parse.unknown("stale", old, again)

    def _not_measured(self) -> LinkFinding:
        message = msg(f"{arg(self.link.name)} was not measured: a checklist rehearsal measures no link")
        return LinkFinding(Verdict.SKIP, "not-measured", message)

    def _good_finding(self, record: QualifyRecord, now: datetime) -> LinkFinding:
        count, age = len(record.judgements), (now - record.run.begun).days
        since = msg("today" if age < 1 else "yesterday" if age == 1 else f"{arg(age)} days ago")
        message = msg(
            f"{arg(self.link.name)} meets all {arg(count)} criteria of `{arg(record.thresholds_name)}`, measured "
            f"{arg(since)}"
        )
        return parse.good("qualified", message)


def _evidence(record: QualifyRecord) -> Iterator[Evidence]:
    run = record.run
    yield parse.read("measurement", msg(f"{arg(run.id)}, started {arg(run.begun):%Y-%m-%d %H:%M} UTC"))
    yield parse.read("SHA-256 of its samples", record.samples_sha256)
    for item in record.judgements:
        value = "unknown" if item.measured is None else f"{item.measured:.4g} {item.unit}".rstrip()
        yield parse.measured_evidence(
            item.criterion, msg(f"{arg(value)}, limit {arg(item.limit):g}: {arg(item.verdict.value)}")
        )
