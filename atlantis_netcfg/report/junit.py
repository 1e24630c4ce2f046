"""Drift as JUnit XML, for Jenkins, GitLab and whatever else shows tests: a suite a device, a case a menu.

The format has no specification of its own; elements and attributes are those that the manuals of both name (Jenkins,
JUnit plugin; GitLab, Unit test reports): testsuites, testsuite, testcase, failure, error, skipped, system-out.
"""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from typing import TYPE_CHECKING, Any

from atlantis_netcfg.report.drift import difference_lines, verdict

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from atlantis_netcfg.report.drift import DriftReport

__all__ = ["junit"]

_NOT_XML = re.compile("[^\t\n\r\u0020-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
"""What XML 1.0 cannot hold, not even escaped (its production Char); a comment on a device may hold it."""
_READ = "the device can be read"


def junit(report: DriftReport) -> bytes:
    """Return the file; nothing in it depends on when it was written but how long the reading took."""
    root = ET.Element("testsuites", name=f"drift of {report.site}")
    for name, result in report.devices.items():
        root.append(_suite(name, result))
    for name, why in report.skipped.items():
        suite = ET.SubElement(root, "testsuite", name=name)
        case = ET.SubElement(suite, "testcase", name=_READ, classname=name, time="0")
        ET.SubElement(case, "skipped", message=_clean(why))
        _count(suite)
    _total(root)
    ET.indent(root)
    written: bytes = ET.tostring(root, encoding="utf-8", xml_declaration=True)
    return written + b"\n"


def _suite(name: str, result: Mapping[str, Any]) -> ET.Element:
    suite = ET.Element("testsuite", name=name, hostname=name, time=f"{result['seconds']:.3f}")
    case = ET.SubElement(suite, "testcase", name=_READ, classname=name, time=f"{result['seconds']:.3f}")
    if verdict(result) == "ERROR":
        _add(case, "error", "error", "\n".join(filter(None, (result["message"], result["hint"]))))
    comparison = result["comparison"] or {"menus": (), "differences": (), "confirmed": None}
    for menu in comparison["menus"]:
        case = ET.SubElement(suite, "testcase", name=menu, classname=name, time="0")
        _judge(case, [one for one in comparison["differences"] if one["menu"] == menu], comparison["confirmed"])
    _count(suite)
    return suite


def _judge(case: ET.Element, differences: Sequence[Mapping[str, Any]], confirmed: Mapping[str, str] | None) -> None:
    """Fail for drift; skip where a secret could not be compared; a row that is left alone is only told."""
    counted = [one for one in differences if one["counts"]]
    beside = [one for one in differences if not one["counts"]]
    hidden = [one for one in beside if one["kind"] == "hidden"]
    if counted:
        kinds = ", ".join(dict.fromkeys(one["kind"] for one in counted))
        _add(case, "failure", kinds, _text(counted, confirmed))
    elif hidden:
        names = ", ".join(f"{field['name']} of {one['subject']}" for one in hidden for field in one["fields"])
        ET.SubElement(case, "skipped", message=_clean(f"could not be compared: {names}"))
    if beside:
        ET.SubElement(case, "system-out").text = _clean(_text(beside, confirmed))


def _text(differences: Sequence[Mapping[str, Any]], confirmed: Mapping[str, str] | None) -> str:
    return "\n".join(line for one in differences for line in difference_lines(one, confirmed))


def _add(case: ET.Element, tag: str, kind: str, text: str) -> None:
    first = text.splitlines()[0] if text else ""
    ET.SubElement(case, tag, type=kind, message=_clean(" ".join(first.split()))).text = _clean(text)


def _clean(text: str) -> str:
    return _NOT_XML.sub("\ufffd", text)


def _count(suite: ET.Element) -> None:
    for name, tag in (("tests", "testcase"), ("failures", "failure"), ("errors", "error"), ("skipped", "skipped")):
        suite.set(name, str(len(list(suite.iter(tag)))))


def _total(root: ET.Element) -> None:
    for name in ("tests", "failures", "errors", "skipped"):
        root.set(name, str(sum(int(suite.get(name, "0")) for suite in root)))
    root.set("time", f"{sum(float(suite.get('time', '0')) for suite in root):.3f}")
