"""The report on a site's links, for the technician and for programs, from the same data."""

from __future__ import annotations

from dataclasses import dataclass, field
from datetime import UTC, datetime
from itertools import zip_longest
from textwrap import wrap
from typing import TYPE_CHECKING, Any

from atlantis_netcfg.core.errors import ExitCode
from atlantis_netcfg.core.events import Verdict
from atlantis_netcfg.core.language import translate
from atlantis_netcfg.core.messages import arg, conjunction, join, msg
from atlantis_netcfg.core.times import time_text
from atlantis_netcfg.runs.report.summary import count_limits

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

_KINDS = {"wifi_ptp": "Wi-Fi bridge", "lte": "4G", "satellite": "satellite", "ethernet": "cable"}
_STATES = {"up": "up", "down": "DOWN", "searching": "searching", "unknown": "unknown"}
_NOT_GREEN = frozenset({Verdict.FAIL.value, Verdict.ERROR.value, Verdict.INCONCLUSIVE.value})
"""Verdicts of a finding that are not green: a check without result is no better than a failed one."""
_MARGIN, _WIDTH = 14, 117
"""First and last column of a line's text, both after the indent of 3."""


@dataclass(frozen=True, slots=True)
class LinksReport:
    """One observation; `bearers` in order of preference, each as `BearerStatus.as_dict` with its findings."""

    site: str
    title: str
    is_rehearsal: bool
    bearers: Mapping[str, Mapping[str, Any]]
    queried_devices: tuple[str, ...]
    """Devices that were queried, whether or not they responded."""
    unreachable: Sequence[Mapping[str, str | None]] = ()
    not_asked: Mapping[str, str] = field(default_factory=dict)
    round_trips: Mapping[str, int] = field(default_factory=dict)
    costs: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    """Maps a metered link to the cost of this query on it: the bill as data, and its `words`."""
    notes: tuple[str, ...] = ()
    not_rehearsed: tuple[str, ...] = ()
    time_zone: str = ""
    """The pilot's time zone (IANA name), for displayed times."""

    @property
    def exit(self) -> ExitCode:
        """Exit code: not OK if nothing was queried, or a link fails or is unknown, or a device does not respond.

        A satellite link that was not requested to be probed has no finding.
        """
        if not self.queried_devices:
            return ExitCode.NOTHING
        not_green = any(
            finding["verdict"] in _NOT_GREEN for link in self.bearers.values() for finding in link["findings"]
        )
        return ExitCode.CHECKS_FAILED if not_green or self.unreachable else ExitCode.DONE

    def as_json(self) -> dict[str, Any]:
        """The object that `--json` prints."""
        return {
            "site": self.site,
            "rehearsed": self.is_rehearsal,
            "exit": int(self.exit),
            "bearers": {name: dict(entry) for name, entry in self.bearers.items()},
            "unreachable": [dict(item) for item in self.unreachable],
            "not_asked": dict(self.not_asked),
            "round_trips": dict(self.round_trips),
            "costs": {name: dict(entry) for name, entry in self.costs.items()},
            "notes": list(self.notes),
            "not_rehearsed": list(self.not_rehearsed),
            "errors": [],
        }

    def as_text(self) -> str:
        """Return the report as text."""
        return join("\n", self._lines())

    def _lines(self) -> Iterator[str]:
        what = "emulated devices; no real device was contacted" if self.is_rehearsal else "nothing was changed"
        yield msg(f"Links of {arg(self.site)} ({arg(self.title)}), the preferred one first: {arg(what)}")
        for number, (name, link) in enumerate(self.bearers.items(), start=1):
            yield ""
            yield from _block(number, name, link, self.time_zone)
        yield ""
        yield from (msg(f"not queried: {arg(device)}: {arg(why)}") for device, why in self.not_asked.items())
        cost_of = "cost of a real run over" if self.is_rehearsal else "cost of this run over"
        yield from (msg(f"{arg(cost_of)} {arg(name)}: {arg(link['words'])}") for name, link in self.costs.items())
        yield from (msg(f"note: {arg(' '.join(note.split()))}") for note in self.notes)
        if self.not_rehearsed:
            yield count_limits(len(self.not_rehearsed))
        yield self._closing()

    def _closing(self) -> str:
        """Return which link carries the traffic, and whether it is the preferred one."""
        preferred_link = next(iter(self.bearers), "")
        active = [name for name, entry in self.bearers.items() if entry["active"]]
        if not self.queried_devices:
            return msg(f"No device was queried, so nothing is known about {arg(self.site)}")
        if any(link["active"] is None for link in self.bearers.values()):
            return msg(f"Which link carries the traffic of {arg(self.site)} is not known: the router was not read")
        if not active:
            return msg(f"NO LINK carries the traffic of {arg(self.site)}")
        if len(active) > 1:
            return msg(f"{arg(conjunction(active))} share the traffic of {arg(self.site)}")
        words = msg(f"{arg(active[0])} carries the traffic of {arg(self.site)}")
        if active[0] == preferred_link:
            return msg(f"{arg(words)}: it is the preferred link")
        cost_note = "; it is metered" if self.bearers[active[0]]["metered"] else ""
        return msg(f"{arg(words)}: it is NOT the preferred link, which is {arg(preferred_link)}{arg(cost_note)}")


def _block(number: int, name: str, link: Mapping[str, Any], zone: str) -> Iterator[str]:
    kind = translate(_KINDS.get(link["kind"], link["kind"]))
    box = join("", (", ", link["box"])) if link["box"] else ""
    yield msg(f"{arg(number)}. {arg(name)}: {arg(kind)}{arg(box)}")
    yield from _lines(msg("state"), join(", ", _state(link)))
    for title, words in _quality(link["kind"], link["quality"]):
        yield from _lines(title, words)
    if link["probe_bytes"]:
        cost_note = msg(f" ({arg(_size(link['probe_bytes']))}, metered)" if link["metered"] else "")
        yield from _lines(msg("probe"), join("", (_probe(link["quality"]), cost_note)))
    yield from _lines("this month", _month(link, zone))
    for title, words in zip_longest(("background",), link["standing"]["words"], fillvalue=""):
        yield from _lines(title, words)
    for finding in link["findings"]:
        yield from _lines(finding["verdict"], finding["message"])
        if finding["hint"]:
            yield from _lines("", finding["hint"])


def _lines(title: str, words: str) -> Iterator[str]:
    """Yield the lines of one entry, wrapped at the console width."""
    title, words = translate(title), translate(words)
    for number, part in enumerate(wrap(words, _WIDTH - _MARGIN, break_long_words=False, break_on_hyphens=False)):
        yield f"   {'' if number else title:<{_MARGIN}}{part}"


def _state(link: Mapping[str, Any]) -> Iterator[str]:
    if link["state"] == "unknown" and link["kind"] == "satellite":
        yield "not probed, to keep its capacity for traffic"
    else:
        yield translate(_STATES[link["state"]])
    if link["active"]:
        yield "carries traffic now"
    if link["metered"]:
        yield msg("metered")


def _probe(quality: Mapping[str, Any]) -> str:
    loss, rtt = quality.get("loss_percent"), quality.get("rtt_ms")
    if loss == 100:  # noqa: PLR2004 - per cent
        return "no probe target responds"
    time = msg("" if rtt is None else f" within {arg(rtt):g} ms")
    lost = msg(f", {arg(loss)} % lost" if loss else "")
    return msg(f"probe targets respond{arg(time)}{arg(lost)}")


def _month(link: Mapping[str, Any], zone: str) -> str:
    if link["month_bytes"] is None:
        return "not counted yet"
    gaps = len(link["month_gaps"])
    more = msg(
        f"; at least: {arg(gaps)} gaps in the count" if gaps > 1 else "; at least: one gap in the count" if gaps else ""
    )
    return msg(f"{arg(_size(link['month_bytes']))}, counted since {arg(_since(link['month_since'], zone))}{arg(more)}")


def _since(stamp: str | None, zone: str) -> str:
    """Format a JSON time stamp such as `2026-11-01 10:00 UTC` for the user."""
    try:
        moment = datetime.strptime(stamp or "", "%Y-%m-%d %H:%M UTC").replace(tzinfo=UTC)
    except ValueError:
        return str(stamp)
    return time_text(moment, zone)


def _quality(kind: str, quality: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """Yield label and text of each reading; unavailable readings are omitted."""
    words = {"wifi_ptp": _wifi_quality, "lte": _lte_quality, "satellite": _terminal_quality}.get(kind)
    if words is not None:
        yield from words(quality)
    if quality.get("port_link") is not None:
        yield "port", msg(f"{arg(quality['port'])}, link {arg(quality['port_link'])}")


def _wifi_quality(quality: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    parts = list(_signal(quality))
    if parts:
        yield "signal", join("; ", parts)
    flow = [*_tx_rx_text(quality, "", "rate_mbps", "Mbit/s"), *_tx_rx_text(quality, "CCQ ", "ccq_percent", "%")]
    if flow:
        yield "rates", join(", ", flow)
    if quality.get("status") is not None or quality.get("channel") is not None:
        yield (
            "radio",
            join(", ", (str(quality[name]) for name in ("status", "channel") if quality.get(name) is not None)),
        )


def _signal(quality: Mapping[str, Any]) -> Iterator[str]:
    level, far = quality.get("signal_dbm"), quality.get("far_signal_dbm")
    if level is not None:
        chains = [value for name, value in quality.items() if name.startswith("signal_chain") and value is not None]
        more = msg(f" (chains {arg(join(', ', (f'{value:g}' for value in chains)))})" if chains else "")
        yield msg(f"{arg(_radio_grade(level))}, {arg(level):g} dBm{arg(more)}")
    if far is not None:
        yield msg(f"the other end receives {arg(far):g} dBm")


def _radio_grade(level: float) -> str:
    """Grade the level of a short link (devices.md, section 8); the limits are checked by the findings."""
    if level > -35:  # noqa: PLR2004
        return translate("too strong")
    return translate("good") if level >= -65 else translate("fair") if level >= -75 else translate("poor")  # noqa: PLR2004


def _tx_rx_text(quality: Mapping[str, Any], title: str, name: str, unit: str) -> Iterator[str]:
    tx_value, rx_value = quality.get(f"tx_{name}"), quality.get(f"rx_{name}")
    if tx_value is not None and rx_value is not None:
        yield msg(f"{arg(title)}{arg(tx_value):g}/{arg(rx_value):g} {arg(unit)} sent/received")
    elif tx_value is not None or rx_value is not None:
        yield f"{title}{tx_value if tx_value is not None else rx_value:g} {unit}"


_GRADES = {
    "rsrp_dbm": ("RSRP", -90, -105, "dBm"),
    "rsrq_db": ("RSRQ", -10, -15, "dB"),
    "sinr_db": ("SINR", 13, 0, "dB"),
}
"""Name, lower limit of good, upper limit of poor, unit: devices.md, section 4, from memory; for description only."""


def _lte_quality(quality: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    levels = [_level(key, quality[key]) for key in _GRADES if quality.get(key) is not None]
    if levels:
        yield "signal", join(", ", levels)
    network = [str(quality[name]) for name in ("operator", "plmn", "access_tech", "band") if quality.get(name)]
    if quality.get("registration") is not None:
        yield "network", join(", ", [msg(str(quality["registration"]).replace("_", " ")), *network])
    if quality.get("address") is not None or quality.get("apn") is not None:
        address, apn = quality.get("address"), quality.get("apn")
        identity = (address and msg(f"address {arg(address)}"), apn and f"APN {apn}")
        words = join(", ", filter(None, identity))
        yield "data", msg(f"{arg(words)}{', behind carrier NAT' if quality.get('carrier_nat') == 'yes' else ''}")


def _level(key: str, value: float) -> str:
    name, good, poor, unit = _GRADES[key]
    grade = translate("good") if value > good else translate("poor") if value < poor else translate("fair")
    return msg(f"{arg(name)} {arg(value):g} {arg(unit)} ({arg(grade)})")


def _terminal_quality(quality: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    reachability = {"yes": "responds to the router", "no": "has not responded to the router recently"}.get(
        str(quality.get("next_hop_seen"))
    )
    firmware = None
    if quality.get("firmware") is not None:
        firmware = msg(
            f"firmware {arg(quality['firmware'])}, seen by {arg(quality['seen_by'])} on {arg(quality['seen_on'])}"
        )
    if reachability or firmware:
        yield "terminal", join(", ", (words for words in (reachability, firmware) if words))
    if quality.get("kept_off_packets") is not None:
        packets, nbytes = quality["kept_off_packets"], _size(quality["kept_off_bytes"])
        yield "blocked", msg(f"{arg(packets)} packets ({arg(nbytes)}) outside the allow-list")


def _size(nbytes: int) -> str:
    """Format a size in decimal units, as providers bill."""
    if nbytes < 1000:  # noqa: PLR2004
        return f"{nbytes} B"
    if nbytes < 999_500:  # noqa: PLR2004 - from here on it would be rounded to `1000 kB`
        return f"{nbytes / 1000:.1f} kB" if nbytes < 10_000 else f"{nbytes / 1000:.0f} kB"  # noqa: PLR2004
    return f"{nbytes / 1_000_000:.1f} MB"
