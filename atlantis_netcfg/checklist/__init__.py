"""The pre-test checklist of a site: required checks, their results, who confirmed them, and who signs.

The list is computed from the inventory alone, and no X of Table 3 can be omitted: what no program can check, a person
confirms. Results are stored line by line on disk, so that an interrupted checklist can be continued. The closed list is
signed in full by a named person, and anybody who has it can verify it.
"""

from __future__ import annotations

from atlantis_netcfg.checklist._opening import BookHead
from atlantis_netcfg.checklist._signing import FILE as KEY
from atlantis_netcfg.checklist._signing import ChecklistUsageError, SigningError, SigningKeyError
from atlantis_netcfg.checklist.answers import Answers, AnswersInvalid, Overriding
from atlantis_netcfg.checklist.confirmations import Confirmation
from atlantis_netcfg.checklist.history import (
    SavedChecklist,
    VehicleState,
    books,
    changes,
    compare_with_green,
    filter_by_scope,
    last_green,
)
from atlantis_netcfg.checklist.plan import Checklist, PlanEntry, Scope, plan
from atlantis_netcfg.checklist.session import ChecklistSession
from atlantis_netcfg.checklist.verify import SigningTrouble, verify, verify_report

__all__ = [
    "KEY",
    "Answers",
    "AnswersInvalid",
    "BookHead",
    "Checklist",
    "ChecklistSession",
    "ChecklistUsageError",
    "Confirmation",
    "Overriding",
    "PlanEntry",
    "SavedChecklist",
    "Scope",
    "SigningError",
    "SigningKeyError",
    "SigningTrouble",
    "VehicleState",
    "books",
    "changes",
    "compare_with_green",
    "filter_by_scope",
    "last_green",
    "plan",
    "verify",
    "verify_report",
]
