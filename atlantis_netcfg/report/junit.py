"""Drift as JUnit XML, for Jenkins, GitLab and whatever else shows tests: a suite a device, a case a menu.

The format has no specification of its own; elements and attributes are those that the manuals of both name (Jenkins,
JUnit plugin; GitLab, Unit test reports): testsuites, testsuite, testcase, failure, error, skipped, system-out.

What every JUnit file of ours shares: clean text, counted suites, the bytes at the end.
"""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from typing import TYPE_CHECKING, Any

from atlantis_netcfg.core.printable import visible
from atlantis_netcfg.report.drift import DriftReport, difference_lines, of_evidence, verdict

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping, Sequence


_NOT_XML = re.compile("[^\t\n\r\u0020-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
"""What XML 1.0 cannot hold, not even escaped (its production Char); a comment on a device may hold it."""


def clean(text: str) -> str:
    """Text that XML can hold, and that shows every character: what cannot be seen is written out."""
    return _NOT_XML.sub("\ufffd", visible(text.expandtabs(1)))


def add(case: ET.Element, tag: str, kind: str, *texts: str) -> None:
    """Put a failure or an error into a case: its first line as the message, all of it as the text."""
    first = next((line for text in texts for line in text.splitlines()), "")
    ET.SubElement(case, tag, type=kind, message=clean(" ".join(first.split()))).text = _joined(texts)


def skip(case: ET.Element, why: str) -> None:
    """Say that a case was not run."""
    ET.SubElement(case, "skipped", message=clean(why))


def tell(case: ET.Element, *texts: str) -> None:
    """Put words beside a case that do not judge it."""
    ET.SubElement(case, "system-out").text = _joined(texts)


def _joined(texts: Iterable[str]) -> str:
    """One below the other, each cleaned before: a carriage return at the end would be lost with the line feed."""
    return "\n".join(map(clean, texts))


def count(suite: ET.Element) -> None:
    """Write the numbers of a suite, from its cases."""
    for name, tag in (("tests", "testcase"), ("failures", "failure"), ("errors", "error"), ("skipped", "skipped")):
        suite.set(name, str(len(list(suite.iter(tag)))))


def total(root: ET.Element) -> None:
    """Write the numbers of the whole, from its suites."""
    for name in ("tests", "failures", "errors", "skipped"):
        root.set(name, str(sum(int(suite.get(name, "0")) for suite in root)))
    root.set("time", f"{sum(float(suite.get('time', '0')) for suite in root):.3f}")


def written(root: ET.Element) -> bytes:
    """The file."""
    total(root)
    ET.indent(root)
    text: bytes = ET.tostring(root, encoding="utf-8", xml_declaration=True)
    return text + b"\n"


_READ = "the device can be read"
_EVIDENCE = "what is declared agrees with the evidence"


def junit(report: DriftReport) -> bytes:
    """Return the file; nothing in it depends on when it was written but how long the reading took."""
    root = ET.Element("testsuites", name=f"drift of {report.site}")
    for name, result in report.devices.items():
        root.append(_suite(name, result))
    for name, why in report.skipped.items():
        suite = ET.SubElement(root, "testsuite", name=name)
        case = ET.SubElement(suite, "testcase", name=_READ, classname=name, time="0")
        skip(case, why)
        count(suite)
    return written(root)


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
    """Fail for evidence that contradicts the declaration; what is weak or missing is only told."""
    texts = [result["message"], *result["notes"]]
    if verdict(result) in {"FAIL", "ERROR"}:
        add(case, "failure", "evidence", *texts)
    elif verdict(result) != "PASS":
        tell(case, *texts)


def _judge(case: ET.Element, differences: Sequence[Mapping[str, Any]], confirmed: Mapping[str, str] | None) -> None:
    """Fail for drift; skip where a secret could not be compared; a row that is left alone is only told."""
    counted = [difference for difference in differences if difference["counts"]]
    beside = [item for item in differences if not item["counts"]]
    hidden = [entry for entry in beside if entry["kind"] == "hidden"]
    if counted:
        kinds = ", ".join(dict.fromkeys(element["kind"] for element in counted))
        add(case, "failure", kinds, *_lines(counted, confirmed))
    elif hidden:
        names = ", ".join(f"{field['name']} of {row['subject']}" for row in hidden for field in row["fields"])
        skip(case, f"could not be compared: {names}")
    if beside:
        tell(case, *_lines(beside, confirmed))


def _lines(differences: Sequence[Mapping[str, Any]], confirmed: Mapping[str, str] | None) -> Iterator[str]:
    return (line for difference in differences for line in difference_lines(difference, confirmed))
