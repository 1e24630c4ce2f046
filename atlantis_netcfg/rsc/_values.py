r"""Values as export text prints them: bare when RouterOS prints them bare, else in double quotes with escapes.

A value on the device is a string of bytes. Here it is text: bytes that are UTF-8 are decoded, any other byte (a comment
typed in a Windows code page) survives as a lone surrogate (`surrogateescape`), so that nothing is lost between device
and file. Source of the escapes: manual, Scripting, "Constant Escape Sequences"; of the bare characters: public exports
of RouterOS 6 and 7.
"""

from __future__ import annotations

import re

ENCODING = "utf-8"
ERRORS = "surrogateescape"

_PLAIN = re.compile(r"[ !#%->@-\[\]-~]*")
"""What stands in quotes as it is."""
_BARE = re.compile(r"[0-9A-Za-z!#%*+,\-./:<>@_~]+")

_NAMED = {'"': '\\"', "\\": "\\\\", "$": "\\$", "?": "\\?", "\n": "\\n", "\r": "\\r", "\t": "\\t"}
_ESCAPES = {
    **{escape[1]: value for value, escape in _NAMED.items()},
    "_": " ",
    "a": "\a",
    "b": "\b",
    "f": "\f",
    "v": "\v",
}
_ESCAPE = re.compile(r"\\([0-9A-F]{2}|[\s\S])")
_HEX = re.compile(r"[0-9A-F]{2}")
_QUOTED = re.compile(r'"(?:[^"\\]|\\[\s\S])*"')
_FIRST_PRINTABLE, _LAST_PRINTABLE = " ", "~"


def quote(value: str) -> str:
    """Print `value` as RouterOS' `export` does; a script may assign the text as it stands."""
    return value if _BARE.fullmatch(value) else in_quotes(value)


def in_quotes(value: str) -> str:
    """Print `value` in quotes, also where a bare one would do."""
    return f'"{value if _PLAIN.fullmatch(value) else "".join(map(_escaped, value))}"'


def _escaped(char: str) -> str:
    if char in _NAMED:
        return _NAMED[char]
    if _FIRST_PRINTABLE <= char <= _LAST_PRINTABLE:
        return char
    return "".join(f"\\{byte:02X}" for byte in char.encode(ENCODING, ERRORS))


class ValueTextError(ValueError):
    """A value that cannot be read; the text is for a person, `offset` counts the characters before the mistake."""

    def __init__(self, message: str, offset: int) -> None:
        super().__init__(message)
        self.offset = offset


def unquote(text: str) -> str:
    """Read one value of export text, quoted or bare. The text of a ValueError says what is wrong, for a person."""
    if not text.startswith('"'):
        return _bare(text)
    if len(text) == 1 or not _QUOTED.fullmatch(text):
        raise ValueTextError("the text must end with the one quote that closes it", len(text) - 1)
    raw = _ESCAPE.sub(_unescape, text[1:-1])
    return raw.encode(ENCODING, ERRORS).decode(ENCODING, ERRORS)


def _bare(text: str) -> str:
    for offset, char in enumerate(text):
        if char in '"\\$' or not "!" <= char <= "~":
            raise ValueTextError(f"{char} may only stand inside quotes", offset)
    return text


def _unescape(match: re.Match[str]) -> str:
    code = match[1]
    if code in _ESCAPES:
        return _ESCAPES[code]
    if _HEX.fullmatch(code):
        return bytes([int(code, 16)]).decode(ENCODING, ERRORS)
    raise ValueTextError(f"\\{code} is not an escape that RouterOS knows", match.start() + 1)
