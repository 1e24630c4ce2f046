"""Whatever is done to a book, in whatever order: what is on disk is what is in hand, and what is signed verifies."""

import tempfile
from pathlib import Path

import yaml
from checklist_bench import EVERY, NAME, Desk, checklist, found, open_items, pages
from hypothesis import given, settings
from hypothesis import strategies as st

from atlantis_netcfg.checklist import Answers, ChecklistUsageError, Confirmation, last_green, verify
from atlantis_netcfg.core.errors import ExitCode, UsageError
from atlantis_netcfg.core.events import Verdict

DEEDS = st.tuples(
    st.sampled_from(["settle", "confirm", "override", "close"]), st.sampled_from(EVERY), st.sampled_from(list(Verdict))
)


def _do(desk: Desk, deeds: list[tuple[str, str, Verdict]]) -> None:
    book = desk.open()
    for deed, name, verdict in deeds:
        before = book.items
        try:
            if deed == "settle":
                book.settle(found(name, verdict))
            elif deed == "confirm":
                book.confirm(name, Confirmation(verdict, NAME, "seen so"))
            elif deed == "override":
                book.override(name, "known", NAME)
        except ChecklistUsageError:
            assert book.items == before
        if deed == "close":
            run, before = book.run, book.items
            book.close()
            book = desk.open()
            assert (book.run, book.items) == (run, before)
    waiting = [item.id for item in open_items(book)]
    document = book.sign(NAME, pages, leave=dict.fromkeys(waiting, "later"))
    book.close()
    assert verify(book.folder) == ()
    green = all(item.counts in {Verdict.PASS, Verdict.WARN, Verdict.SKIP} for item in document.items) and not waiting
    assert (document.exit is ExitCode.DONE) is (
        green and any(one.verdict is not Verdict.SKIP for one in document.items)
    )
    assert (last_green(desk.folder) is not None) is (document.exit is ExitCode.DONE)


@settings(max_examples=12)
@given(deeds=st.lists(DEEDS, max_size=12))
def test_book_is_consistent_after_any_sequence_of_actions(deeds: list[tuple[str, str, Verdict]]) -> None:
    with tempfile.TemporaryDirectory() as folder:
        _do(Desk(Path(folder) / "state"), deeds)


_SCALARS = st.sampled_from([None, True, 7, 1.5, "", "PASS", "FAIL", "x.jpg", "A. Technician", "a\nb", "\x07", *EVERY])
_KEYS = st.sampled_from(["name", "consents", "answers", "overrides", "leave", "sign"])
_INNER = st.sampled_from(["verdict", "by", "note", "files", "reason", "all", "vredict", *EVERY])
_ANYTHING = st.recursive(
    _SCALARS, lambda inner: st.lists(inner, max_size=2) | st.dictionaries(_INNER, inner, max_size=3)
)


@settings(max_examples=60)
@given(data=st.dictionaries(_KEYS, st.dictionaries(_INNER, _ANYTHING, max_size=3) | _ANYTHING))
def test_any_file_is_read_or_its_errors_are_reported(data: object) -> None:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "answers.yml"
        path.write_text(yaml.safe_dump(data))
        try:
            answers = Answers.read(path, checklist())
        except UsageError as error:
            assert "answers.yml:" in str(error)  # noqa: PT017 - most of them are wrong
            assert "is invalid" not in str(error)  # noqa: PT017 - see above
        else:
            assert all(said.by for said in answers.confirmations.values())
