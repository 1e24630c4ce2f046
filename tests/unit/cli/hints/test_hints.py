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


def test_register_lists_exactly_the_hints_of_the_source() -> None:
    registered = Counter(entry.hint for entry in ENTRIES)
    assert [hint for hint, number in registered.items() if number > 1] == []
    found = hints()
    assert sorted(found - set(registered)) == [], "type these in a test, and enter it in tests/data/hints.tsv"
    assert sorted(set(registered) - found) == [], "these are said no more: take them out of tests/data/hints.tsv"


@for_each_row("entry", [one for one in ENTRIES if "::" in one.test], ids=lambda one: one.hint.text[:60])
def test_registered_test_exists_and_types_the_hint(entry: Entry) -> None:
    file, _, name = entry.test.partition("::")
    assert (CHECKOUT / file).is_file(), file
    assert name in typing_tests(CHECKOUT / file)
    assert not entry.reason


def test_untested_hints_have_a_reason_and_do_not_increase() -> None:
    untyped = [entry for entry in ENTRIES if entry.test == "-"]
    assert all(entry.reason for entry in ENTRIES if "::" not in entry.test)
    assert len(untyped) == NOT_TYPED
    assert [entry.hint for entry in untyped if entry.hint.file in OF_RUNS] == []


@for_each_row("entry", [one for one in ENTRIES if one.test != "no"], ids=lambda one: one.hint.text[:60])
def test_every_command_of_a_hint_can_be_typed(entry: Entry) -> None:
    """Words and flags that the command has, and all that it needs; no `…` that nobody fills in."""
    assert untypeable(entry.hint) == []


def test_untypeable_hint_is_detected() -> None:
    for text in (
        "`provision measure satellite … --try-all`",
        "`provision links`",
        "`provision vpn renew host={}`",
        "`provision a`",
    ):
        assert untypeable(Hint("file", text)) != []


def test_hints_are_extracted_from_source() -> None:
    source = '''
class A:
    """Type `provision report runs`."""
raise X(f"{a}: `provision recover resume site={b}`" " run=1")
Word("site", "as `provision report runs` lists it")
"provision report drift"
'''
    assert list(_texts(ast.parse(source))) == ["{}: `provision recover resume site={}` run=1"]
    takes_over = "; if that run was interrupted, take over: provision recover resume site={} run={}"
    assert Hint("routeros/apply/_state.py", takes_over) in hints()
