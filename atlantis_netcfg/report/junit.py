"""Drift as JUnit XML, for Jenkins, GitLab and whatever else shows tests: a suite a device, a case a menu.

The format has no specification of its own; elements and attributes are those that the manuals of both name (Jenkins,
JUnit plugin; GitLab, Unit test reports): testsuites, testsuite, testcase, failure, error, skipped, system-out.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from typing import TYPE_CHECKING, Any

from atlantis_netcfg.report._xml import add, count, skip, tell, written
from atlantis_netcfg.report.drift import difference_lines, of_evidence, verdict

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from atlantis_netcfg.report.drift import DriftReport

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
