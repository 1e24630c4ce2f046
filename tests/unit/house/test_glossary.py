"""docs/glossary.md lists each word once, in order, and where it stands exists."""

import re
from pathlib import Path

from atlantis_netcfg.core.events import Verdict

ROOT = Path(__file__).parents[3]
PAGE = (ROOT / "docs" / "glossary.md").read_text(encoding="utf-8")
ROWS = re.findall(r"^\| ([^|]+) \| ([^|]+) \| ([^|]+) \|$", PAGE, re.MULTILINE)[1:]


def test_terms_are_unique_and_sorted() -> None:
    terms = [term.lower().replace("-", " ") for term, _, _ in ROWS]
    assert len(terms) > 50
    assert terms == sorted(set(terms))


def test_referenced_files_exist() -> None:
    places = [place for _, _, where in ROWS for place in re.findall(r"`([^`]+)`", where)]
    assert len(places) >= len(ROWS)
    assert [
        place for place in places if not (ROOT / "atlantis_netcfg" / place).exists() and not (ROOT / place).exists()
    ] == []


def test_every_verdict_is_explained() -> None:
    meaning = next(meaning for term, meaning, _ in ROWS if term == "verdict")
    assert [verdict for verdict in Verdict if f"{verdict}:" not in meaning] == []
