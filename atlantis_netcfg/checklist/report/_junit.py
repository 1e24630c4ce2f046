"""The checklist as JUnit XML: one suite per row, one case per item. What prevents a green checklist fails.

FAIL, INCONCLUSIVE and open items are failures, ERROR is an error, SKIP is skipped with its reason. An item that a
person has overridden passes, with name and reason in `system-out`. A checklist in which nothing was checked has an
error of its own.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from typing import TYPE_CHECKING

from atlantis_netcfg.checklist.report import _shapes, _words
from atlantis_netcfg.core.errors import ExitCode
from atlantis_netcfg.core.messages import arg, msg
from atlantis_netcfg.runs.report import drift, signs

if TYPE_CHECKING:
    from collections.abc import Iterator

    from atlantis_netcfg.checklist.report.document import Document, Item

_FAILURES = frozenset({signs.ShownState.FAIL, signs.ShownState.INCONCLUSIVE, signs.ShownState.OPEN})


def junit(document: Document) -> bytes:
    """Return the file; the same document always gives the same bytes."""
    rehearsal_note = ", rehearsal: nothing real was checked" if document.rehearsed else ""
    root = ET.Element("testsuites", name=drift.clean(f"checklist of {document.site}{rehearsal_note}"))
    root.append(_checklist_suite(document))
    for row in _shapes.grid(document).rows:
        if row.items:
            root.append(_suite(row.row.key, row.items))
    if document.left_out:
        root.append(_left_out(document))
    return drift.render_xml(root)


def _checklist_suite(document: Document) -> ET.Element:
    suite = ET.Element("testsuite", name="checklist", time="0")
    case = ET.SubElement(suite, "testcase", name="something was checked", classname="checklist", time="0")
    if document.exit is ExitCode.NOTHING:
        drift.add(case, "error", "NOTHING", "nothing was checked: all items are skipped")
    drift.add_output(
        case,
        msg(f"run {arg(document.run)}"),
        _words.closing(document, _words.english),
        _words.signature_line(document),
        *document.notes,
    )
    drift.count(suite)
    return suite


def _suite(key: str, items: tuple[Item, ...]) -> ET.Element:
    seconds = sum(item.seconds or 0 for item in items)
    suite = ET.Element("testsuite", name=drift.clean(key), time=f"{seconds:.3f}")
    for item in items:
        attributes = {"name": drift.clean(item.id), "classname": drift.clean(key), "time": f"{item.seconds or 0:.3f}"}
        _judge(ET.SubElement(suite, "testcase", attributes), item)
    drift.count(suite)
    return suite


def _judge(case: ET.Element, item: Item) -> None:
    shown_state = _shapes.state(item)
    words = filter(None, (item.message, item.hint))
    if shown_state in _FAILURES:
        drift.add(case, "failure", str(shown_state), *words)
    elif shown_state is signs.ShownState.ERROR:
        drift.add(case, "error", str(shown_state), *words)
    elif shown_state is signs.ShownState.SKIP:
        drift.skip(case, item.message)
    drift.add_output(case, *_item_lines(item))


def _item_lines(item: Item) -> Iterator[str]:
    yield msg(f"{arg(item.verdict)}: {arg(item.title)}")
    yield item.message
    if item.override is not None:
        yield msg(f"OVERRIDDEN by {arg(item.override.by)}: {arg(item.override.reason)}")
    yield from (msg(f"{arg(finding.verdict)} {arg(finding.code)}: {arg(finding.message)}") for finding in item.findings)
    yield from map(_words.evidence_words, item.evidence)


def _left_out(document: Document) -> ET.Element:
    suite = ET.Element("testsuite", name="left out", time="0")
    for item in document.left_out:
        case = ET.SubElement(suite, "testcase", name=drift.clean(item.what), classname="excluded", time="0")
        drift.skip(case, item.why)
    drift.count(suite)
    return suite
