"""Every hint that names a command is typed by a test, in the situation in which it is given."""

import ast
from collections import Counter

from hints_said import CHECKOUT, Entry, Hint, _texts, hints, register, typing_tests, untypeable
from row_subtests import for_each_row

ENTRIES = register()
NOT_TYPED = 0
"""So many hints are typed by no test yet. It may only fall."""
OF_RUNS = (
    *("cli/devices.py", "cli/recovery/resume.py", "cli/recovery/rollback.py", "cli/runs.py", "runs/run.py"),
    *("operations/restore.py", "operations/common/saved_states.py"),
    *("routeros/apply/_state.py", "routeros/apply/_settle.py"),
)
"""Whoever reads these has a device that is open: none of them may be left untyped."""


def test_every_hint_of_the_source_is_in_the_register_and_no_other() -> None:
    registered = Counter(entry.hint for entry in ENTRIES)
    assert [hint for hint, number in registered.items() if number > 1] == []
    found = hints()
    assert sorted(found - set(registered)) == [], "type these in a test, and enter it in tests/data/hints.tsv"
    assert sorted(set(registered) - found) == [], "these are said no more: take them out of tests/data/hints.tsv"


@for_each_row("entry", [one for one in ENTRIES if "::" in one.test], ids=lambda one: one.hint.text[:60])
def test_the_test_that_is_named_types_what_was_advised(entry: Entry) -> None:
    file, _, name = entry.test.partition("::")
    assert (CHECKOUT / file).is_file(), file
    assert name in typing_tests(CHECKOUT / file)
    assert not entry.reason


def test_what_is_not_typed_yet_has_a_reason_and_becomes_less() -> None:
    untyped = [entry for entry in ENTRIES if entry.test == "-"]
    assert all(entry.reason for entry in ENTRIES if "::" not in entry.test)
    assert len(untyped) == NOT_TYPED
    assert [entry.hint for entry in untyped if entry.hint.file in OF_RUNS] == []


@for_each_row("entry", [one for one in ENTRIES if one.test != "no"], ids=lambda one: one.hint.text[:60])
def test_every_command_of_a_hint_is_one_that_can_be_typed(entry: Entry) -> None:
    """Words and flags that the command has, and all that it needs; no `…` that nobody fills in."""
    assert untypeable(entry.hint) == []


def test_what_cannot_be_typed_is_noticed() -> None:
    for text in (
        "`provision prove … --try-all`",
        "`provision links`",
        "`provision vpn renew host={}`",
        "`provision a`",
    ):
        assert untypeable(Hint("file", text)) != []


def test_what_is_a_hint() -> None:
    source = '''
class A:
    """Type `provision runs`."""
raise X(f"{a}: `provision resume site={b}`" " run=1")
Word("site", "as `provision runs` lists it")
"provision drift"
'''
    assert list(_texts(ast.parse(source))) == ["{}: `provision resume site={}` run=1"]
    takes_over = "; if that run has died, take over: provision resume site={} run={}"
    assert Hint("routeros/apply/_state.py", takes_over) in hints()
