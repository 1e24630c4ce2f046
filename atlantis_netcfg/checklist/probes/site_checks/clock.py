"""All clocks of the site agree: certificates, leases of DDS and test reports depend on it."""

from __future__ import annotations

import re
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from typing import TYPE_CHECKING

from atlantis_netcfg.checklist.probes import base
from atlantis_netcfg.checklist.probes.site_checks import parse
from atlantis_netcfg.core.messages import arg, msg
from atlantis_netcfg.links import LinkFinding

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from atlantis_netcfg.checklist.report import Evidence

APART_S = 2.0
"""Larger differences are wrong: time servers hold a few milliseconds."""
COARSE_S = 30.0
"""A slower response proves too little: a clock may be wrong by this much without being detected."""
_MONTHS = ("jan", "feb", "mar", "apr", "may", "jun", "jul", "aug", "sep", "oct", "nov", "dec")
_DATE = re.compile(r"(?:(\d{4})-(\d\d)-(\d\d)|([a-z]{3})/(\d\d)/(\d{4}))")
_TIME = re.compile(r"(\d\d):(\d\d):(\d\d)")
_ZONE = re.compile(r"([+-])(\d\d):(\d\d)")


@dataclass(frozen=True, slots=True)
class Offset:
    """Bounds of a clock's lead over this computer's clock; the response time limits their precision."""

    least_s: float
    most_s: float

    @property
    def wrong(self) -> bool:
        """Whether the clock is certainly too far off."""
        return self.least_s > APART_S or self.most_s < -APART_S

    @property
    def coarse(self) -> bool:
        """Whether the bounds are too wide to decide."""
        return not self.wrong and max(self.most_s, -self.least_s) > COARSE_S

    @property
    def words(self) -> str:
        """Description, such as `60 min behind`."""
        middle = (self.least_s + self.most_s) / 2
        if self.least_s <= 0 <= self.most_s:
            return msg(f"the same within {arg(max(self.most_s, -self.least_s)):.1f} s")
        return msg(f"{arg(_span(abs(middle)))} {'ahead of' if middle > 0 else 'behind'}")


def _span(seconds: float) -> str:
    """Format a duration in a unit that suits its size: 45 s, 60 min, 30 h, 690 days."""
    units = ((86_400, "days", 172_800), (3_600, "h", 7_200), (60, "min", 300), (1, "s", 0))
    length, name = next((length, name) for length, name, least in units if seconds >= least)
    return f"{seconds / length:.0f} {name}"


def clock_check(site: parse.OwnSite) -> base.Step:
    """Return the step that compares the clocks of router, gateway and this computer, and their time sources."""
    return parse.step("clock", "Clocks agree, and time servers set them", _ClockReading(site), site.hosts)


@dataclass(frozen=True, slots=True)
class _ClockReading:
    """Check that clocks agree, and are set by time servers."""

    site: parse.OwnSite

    def asks(self) -> tuple[base.Question, ...]:
        return (
            *parse.ask("clock", self.site, "/system/clock"),
            *parse.ask("ntp", self.site, "/system/ntp/client"),
            *parse.run("timedatectl", self.site, "timedatectl show"),
        )

    def judge(self, results: Mapping[str, base.Answer]) -> base.ProbeResult:
        assert self.site.router is not None  # noqa: S101 - the check is made for sites with a router
        router = self.site.router.name
        offsets: dict[str, Offset | LinkFinding] = {router: _router_offset(router, results["clock"])}
        if self.site.gateway is not None:
            offsets[self.site.gateway.name] = _of_computer(self.site.gateway.name, results["timedatectl"])
        known_offsets = {name: entry for name, entry in offsets.items() if isinstance(entry, Offset)}
        wrong = [
            *(offset for offset in offsets.values() if isinstance(offset, LinkFinding)),
            *_judge_offsets(known_offsets),
            *self._set(results, known_offsets),
        ]
        evidence = [
            parse.measured_evidence(msg(f"clock of {arg(name)}, compared with this computer's"), item.words)
            for name, item in known_offsets.items()
        ]
        agree = msg(f"the clocks of {arg(parse.join_words((*known_offsets, 'this computer')))} agree")
        fine = parse.good("clocks-agree", msg(f"{arg(agree)}, and time servers set them"))
        return base.ProbeResult(tuple(wrong) or (fine,), (*evidence, *self._evidence(results)))

    def _set(self, results: Mapping[str, base.Answer], known_offsets: Mapping[str, Offset]) -> Iterator[LinkFinding]:
        """Yield findings on time sources and time zones; hosts that did not respond have their own finding."""
        assert self.site.router is not None  # noqa: S101 - the check is made for sites with a router
        name, zone = self.site.router.name, self.site.inventory.pilot.time_zone
        clock, ntp = _first_row(results["clock"]), parse.rows(results["ntp"], name, "what sets its clock", "enabled")
        if name in known_offsets:
            yield from _zone(name, clock.get("time-zone-name", ""), zone)
            yield from (ntp,) if isinstance(ntp, LinkFinding) else self._of_client(name, ntp[0] if ntp else {})
        gateway = self.site.gateway
        if gateway is not None and gateway.name in known_offsets:
            reply, result = parse.get_output(results["timedatectl"], gateway.name), _pairs(results["timedatectl"])
            if isinstance(reply, LinkFinding):
                yield reply
            elif not {result.get("NTP"), result.get("NTPSynchronized")} <= _YES_NO:
                yield parse.unreadable(gateway.name, "the service that sets its clock")
            elif result["NTP"] == "no":
                yield _no_time_server_finding(gateway.name)
            elif result["NTPSynchronized"] == "no":
                yield _not_synchronised_finding(gateway.name, self.site.name)
            yield from _zone(gateway.name, result.get("Timezone", ""), zone)

    def _of_client(self, name: str, ntp: Mapping[str, str]) -> Iterator[LinkFinding]:
        """Yield findings on `/system/ntp/client`: synchronized, waiting, started, stopped; others prove nothing."""
        status, server = ntp.get("status", ""), ntp.get("synced-server", "")
        time_servers = {str(time_server.address) for time_server in self.site.inventory.pilot.time_servers}
        if ntp.get("enabled") in {"false", "no"} or status in {"stopped", "disabled"}:
            yield _no_time_server_finding(name)
        elif status in {"waiting", "started"}:
            yield _not_synchronised_finding(name, self.site.name)
        elif status != "synchronized":
            text = f"`{status}`" if status else "nothing"
            message = msg(
                f"the NTP client of {arg(name)} reports {arg(text)}: cannot tell whether a time server has set its "
                "clock"
            )
            yield parse.unknown("ntp-unknown", message, msg(f"check `/system/ntp/client/print` of {arg(name)}"))
        elif server and server not in time_servers:
            message = msg(
                f"the clock of {arg(name)} was set by {arg(server)}, which is not a time server of the inventory"
            )
            hint = (
                "apply the site's configuration, which sets the inventory's servers; if that server is right, "
                "add it to `time_servers`"
            )
            yield parse.unknown("other-time-server", message, hint)

    def _evidence(self, results: Mapping[str, base.Answer]) -> Iterator[Evidence]:
        assert self.site.router is not None  # noqa: S101 - the check is made for sites with a router
        ntp, values = (
            _first_row(results["ntp"]),
            _pairs(results["timedatectl"]) if self.site.gateway is not None else {},
        )
        if "status" in ntp:
            server = msg(f" with {arg(ntp['synced-server'])}" if ntp.get("synced-server") else "")
            yield parse.read(msg(f"NTP client of {arg(self.site.router.name)}"), ntp["status"] + server)
        if self.site.gateway is not None and "NTPSynchronized" in values:
            yield parse.read(msg(f"NTPSynchronized of {arg(self.site.gateway.name)}"), values["NTPSynchronized"])


_YES_NO = frozenset({"yes", "no"})


def _judge_offsets(known_offsets: Mapping[str, Offset]) -> Iterator[LinkFinding]:
    """Yield findings on clock differences; if two clocks agree with each other but not with ours, ours is wrong."""
    wrong = {name: offset for name, offset in known_offsets.items() if offset.wrong}
    if len(wrong) == len(known_offsets) > 1 and _has_small_spread(list(wrong.values())):
        sample = next(iter(wrong.values()))
        span = _span(abs(sample.least_s + sample.most_s) / 2)
        behind = sample.least_s > 0
        message = msg(
            f"this computer's clock is {arg(span)} {'behind' if behind else 'ahead'} those of "
            f"{arg(parse.join_words(wrong))}"
        )
        yield parse.fail("laptop-clock", message, "set this computer's clock from a time server, then repeat the check")
        return
    for name, entry in wrong.items():
        hint = msg(
            f"check that {arg(name)} can reach the time servers of the inventory; certificates are rejected while a "
            "clock is wrong"
        )
        yield parse.fail("clock-wrong", msg(f"the clock of {arg(name)} is {arg(entry.words)} this computer's"), hint)
    for name, item in known_offsets.items():
        if item.coarse:
            message = msg(
                f"{arg(name)} responded so slowly that its clock may be off by "
                f"{arg(max(item.most_s, -item.least_s)):.0f} s"
            )
            yield parse.unknown("compared-too-coarsely", message, "repeat the check when the link to it is stable")


def _has_small_spread(offsets: list[Offset]) -> bool:
    return max(item.least_s for item in offsets) - min(offset.most_s for offset in offsets) <= APART_S


def _zone(name: str, text: str, zone: str) -> Iterator[LinkFinding]:
    if text and text != zone:
        message = msg(f"the clock of {arg(name)} shows the time of {arg(text)}; the inventory says {arg(zone)}")
        yield parse.warn("time-zone", message, "apply the site's configuration, which sets the inventory's `time_zone`")


def _not_synchronised_finding(name: str, site: str) -> LinkFinding:
    hint = msg(
        f"check that {arg(name)} can reach the time servers of the inventory; `provision links site={arg(site)}` shows "
        "whether any link is up"
    )
    return parse.warn("not-synchronised", msg(f"no time server has set the clock of {arg(name)} yet"), hint)


def _no_time_server_finding(name: str) -> LinkFinding:
    return parse.fail(
        "no-time-server",
        msg(f"nothing sets the clock of {arg(name)}"),
        "apply the site's configuration, which enables its NTP client",
    )


def _router_offset(name: str, answer: base.Answer) -> Offset | LinkFinding:
    result = parse.rows(answer, name, "its clock", "time")
    if isinstance(result, LinkFinding):
        return result
    moment = router_time(result[0]) if result else None
    if moment is None or not isinstance(answer, base.Rows):
        return parse.unreadable(name, "its clock")
    if not answer.response_time:
        return _not_compared_finding(name)
    return Offset(moment.timestamp() - answer.response_time, moment.timestamp() + 1 - answer.request_time)


def router_time(row: Mapping[str, str]) -> datetime | None:
    """Parse `/system/clock`; before 7.10 dates have the form `nov/22/2026`. None if it is not valid."""
    date, time = _DATE.fullmatch(row.get("date", "")), _TIME.fullmatch(row.get("time", ""))
    zone = _ZONE.fullmatch(row.get("gmt-offset", "+00:00"))
    if date is None or time is None or zone is None:
        return None
    year, month, day, name, old_day, old_year = date.groups()
    if name is not None and name not in _MONTHS:
        return None
    whole = f"{year or old_year}-{month or f'{_MONTHS.index(name) + 1:02}'}-{day or old_day} {row['time']}"
    ahead = timedelta(hours=int(zone[2]), minutes=int(zone[3])) * (-1 if zone[1] == "-" else 1)
    try:
        return datetime.fromisoformat(whole).replace(tzinfo=UTC) - ahead
    except ValueError:
        return None


def _of_computer(name: str, answer: base.Answer) -> Offset | LinkFinding:
    """Return the clock offset from the start time of any program, or the finding why it is unknown."""
    if not isinstance(answer, base.CommandResult) or answer.trouble is not None or not answer.began:
        result = parse.get_output(answer, name)
        return result if isinstance(result, LinkFinding) else parse.unreadable(name, "its clock")
    if not answer.response_time:
        return _not_compared_finding(name)
    return Offset(answer.began - answer.response_time, answer.began - answer.request_time)


def _not_compared_finding(name: str) -> LinkFinding:
    return parse.unknown(
        "not-compared", msg(f"the clock of {arg(name)} was not compared with this computer's"), "repeat the check"
    )


def _first_row(answer: base.Answer) -> Mapping[str, str]:
    return answer.rows[0] if isinstance(answer, base.Rows) and answer.trouble is None and answer.rows else {}


def _pairs(answer: base.Answer) -> Mapping[str, str]:
    text = answer.out if isinstance(answer, base.CommandResult) and answer.trouble is None else ""
    return {name: value for name, _, value in (line.partition("=") for line in text.splitlines())}
