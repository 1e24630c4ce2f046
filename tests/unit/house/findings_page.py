"""docs/findings.md, made from the source: what a check, `links` and `prove` find that is not green, and what to do.

    .venv/bin/python tests/unit/house/findings_page.py     writes the page anew; a test compares

A finding's message and hint stand in one place, the code that judges. `…` stands for what is filled in.
"""

import ast
import re
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import groupby

from failure_messages import LEAST, PACKAGE, functions, inside, parse_unmarked, variants

PAGE = PACKAGE.parent / "docs" / "findings.md"
HELPERS = {"warn": "WARN", "fail": "FAIL", "unknown": "INCONCLUSIVE"}
"""Functions of the site's own checks that make a finding: code, message and hint."""
SITE_CHECKS = "checklist/probes/site_checks/"
SECTIONS = {
    SITE_CHECKS: "The site's own checks",
    "links/lte/": "4G",
    "links/satellite": "Satellite",
    "checklist/probes/satellite": "Satellite",
    "operations/allow_list_test/": "Satellite",
    "links/wifi": "Wi-Fi",
    "checklist/probes/wifi": "Wi-Fi",
    "checklist/probes/acoustic/": "Acoustic",
    "checklist/probes/usbl": "USBL",
    "checklist/probes/gps/": "GPS",
    "checklist/probes/rc_rf/": "RC RF",
    "checklist/probes/ethernet": "Ethernet",
    "checklist/probes/ping": "Ethernet",
    "checklist/probes/robot": "Robots",
    "robots/": "Robots",
}
REST = "Links, and what was not reached"
HEAD = """\
# What a check finds, and what to do

<!-- made from the source by tests/unit/house/findings_page.py: do not edit -->

What `provision check`, `links` and `prove` say of an item that is not `PASS`, and what to do about it. Search for the
words that you see; `…` stands for names and numbers. A run with a `FAIL`, an `ERROR` or something that could not be
proved ends with [exit code](exit-codes.md) 6. Where *or* stands, the program itself
chooses the advice that fits.
"""


@dataclass(frozen=True, order=True)
class FoundMessage:
    """A finding as the source makes it; no verdict where that depends on what was measured."""

    section: str
    message: str
    verdict: str
    advice: str


def findings() -> set[FoundMessage]:
    """All findings of the package that are not green and have words of their own."""
    found: set[FoundMessage] = set()
    for path in sorted(PACKAGE.rglob("*.py")):
        file = str(path.relative_to(PACKAGE))
        found.update(of_tree(parse_unmarked(path.read_text(encoding="utf-8")), file))
    return {finding for finding in found if len(re.sub(r"[^a-zA-Z]", "", finding.message)) >= LEAST}


def of_tree(tree: ast.Module, file: str) -> Iterator[FoundMessage]:
    """The findings that one file makes."""
    section = next((title for start, title in SECTIONS.items() if file.startswith(start)), REST)
    for function, _ in functions(tree):
        for call in inside(function):
            if not isinstance(call, ast.Call):
                continue
            name, given = ast.unparse(call.func).rpartition(".")[2], _arguments(call)
            if name == "LinkFinding" and "message" in given:
                verdict = _not_green(given["verdict"])
            elif name in HELPERS and file.startswith(SITE_CHECKS) and len(call.args) >= len(HELPERS):
                verdict, given = HELPERS[name], {"message": call.args[1], "hint": call.args[2]}
            else:
                continue
            if verdict is not None:
                hints = _texts(given.get("hint"), function, tree)
                messages = _texts(given["message"], function, tree)
                yield from (FoundMessage(section, text, verdict, hint) for text in messages for hint in hints)


def _arguments(call: ast.Call) -> dict[str, ast.expr]:
    """Of `LinkFinding(verdict, code, message, hint)`, by name."""
    by_place = dict(zip(("verdict", "code", "message", "hint"), call.args, strict=False))
    return by_place | {keyword.arg: keyword.value for keyword in call.keywords if keyword.arg is not None}


def _not_green(verdict: ast.expr) -> str | None:
    """The verdicts that it may have; empty where that cannot be read here, None where it is always PASS."""
    names = list(dict.fromkeys(re.findall(r"Verdict\.([A-Z]+)", ast.unparse(verdict))))
    others = [name for name in names if name != "PASS"]
    return " or ".join(others) if others or not names else None


def _texts(value: ast.expr | None, function: ast.AST, tree: ast.Module) -> list[str]:
    """As they can be read in the function, or among the names of the file."""
    if value is None or (isinstance(value, ast.Constant) and value.value is None):
        return [""]
    found = variants(value, function)
    if found == ["…"]:
        found = variants(value, tree)
    return [" ".join(text.split()) for text in found]


def page() -> str:
    """The text of the page."""
    parts = [HEAD]
    ordered = sorted(findings(), key=lambda row: (row.section == REST, row))
    for section, rows in groupby(ordered, key=lambda row: row.section):
        parts += [f"## {section}\n", "| You see | It is | What to do |", "|---|---|---|"]
        parts += [_row(text, list(same)) for text, same in groupby(rows, key=lambda row: row.message)]
        parts.append("")
    return "\n".join(parts).rstrip("\n") + "\n"


def _row(text: str, same: list[FoundMessage]) -> str:
    verdicts = " or ".join(dict.fromkeys(finding.verdict for finding in same if finding.verdict)) or "it depends"
    advice = " *or* ".join(dict.fromkeys(shown(finding.advice) for finding in same if finding.advice.strip("… ")))
    return f"| {shown(text)} | {verdicts} | {advice or 'what the message says'} |"


def shown(text: str) -> str:
    """As a cell of a table: no bar, and no mark that a page would obey outside of back-ticks."""
    pieces = text.split("`")
    marked = [piece if number % 2 else re.sub(r"([*_<>\[\]])", r"\\\1", piece) for number, piece in enumerate(pieces)]
    return "`".join(marked).replace("|", "\\|")


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
