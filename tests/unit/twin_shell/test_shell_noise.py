"""Whatever is typed, however it is cut: the console answers in its own words and shows the same."""

from __future__ import annotations

from hypothesis import given, settings
from hypothesis import strategies as st
from shell_bench import Bench

WORDS = (
    *("/ip address", "print", " ", "where", "name", "=", "~", '"', "[", "]", "find", "\\", "$x", ":put"),
    *("detail", "terse", "as-value", "count-only", "/interface", "/system/resource", "..", "/"),
    *("set 0 comment=a", "remove", "export", "/file", "proplist=name", "!", "or", "(", ";", "{", "}", ":do"),
    *("on-error=", "\r", "\n", "\t", "\x03", "\x15", "\x18", "d", "y", "\x1b[A", "\x1b[D", "\x1b[3~"),
    *("\x1b[24;80R", "é"),
)
TYPED = st.lists(st.sampled_from(WORDS), max_size=25).map("".join)
LOGINS = st.sampled_from(["admin+cet80w", "admin+ct30w5h", "admin", "fresh+cet40w", "guest+ct200w"])


def shown(login: str, text: str, *, cut: bool) -> tuple[str, str]:
    bench = Bench()
    terminal = bench.terminal(login)
    return terminal.shown() + terminal.type(text, cut=cut), bench.text()


@settings(max_examples=60)
@given(login=LOGINS, text=TYPED)
def test_the_same_whole_and_byte_by_byte(login: str, text: str) -> None:
    assert shown(login, text, cut=False) == shown(login, text, cut=True)


@settings(max_examples=60)
@given(data=st.binary(max_size=60))
def test_any_bytes(data: bytes) -> None:
    text = data.decode(errors="surrogateescape")
    assert shown("admin+ct80w", text, cut=False) == shown("admin+ct80w", text, cut=True)
