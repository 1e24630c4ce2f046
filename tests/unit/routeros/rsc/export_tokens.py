"""What an export says, read a second time by rules of its own, so that our parser is not compared with itself.

Lines are joined, cut into words at spaces outside quotes and brackets, and values are turned into the bytes that the
device holds. Nothing is known of menus; a path ends at the first word that is a command.
"""

import re
from dataclasses import dataclass, field

_FOLD = re.compile(r"\\\n[ \t]*")
_COMMANDS = {"add", "set", "reset", "remove", "move", "enable", "disable", "unset", "edit", "print", "comment"}
_ESCAPE = re.compile(rb"\\([0-9A-F]{2}|.)", re.DOTALL)
_NAMED = {b"n": b"\n", b"r": b"\r", b"t": b"\t", b"_": b" ", b"a": b"\a", b"b": b"\b", b"f": b"\f", b"v": b"\v"}
_ELIDED = re.compile(r"(\.?)([A-Za-z0-9_/.-]+)(=?)(.*)", re.DOTALL)

Word = tuple[str, bytes | None]


@dataclass(slots=True)
class Told:
    """Everything that a text tells a device and its reader."""

    menus: list[str] = field(default_factory=list)
    """Each once, in the order in which they are opened first."""
    rows: list[tuple[str, tuple[Word, ...]]] = field(default_factory=list)
    comments: list[str] = field(default_factory=list)


def told(text: str) -> Told:
    """Read a whole export."""
    found, menu = Told(), ""
    for line in _joined(text):
        if line.startswith("#"):
            found.comments.append(line[1:].strip())
            continue
        words = cut(line)
        if words[0].startswith("/"):
            path = [part for part in words[0].split("/") if part]
            rest = words[1:]
            while path[-1:] and path[-1] not in _COMMANDS and rest and rest[0] not in _COMMANDS and "=" not in rest[0]:
                path.append(rest.pop(0))
            if path[-1:] and path[-1] in _COMMANDS:
                rest.insert(0, path.pop())
            here = "/" + "/".join(path)
        else:
            here, rest = menu, words
        if here not in found.menus:
            found.menus.append(here)
        if rest:
            found.rows.append((here, meanings(rest)))
        else:
            menu = here
    return found


def _joined(text: str) -> list[str]:
    """Return logical lines; a comment line never goes on."""
    kept: list[str] = []
    rest = text.removeprefix("\ufeff").replace("\r\n", "\n")
    while rest:
        line, _, rest = rest.partition("\n")
        while not line.lstrip().startswith("#") and _ends_open(line) and rest:
            following, _, rest = rest.partition("\n")
            line = line[:-1] + following.lstrip(" \t")
        if line.strip():
            kept.append(line.strip(" \t"))
    return kept


def _ends_open(line: str) -> bool:
    return (len(line) - len(line.rstrip("\\"))) % 2 == 1


def cut(line: str) -> list[str]:
    """Cut a line into words; brackets are words of their own."""
    words, word, quoted, escaped = [], "", False, False
    for sign in line + " ":
        if quoted:
            quoted, escaped = sign != '"' or escaped, sign == "\\" and not escaped
        elif sign == '"':
            quoted = True
        elif sign in " \t" or (sign in "[]" and (not word or sign == "]")):
            words += [each for each in (word, sign.strip()) if each]
            word = ""
            continue
        word += sign
    return words


def meanings(words: list[str]) -> tuple[Word, ...]:
    """Return names in full and values as bytes."""
    prefix = ""
    said: list[Word] = []
    for word in words:
        match = _ELIDED.fullmatch(word)
        if match is None or (not match[3] and match[4]):
            said.append((word[:1] if word[:1] == '"' else word, _bytes(word)))
            continue
        name = prefix + match[2] if match[1] else match[2]
        if "." in name and match[3]:
            prefix = name.rpartition(".")[0] + "."
        said.append((name, _bytes(match[4]) if match[3] else None))
    return tuple(said)


def _bytes(text: str) -> bytes:
    raw = text.encode("utf-8", "surrogateescape")
    if not raw.startswith(b'"'):
        return raw
    return _ESCAPE.sub(lambda match: _NAMED.get(match[1]) or _escaped(match[1]), raw[1:-1])


def _escaped(code: bytes) -> bytes:
    return bytes([int(code, 16)]) if len(code) == 2 else code
