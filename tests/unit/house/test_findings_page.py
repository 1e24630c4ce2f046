"""docs/findings.md is what the source says: each finding that is not green has its row there."""

import ast
import re

from findings_page import PAGE, FoundMessage, findings, of_tree, page

MADE = "it is not what the source says any more; type: .venv/bin/python tests/unit/house/findings_page.py"


def test_page_is_generated_from_the_current_source() -> None:
    assert PAGE.read_text(encoding="utf-8") == page(), MADE


def test_each_row_is_complete() -> None:
    rows = [line for line in page().splitlines() if line.startswith("| ") and not line.startswith("| You see")]
    assert len(rows) > 300
    assert [row for row in rows if len(re.split(r"(?<!\\)\|", row)) != 5 or row.count("`") % 2] == []
    assert {finding.verdict for finding in findings()} >= {"WARN", "FAIL", "INCONCLUSIVE"}


SOURCE = """
_LOOK = "look at it"
def judge(name, is_bad):
    verdict = Verdict.FAIL
    yield LinkFinding(Verdict.PASS, "well", "all is well")
    yield LinkFinding(Verdict.FAIL if is_bad else Verdict.WARN, "weak", f"{name} is too weak", _LOOK)
    yield LinkFinding(verdict, "odd", "this is odd", hint=f"ask {name}")
    yield fail("gone", f"{name} has gone", "fetch it")
"""


def test_findings_are_extracted_from_source() -> None:
    tree = ast.parse(SOURCE)
    assert sorted(of_tree(tree, "links/wifi.py")) == [
        FoundMessage("Wi-Fi", "this is odd", "", "ask …"),
        FoundMessage("Wi-Fi", "… is too weak", "FAIL or WARN", "look at it"),
    ]
    site_checks = sorted(of_tree(tree, "checklist/probes/site_checks/clock.py"))
    assert site_checks[-2] == FoundMessage("The site's own checks", "… has gone", "FAIL", "fetch it")
