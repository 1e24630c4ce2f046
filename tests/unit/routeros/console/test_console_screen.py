"""The terminal: repainted lines, escapes in pieces, questions asked back."""

from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from atlantis_netcfg.routeros.console.terminal import TerminalScreen
from atlantis_netcfg.routeros.console.types import parse_rows

SAID = [
    (b"plain\r\ntwo", ["plain", "two"]),
    (b"\r[admin@x] > \r\x1b[K[admin@x] > /ip", ["[admin@x] > /ip"]),
    (b"abc\b\bX", ["aXc"]),
    (b"abc\x1b[2DX\x1b[K", ["aX"]),
    (b"\x1b[1;32mgreen\x1b[m\x1b7\x1b8", ["green"]),
    (b"caf\xc3\xa9 \xff", ["caf\xe9 \udcff"]),
    (b"a\x1b[3Cb", ["a   b"]),
    (b"abc\x1b[2K\rx", ["x"]),
    (b"abc\x1b[1GX", ["Xbc"]),
]


@pytest.mark.parametrize(("data", "lines"), SAID)
def test_screen_text_after_control_sequences(data: bytes, lines: list[str]) -> None:
    whole, pieces = TerminalScreen(), TerminalScreen()
    whole.feed(data)
    for byte in data:
        pieces.feed(bytes([byte]))
    assert whole.text() == pieces.text() == lines


def test_terminal_queries_of_the_device_are_answered() -> None:
    screen = TerminalScreen()
    screen.feed(b"\x1b[9999C\x1b[6n\x1bZ")
    assert screen.replies == b"\x1b[1;511R\x1b[?1;2c"


@given(st.binary(max_size=200), st.lists(st.integers(0, 200), max_size=5))
def test_chunking_makes_no_difference(data: bytes, cuts: list[int]) -> None:
    whole, pieces = TerminalScreen(), TerminalScreen()
    whole.feed(data)
    places = [0, *sorted(cut for cut in cuts if cut < len(data)), len(data)]
    for start, end in pairwise(places):
        pieces.feed(data[start:end])
    assert whole.lines == pieces.lines
    assert whole.replies == pieces.replies


@pytest.mark.parametrize(
    ("text", "rows"),
    [
        ("", []),
        ("mode=home;flagged=false", [{"mode": "home", "flagged": "false"}]),
        (".id=*1;name=a;.id=*2;name=", [{".id": "*1", "name": "a"}, {".id": "*2", "name": ""}]),
        (".id=*1;comment=1 = 2;policy=read;write", [{".id": "*1", "comment": "1 = 2", "policy": "read;write"}]),
    ],
)
def test_rows_are_parsed(text: str, rows: list[dict[str, str]]) -> None:
    assert parse_rows(text) == rows
