"""PyYAML's complaints in a technician's words."""

from __future__ import annotations

import yaml

from atlantis_netcfg.declaration.findings import Finding, Mark

__all__ = ["explain"]

_WORDS: tuple[tuple[str, str, str], ...] = (
    ("found a tab character", "a tab stands here", "indent with spaces"),
    (
        "mapping values are not allowed",
        "a `:` too many, or the line is indented too far",
        'quote a text that holds ": "',
    ),
    ("could not find expected ':'", "a key without `:`", "write `key: value`"),
    ("did not find expected key", "the line does not fit the block it stands in", "indent it as its neighbours are"),
    ("expected <document start>", "the line does not fit the block it stands in", "indent it as its neighbours are"),
    ("did not find expected '-' indicator", "the line does not fit the list it stands in", "begin it with `- `"),
    (
        "did not find expected ',' or '}'",
        "a `{` is not closed, or a comma is missing",
        "write {key: value, key: value}",
    ),
    ("did not find expected ',' or ']'", "a `[` is not closed, or a comma is missing", "write [value, value]"),
    ("did not find expected node content", "a value is missing here", "write the value"),
    ("unexpected end of stream", "a quote is not closed", "close the text with the quote it began with"),
    ("block sequence entries are not allowed", "a `-` stands where no list is", "put the list below its key"),
    ("but found another document", "a second `---` begins another document", "keep one `---` a file"),
    ("found undefined alias", "an alias (`*name`) is not used in an inventory", "write it out, or put it in quotes"),
    ("cannot start any token", "a text cannot begin with this character", "put the text in quotes"),
    ("while scanning an alias", "a text cannot begin with `*`", "put the text in quotes"),
    ("while scanning an anchor", "a text cannot begin with `&`", "put the text in quotes"),
    ("while scanning a tag", "a `!` begins a tag, and only `!vault` is used here", "put a text with `!` in quotes"),
    ("undefined tag handle", "a `!` begins a tag, and only `!vault` is used here", "put a text with `!` in quotes"),
    ("unknown escape character", "a backslash in double quotes begins an escape", "put the text in single quotes"),
)
_UNCLOSED = ("did not find expected ',' or", "unexpected end of stream")


def explain(error: yaml.YAMLError, shown: str, text: str) -> Finding:
    """A syntax error with its place."""
    if isinstance(error, yaml.reader.ReaderError):
        before = text[: error.position]
        mark = Mark(shown, before.count("\n") + 1, error.position - before.rfind("\n"))
        return Finding.at(mark, "a control character stands here", "delete it")
    said = str(error)
    place = _place(error, said)
    mark = Mark(shown, *_inside(text, place)) if place is not None else Mark(shown, 1, 1)
    if place is not None and _character(text, place) == "\t":
        return Finding.at(mark, "a tab stands here", "indent with spaces")
    for part, message, hint in _WORDS:
        if part in said:
            return Finding.at(mark, message, hint)
    return Finding.at(mark, "this is no YAML from here on", "compare the line and the one above with a file that works")


def _character(text: str, mark: yaml.Mark) -> str:
    line = "".join(text.splitlines()[mark.line : mark.line + 1])
    return line[mark.column : mark.column + 1]


def _place(error: yaml.YAMLError, text: str) -> yaml.Mark | None:
    """Where to look: what is not closed is best seen where it was opened."""
    opened: yaml.Mark | None = getattr(error, "context_mark", None)
    noticed: yaml.Mark | None = getattr(error, "problem_mark", None)
    return opened if any(part in text for part in _UNCLOSED) else noticed or opened


def _inside(text: str, mark: yaml.Mark) -> tuple[int, int]:
    """PyYAML may point behind the end of the file; an editor cannot go there."""
    lines = text.splitlines() or [""]
    return (mark.line + 1, mark.column + 1) if mark.line < len(lines) else (len(lines), len(lines[-1]) + 1)
