r"""Physical lines to logical ones: `\` at a line's end joins the next, whose indent is dropped, also inside quotes."""

from __future__ import annotations

from bisect import bisect_right
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from atlantis_netcfg.rsc._model import RscError

if TYPE_CHECKING:
    from collections.abc import Iterator

__all__ = ["LogicalLine", "logical_lines"]

_INDENT = " \t"


@dataclass(slots=True)
class LogicalLine:
    """One statement, menu or comment, unwrapped, that still knows where each of its characters stood."""

    source: str
    text: str = ""
    _parts: list[tuple[int, int, int]] = field(default_factory=list)
    """(offset in `text`, line, column of that offset), ascending."""

    @property
    def line(self) -> int:
        """The line on which it starts, 1-based."""
        return self._parts[0][1]

    @property
    def is_comment(self) -> bool:
        """True if the device ignores it."""
        return self.text.startswith("#")

    def append(self, text: str, line: int, column: int) -> None:
        """Join one more physical line, which stands at that place."""
        self._parts.append((len(self.text), line, column))
        self.text += text

    def error(self, offset: int, message: str, *, hint: str | None = None) -> RscError:
        """Make the error for the character at `offset`, placed where the person sees it."""
        start, line, column = self._parts[bisect_right(self._parts, offset, key=lambda part: part[0]) - 1]
        return RscError(message, source=self.source, line=line, column=column + offset - start, hint=hint)


def logical_lines(text: str, source: str) -> Iterator[LogicalLine]:
    """Yield the lines of `text` without indent and line ends (LF or CRLF); empty ones too, as they end a header."""
    current: LogicalLine | None = None
    for number, physical in enumerate(text.removeprefix("\ufeff").removesuffix("\n").split("\n"), start=1):
        content = physical.removesuffix("\r").lstrip(_INDENT)
        column = len(physical.removesuffix("\r")) - len(content) + 1
        joined = current or LogicalLine(source)
        wrapped = _is_wrapped(content) and not (current is None and content.startswith("#"))
        joined.append(content[:-1] if wrapped else content, number, column)
        current = joined if wrapped else None
        if not wrapped:
            yield joined
    if current is not None:
        raise current.error(
            len(current.text),
            "the text ends in the middle of a statement, because its last line ends with \\",
            hint="copy the whole export, or delete that \\",
        )


def _is_wrapped(content: str) -> bool:
    return (len(content) - len(content.rstrip("\\"))) % 2 == 1
