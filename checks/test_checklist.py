"""The pre-test checklist of the site, one test an item: what a program sees is asked once, all of it at the same time.

What is inconclusive fails as well: a test in which nothing was seen is not green. What a person has to answer is taken
from the checklist that `provision check` keeps; where nobody has answered yet, its test is skipped with that reason.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from atlantis_netcfg.core.events import Verdict

if TYPE_CHECKING:
    from atlantis_netcfg.checklist.report import Item

pytestmark = pytest.mark.timeout(3600)
"""The first test waits for all questions of the site, over a link that may be silent for a minute."""
_WELL = frozenset({Verdict.PASS, Verdict.WARN})


def test_item(found: Item) -> None:
    if found.counts not in _WELL:
        hint = f"\n-> {found.hint}" if found.hint else ""
        pytest.fail(f"{found.verdict}: {found.message}{hint}", pytrace=False)
