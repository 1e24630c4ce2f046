"""What every JUnit file of ours shares: clean text, counted suites, the bytes at the end."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from typing import TYPE_CHECKING

from atlantis_netcfg.core.printable import visible

if TYPE_CHECKING:
    from collections.abc import Iterable

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
