r"""Safe text for terminals and pages: control, hidden and direction-changing characters are escaped.

Every stream of the command line is a `Printer`, so that text of a device, a file or a person cannot bypass it. Escapes
have the form of JSON (backslash, `u` and four hex digits), so that one filter serves both.
"""

from __future__ import annotations

import codecs
import os
import re
import unicodedata
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from enum import Enum
from typing import Any, Protocol

_UNSEEN = re.compile(
    "[\0-\x08\x0b-\x1f\x7f-\x9f\xad\u061c\u180e\u200b\u200e\u200f\u2028-\u202e\u2060-\u206f\ud800-\udfff\ufeff\ufff9-\ufffb"
    "\U0001bca0-\U0001bca3\U0001d173-\U0001d17a\U000e0000-\U000e007f]"
)
"""Control characters except tab and line feed, and characters that hide or reverse adjacent text."""
_BMP = 0xFFFF
_CODE = re.compile(r"`([^`\s](?:[^`\n]*[^`\s])?)`")


def line(text: str) -> str:
    """Escape unprintable characters in a text of one line."""
    return text if text.isprintable() else "".join(item if item.isprintable() else _escape(item) for item in text)


def lines(text: str) -> str:
    """Escape unprintable characters, but keep line feeds."""
    return "\n".join(map(line, text.split("\n")))


def below(text: str, column: int) -> str:
    """Indent the second and later lines to a column."""
    return text.replace("\n", f"\n{'':<{column}}")


def clean(value: Any) -> Any:  # noqa: ANN401 - JSON of any shape
    """Escape all text in data for another program that prints it, such as Ansible."""
    if isinstance(value, str):
        return lines(value)
    if isinstance(value, Mapping):
        return {line(key) if isinstance(key, str) else key: clean(entry) for key, entry in value.items()}
    return [clean(item) for item in value] if isinstance(value, list | tuple) else value


def _escape(character: str) -> str:
    code = ord(character)
    if code <= _BMP:
        return f"\\u{code:04x}"
    high, low = divmod(code - _BMP - 1, 0x400)
    return f"\\u{0xD800 + high:04x}\\u{0xDC00 + low:04x}"


def visible(text: str) -> str:
    """Write invisible characters as `U+202E` in a text for a page."""
    return _UNSEEN.sub(lambda match: f"U+{ord(match[0]):04X}", text.replace("\r\n", "\n"))


class _PrintableStream(Protocol):
    def write(self, text: str, /) -> int:
        """Write."""


class Printer:
    """A text stream that escapes every control character except the line feed."""

    def __init__(self, stream: _PrintableStream) -> None:
        self.stream = stream
        """Underlying stream, for code that draws on the terminal and filters its text itself."""

    def write(self, text: str, /) -> int:
        """Write the escaped text, on a terminal wrapped between words; return the length of the original."""
        self.stream.write(wrap_lines(lines(text), width_of(self.stream)))
        return len(text)

    def writelines(self, texts: Any, /) -> None:  # noqa: ANN401 - any iterable of texts
        """Write all texts."""
        for text in texts:
            self.write(text)

    def __getattr__(self, name: str) -> Any:  # noqa: ANN401 - whatever the stream has
        return getattr(self.stream, name)


def width_of(stream: Any) -> int:  # noqa: ANN401 - any text stream
    """Return the columns of a terminal, or `COLUMNS`, or 80 if neither is known; 0 for any other stream."""
    try:
        if not stream.isatty():
            return 0
        columns = os.environ.get("COLUMNS", "")
        size = int(columns) if columns.isdecimal() else 0
        return size or os.get_terminal_size(stream.fileno()).columns or NARROW
    except (AttributeError, OSError, ValueError):
        return 0


ASCII = "atlantis-ascii"
"""Error handler for streams limited to ASCII: the letter without accent, a similar character, or `?`."""
_NEAREST = {"…": "...", "–": "-", "—": "-", "’": "'", "‘": "'", "“": '"', "”": '"', "«": '"', "»": '"', "→": "->"}  # noqa: RUF001 - as people type them


def _to_ascii(error: UnicodeError) -> tuple[str, int]:
    if not isinstance(error, UnicodeEncodeError):
        raise error
    pieces = []
    for letter in error.object[error.start : error.end]:
        base = unicodedata.normalize("NFKD", letter).encode("ascii", "ignore").decode()
        pieces.append(_NEAREST.get(letter) or base or "?")
    return "".join(pieces), error.end


codecs.register_error(ASCII, _to_ascii)


class Style(Enum):
    """Meaning of a colour, always repeated by a word or symbol; the value is the SGR code."""

    GOOD = "32"
    WARNING = "33"
    BAD = "31"
    ADDITION = "32;1"
    REMOVAL = "31;1"
    TITLE = "1"
    QUIET = "2"


@dataclass(frozen=True, slots=True)
class StyledText:
    """A styled piece of a line."""

    text: str
    style: Style


Row = str | StyledText | tuple[str | StyledText, ...]
"""A line for `show`: text, or a tuple of pieces."""


NARROW = 80
"""Width in columns of the narrowest common terminal."""


def plain(row: Row) -> str:
    """Return the text of a line without styles."""
    pieces = row if isinstance(row, tuple) else (row,)
    return "".join(piece if isinstance(piece, str) else piece.text for piece in pieces)


_NO_BREAK = "\xa0"
_COMMAND = re.compile(r"`[^`]*`")
_SHELL_WORD = re.compile(r"'[^']*'")


def fill(text: str, width: int, indent: str = "", together: re.Pattern[str] = _COMMAND) -> list[str]:
    """Wrap text without breaking words or what matches `together`: commands between back quotes."""
    from textwrap import wrap  # noqa: PLC0415 - not needed where every line is short

    unbroken = together.sub(lambda match: match[0].replace(" ", _NO_BREAK), text)
    parts = wrap(unbroken, width, subsequent_indent=indent, break_long_words=False, break_on_hyphens=False)
    return [part.replace(_NO_BREAK, " ") for part in parts]


def fill_command(command: str, width: int) -> list[str]:
    """Wrap a command so that a shell accepts it as pasted: lines but the last end with a backslash."""
    *first, last = fill(command, width - 2, together=_SHELL_WORD)
    return [*(f"{line} \\" for line in first), last]


def wrap_lines(text: str, width: int) -> str:
    """Wrap the lines longer than `width` columns (0: unlimited), each at its own indent."""
    if not width or all(len(line) <= width for line in text.split("\n")):
        return text
    return "\n".join(part for line in text.split("\n") for part in _wrap_line(line, width))


def _wrap_line(line: str, width: int) -> list[str]:
    words = line.lstrip()
    indent = line[: len(line) - len(words)]
    if len(line) <= width or not words or words[0] in '"{[':  # JSON stays as it is
        return [line]
    if re.match(r"(?:\./)?provision ", words):
        return [f"{indent}{part}" for part in fill_command(words, width - len(indent))]
    return fill(line, width, indent)


def wrap_row(row: Row, width: int, indent: int) -> list[Row]:
    """Wrap a line between words to `width` columns (0: unlimited); longer words are not split.

    All lines but the first begin at column `indent`.
    """
    if not width or all(len(line) <= width for line in plain(row).split("\n")):
        return [row]
    pieces = row if isinstance(row, tuple) else (row,)
    result: list[list[str | StyledText]] = [[]]
    used = 0
    for piece in pieces:
        text = piece if isinstance(piece, str) else piece.text
        for word in re.findall(r"\n *|[^\s]+|[^\S\n]+", text):
            if word.startswith("\n") or (used + len(word) > width and used > indent):
                result.append([" " * indent])
                used = indent
                if word.isspace():
                    continue
            result[-1].append(word if isinstance(piece, str) else StyledText(word, piece.style))
            used += len(word)
    return [_without_blanks(line) for line in result]


def _without_blanks(pieces: list[str | StyledText]) -> Row:
    """Remove trailing blanks: in the last column they would wrap to an extra line."""
    while len(pieces) > 1 and not plain((pieces[-1],)).strip():
        pieces.pop()
    return tuple(pieces)


def split_code(text: str) -> list[tuple[str, bool]]:
    """Split text into pieces; those between back-ticks are code (True), without the back-ticks."""
    return [(piece, bool(number % 2)) for number, piece in enumerate(_CODE.split(text)) if piece]


def shows_colour(stream: Any, environment: Mapping[str, str] = os.environ) -> bool:  # noqa: ANN401 - any text stream
    """Return whether a stream shows colours: a terminal that supports them, and `NO_COLOR` is not set."""
    return bool(stream.isatty()) and not environment.get("NO_COLOR") and environment.get("TERM", "dumb") != "dumb"


def paint(rows: Iterable[Row], *, colour: bool) -> str:
    """Render lines for a terminal, with or without colours; all texts are escaped."""
    return "".join(
        "".join(_paint_piece(piece, colour=colour) for piece in (row if isinstance(row, tuple) else (row,))) + "\n"
        for row in rows
    )


def show(rows: Iterable[Row], stream: Any) -> None:  # noqa: ANN401 - any text stream
    """Write lines, coloured where the stream shows colours; on a terminal wrapped between words."""
    width = width_of(stream)
    pieces = (part for row in rows for part in _wrap_own(row, width))
    getattr(stream, "stream", stream).write(paint(pieces, colour=shows_colour(stream)))
    stream.flush()


def _wrap_own(row: Row, width: int) -> Iterable[Row]:
    """Wrap a line at its own indent; a command so that it can be pasted."""
    if isinstance(row, str):
        return wrap_lines(row, width).split("\n")
    return wrap_row(row, width, len(plain(row)) - len(plain(row).lstrip()))


def _paint_piece(piece: str | StyledText, *, colour: bool) -> str:
    if isinstance(piece, str):
        return lines(piece)
    text = lines(piece.text)
    return f"\x1b[{piece.style.value}m{text}\x1b[0m" if colour and text else text
