"""The drift report as text, JSON object and JUnit file, generated from the engine's results only."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from dataclasses import dataclass, field
from datetime import datetime
from itertools import groupby
from typing import TYPE_CHECKING, Any

from atlantis_netcfg.core import printable
from atlantis_netcfg.core.errors import ExitCode, worst
from atlantis_netcfg.core.events import Verdict
from atlantis_netcfg.core.events import worst as worst_verdict
from atlantis_netcfg.core.messages import arg, join, msg
from atlantis_netcfg.core.printable import visible
from atlantis_netcfg.core.times import time_text
from atlantis_netcfg.runs.report.run import cost_lines

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping, Sequence


_ENDS = {ExitCode.DONE: "PASS", ExitCode.CHECKS_FAILED: "FAIL"}


@dataclass(frozen=True, slots=True)
class DriftReport:
    """Drift of the devices of a site."""

    site: str
    is_rehearsal: bool
    devices: Mapping[str, Mapping[str, Any]]
    """Maps a device name to the engine's result."""
    not_handled: Mapping[str, str] = field(default_factory=dict)
    """Maps a device name to its kind, for devices that no role supports yet."""
    unfinished_runs: Mapping[str, str] = field(default_factory=dict)
    """Maps a device name to the run whose outcome is open."""
    next_commands: Mapping[str, str] = field(default_factory=dict)
    """Maps a device name to the command that continues that run."""
    left_out: Mapping[str, str] = field(default_factory=dict)
    """Rehearsal: maps a device name to why it has no emulated device here."""
    time_zone: str = ""
    """The pilot's time zone (IANA name), for displayed times."""

    @property
    def skip_reasons(self) -> Mapping[str, str]:
        """Reasons why devices were not compared, by name."""
        untold = {name: msg(f"not supported yet ({arg(_kind(kind))})") for name, kind in self.not_handled.items()}
        return {**{name: msg(f"not rehearsed: {arg(why)}") for name, why in self.left_out.items()}, **untold}

    @property
    def exit(self) -> ExitCode:
        """The worst exit code of all devices; unreadable is worse than different."""
        return worst(ExitCode(result["exit"]) for result in self.devices.values())

    def as_json(self) -> dict[str, Any]:
        """The object that `--json` prints; docs/running.md describes the terms."""
        return {
            "site": self.site,
            "rehearsed": self.is_rehearsal,
            "exit": int(self.exit),
            "devices": {
                **{name: self._device(name, result) for name, result in self.devices.items()},
                **{name: {"verdict": "SKIP", "message": why} for name, why in self.skip_reasons.items()},
            },
            "errors": [
                {"device": name, "message": result["message"], "hint": result["hint"]}
                for name, result in self.devices.items()
                if verdict(result) == "ERROR"
            ],
        }

    def _device(self, name: str, result: Mapping[str, Any]) -> dict[str, Any]:
        comparison = result["comparison"] or {"menus": [], "confirmed": None, "differences": []}
        keys = ("message", "hint", "notes", "round_trips", "bytes", "seconds", "version", "board")
        return {
            "verdict": verdict(result),
            **comparison,
            **{key: result[key] for key in keys},
            **({"cost": result["cost"]} if "cost" in result else {}),
            "unfinished": self.unfinished_runs.get(name),
        }

    def as_text(self) -> str:
        """Return the report as text."""
        return join("\n", self._lines())

    def _lines(self) -> Iterator[str]:
        for name, result in self.devices.items():
            yield msg(
                f"{arg(name)}: "
                f"{'ERROR, ' if verdict(result) == 'ERROR' else ''}{arg(printable.below(result['message'], 4))}"
            )
            yield from (msg(f"  {arg(printable.below(line, 4))}") for line in self._detail_lines(name, result))
            if result["comparison"] is not None:
                yield from drift_lines(result["comparison"])
            yield ""
        yield from (msg(f"{arg(name)}: {arg(why)}") for name, why in self.skip_reasons.items())
        if self.is_rehearsal:
            yield "rehearsed on emulated devices as they are after `provision device adopt`: no real device was read"

    def _detail_lines(self, name: str, result: Mapping[str, Any]) -> Iterator[str]:
        if result["comparison"] is not None:
            yield _confirmation_text(result["comparison"], self.time_zone)
        if result["hint"]:
            yield result["hint"]
        yield from cost_lines(result, is_rehearsal=self.is_rehearsal)
        yield from (msg(f"note: {arg(note)}") for note in result["notes"])
        if name in self.unfinished_runs:
            yield msg(
                f"note: the outcome of run {arg(self.unfinished_runs[name])} is open: "
                f"`{arg(self.next_commands[name])}` continues it"
            )


def _confirmation_text(comparison: Mapping[str, Any], zone: str) -> str:
    confirmation = comparison["confirmed"]
    if confirmation is None:
        return "unknown since when: no run has confirmed a state of this device"
    return msg(
        f"last confirmed by run {arg(confirmation['run'])} of "
        f"{arg(time_text(datetime.fromisoformat(confirmation['at']), zone))}"
    )


def verdict(result: Mapping[str, Any]) -> str:
    """Return PASS, FAIL for drift, or ERROR if unknown; for a satellite terminal, the worst of its findings."""
    if of_evidence(result):
        return str(worst_verdict([Verdict.PASS, *(Verdict(finding["verdict"]) for finding in result["findings"])]))
    return _ENDS.get(ExitCode(result["exit"]), "ERROR")


def of_evidence(result: Mapping[str, Any]) -> bool:
    """Return True if the result is based on evidence only: a satellite terminal has no interface to read."""
    return result.get("status") == "declared"


def drift_lines(comparison: Mapping[str, Any]) -> list[str]:
    """Return the differences of one device by menu; empty if none."""
    lines = []
    for menu, differences in groupby(comparison["differences"], key=lambda item: item["menu"]):
        lines.append(f"  {menu}")
        for difference in differences:
            lines += [msg(f"    {arg(line)}") for line in difference_lines(difference, comparison["confirmed"])]
    return lines


def difference_lines(difference: Mapping[str, Any], confirmation: Mapping[str, str] | None) -> Iterator[str]:
    """Yield the lines of one difference: what, owner, since when, and by whom according to the device's history."""
    yield msg(f"{arg(msg(difference['kind'])):<9}{arg(printable.line(difference['subject']))}")
    details = [
        msg(
            f"{arg(field['name'])}: inventory {arg(_value_text(field['declared']))}, device "
            f"{arg(_value_text(field['found']))}"
        )
        for field in difference["fields"]
    ]
    if difference["row"]:
        details.append(difference["row"])
    details.append(join("; ", filter(None, (_owner(difference), _since(difference, confirmation)))))
    if difference["history"]:
        change = difference["history"]
        details.append(
            msg(
                f"history of the device: {arg(change['action'])}, by {arg(change['by'])}, {arg(change['at'])} by its "
                "clock"
            )
        )
    yield from (msg(f"{'':<8} {arg(printable.line(detail))}") for detail in details)


def _owner(difference: Mapping[str, Any]) -> str:
    mark = msg(f" ({arg(difference['mark'])})" if difference["mark"] and not difference["row"] else "")
    return msg(f"{arg(msg(difference['owner']))}{arg(mark)}")


def _since(difference: Mapping[str, Any], confirmation: Mapping[str, str] | None) -> str:
    if difference["kind"] == "hidden":
        return str(difference["why_unknown"])
    if confirmation is None:
        return ""  # said once, for the whole device
    if difference["since"] == "unknown":
        return msg(f"unknown since when: {arg(difference['why_unknown'])}")
    if difference["since"] == "after":
        return msg(f"changed after run {arg(confirmation['run'])}")
    if difference["kind"] == "foreign":
        return msg(f"already there in run {arg(confirmation['run'])}, which left it unchanged")
    return msg(f"already so in run {arg(confirmation['run'])}: the inventory is newer")


def _value_text(value: str) -> str:
    return value or msg("nothing")


def _kind(kind: str) -> str:
    return kind.replace("_", " ")


_NOT_XML = re.compile("[^\t\n\r\u0020-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
"""Characters that XML 1.0 cannot contain, even escaped (its production Char); a device's comment may contain them."""


def clean(text: str) -> str:
    """Replace characters that XML does not allow, and write out invisible ones."""
    return _NOT_XML.sub("\ufffd", visible(text.expandtabs(1)))


def add(case: ET.Element, tag: str, kind: str, *texts: str) -> None:
    """Add a failure or error to a test case: first line as message, all lines as text."""
    first = next((line for text in texts for line in text.splitlines()), "")
    ET.SubElement(case, tag, type=kind, message=clean(" ".join(first.split()))).text = _join_lines(texts)


def skip(case: ET.Element, why: str) -> None:
    """Mark a test case as skipped."""
    ET.SubElement(case, "skipped", message=clean(why))


def add_output(case: ET.Element, *texts: str) -> None:
    """Add output to a test case that does not affect its verdict."""
    ET.SubElement(case, "system-out").text = _join_lines(texts)


def _join_lines(texts: Iterable[str]) -> str:
    """Join cleaned lines; they are cleaned first, since a trailing carriage return would be lost."""
    return "\n".join(map(clean, texts))


def count(suite: ET.Element) -> None:
    """Set the counts of a suite from its cases."""
    for name, tag in (("tests", "testcase"), ("failures", "failure"), ("errors", "error"), ("skipped", "skipped")):
        suite.set(name, str(len(list(suite.iter(tag)))))


def total(root: ET.Element) -> None:
    """Set the counts of the root from its suites."""
    for name in ("tests", "failures", "errors", "skipped"):
        root.set(name, str(sum(int(suite.get(name, "0")) for suite in root)))
    root.set("time", f"{sum(float(suite.get('time', '0')) for suite in root):.3f}")


def render_xml(root: ET.Element) -> bytes:
    """Return the XML file, with the totals set."""
    total(root)
    ET.indent(root)
    text: bytes = ET.tostring(root, encoding="utf-8", xml_declaration=True)
    return text + b"\n"


_READ = "the device can be read"
_EVIDENCE = "the inventory agrees with the evidence"


def junit(report: DriftReport) -> bytes:
    """Return the JUnit file; only the time the reading took varies between equal results.

    One suite per device, one case per menu. The format has no specification of its own; elements and attributes are
    those named by the manuals of Jenkins (JUnit plugin) and GitLab (Unit test reports): testsuites, testsuite,
    testcase, failure, error, skipped, system-out.
    """
    root = ET.Element("testsuites", name=f"drift of {report.site}")
    for name, result in report.devices.items():
        root.append(_suite(name, result))
    for name, why in report.skip_reasons.items():
        suite = ET.SubElement(root, "testsuite", name=name)
        case = ET.SubElement(suite, "testcase", name=_READ, classname=name, time="0")
        skip(case, why)
        count(suite)
    return render_xml(root)


def _suite(name: str, result: Mapping[str, Any]) -> ET.Element:
    suite = ET.Element("testsuite", name=name, hostname=name, time=f"{result['seconds']:.3f}")
    what = _EVIDENCE if of_evidence(result) else _READ
    case = ET.SubElement(suite, "testcase", name=what, classname=name, time=f"{result['seconds']:.3f}")
    if of_evidence(result):
        _judge_evidence(case, result)
    elif verdict(result) == "ERROR":
        add(case, "error", "error", "\n".join(filter(None, (result["message"], result["hint"]))))
    comparison = result["comparison"] or {"menus": (), "differences": (), "confirmed": None}
    for menu in comparison["menus"]:
        case = ET.SubElement(suite, "testcase", name=menu, classname=name, time="0")
        _judge(
            case,
            [difference for difference in comparison["differences"] if difference["menu"] == menu],
            comparison["confirmed"],
        )
    count(suite)
    return suite


def _judge_evidence(case: ET.Element, result: Mapping[str, Any]) -> None:
    """Add a failure if evidence contradicts the inventory; weak or missing evidence is only reported."""
    texts = [result["message"], *result["notes"]]
    if verdict(result) in {"FAIL", "ERROR"}:
        add(case, "failure", "evidence", *texts)
    elif verdict(result) != "PASS":
        add_output(case, *texts)


def _judge(case: ET.Element, differences: Sequence[Mapping[str, Any]], confirmation: Mapping[str, str] | None) -> None:
    """Add a failure for drift, a skip for secrets that cannot be compared; ignored rows are only reported."""
    drift_rows = [difference for difference in differences if difference["counts"]]
    beside = [item for item in differences if not item["counts"]]
    hidden_entries = [entry for entry in beside if entry["kind"] == "hidden"]
    if drift_rows:
        kinds = join(", ", dict.fromkeys(element["kind"] for element in drift_rows))
        add(case, "failure", kinds, *_lines(drift_rows, confirmation))
    elif hidden_entries:
        names = join(
            ", ",
            (
                msg(f"{arg(field['name'])} of {arg(row['subject'])}")
                for row in hidden_entries
                for field in row["fields"]
            ),
        )
        skip(case, msg(f"could not be compared: {arg(names)}"))
    if beside:
        add_output(case, *_lines(beside, confirmation))


def _lines(differences: Sequence[Mapping[str, Any]], confirmation: Mapping[str, str] | None) -> Iterator[str]:
    return (line for difference in differences for line in difference_lines(difference, confirmation))
