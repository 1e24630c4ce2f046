"""Names that somebody might type, send or smuggle in, and which few of them are good; for each door that takes one."""

# ruff: noqa: RUF001 - look-alikes are what it is about

import random
import string
import unicodedata
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache

from atlantis_netcfg.vpn.names import RESERVED_WORDS

__all__ = ["Hostile", "hostile_names", "is_legitimate"]

BASES = ("sparus2", "iqua", "robot-1")
PLAIN = set(string.ascii_lowercase + string.digits + "-")


@dataclass(frozen=True)
class Hostile:
    """A name for a device, a partner or a host."""

    text: str
    legitimate: bool
    """Good by itself; `PARTNER-DEVICE` can still be too long."""


@cache
def hostile_names() -> tuple[Hostile, ...]:
    """More than 2,000, each once, in an order that does not change."""
    return tuple(Hostile(text, is_legitimate(text)) for text in dict.fromkeys(_all()))


def is_legitimate(text: str) -> bool:
    """The rule in other words than the product's: letter by letter."""
    within = all(letter in PLAIN for letter in text) and 1 <= len(text) <= 48
    return within and not text.startswith("-") and not text.endswith("-") and text not in RESERVED_WORDS


def _all() -> Iterator[str]:
    yield from BASES
    yield from _inserted()
    yield from _look_alikes()
    yield from _paths()
    yield from _options()
    yield from _languages()
    yield from _words()
    yield from _lengths()
    yield from _identities()
    yield from _random()


def _inserted() -> Iterator[str]:
    """Every ASCII character that is no letter, and some that are not seen, at the start, inside, and at the end."""
    strange = [chr(code) for code in range(128) if chr(code) not in PLAIN]
    strange += [
        *("\x85", "\xa0", "\xad", "\u200b", "\u200d", "\u202e", "\u2028", "\u2060", "\ufeff"),
        *("\U000e0061", "\udcff"),
    ]
    for base in BASES:
        for letter in strange:
            yield from (f"{letter}{base}", f"{base[:3]}{letter}{base[3:]}", f"{base}{letter}")


def _look_alikes() -> Iterator[str]:
    """One letter is another one that looks like it, or is the same to somebody who folds."""
    alike = {
        "a": "аɑαａ𝐚ªáåⓐ",
        "b": "Ьｂ𝒃",
        "i": "іıｉ𝓲íⁱⅰ",
        "k": "Kкｋ",
        "o": "оοо０ｏ𝕠º",
        "p": "рρｐ",
        "q": "ԛｑ𝗾",
        "r": "ｒᴦʳ",
        "s": "ѕſｓ𝘀ˢ",
        "t": "тｔ𝚝",
        "u": "υսｕ𝒖ü",
        "1": "１¹①١𝟏",
        "2": "２²②٢𝟐",
        "-": "‐‑‒–—―−－﹣⁃",
    }
    for base in BASES:
        for letter, others in alike.items():
            if letter in base:
                yield from (base.replace(letter, other, 1) for other in others)
                yield from (base.replace(letter, letter + mark, 1) for mark in "\u0301\u0327\u0336\u20dd")
        for form in ("NFD", "NFKD"):
            yield unicodedata.normalize(form, f"{base}é")
        yield "".join(chr(ord(letter) + 0xFEE0) for letter in base)
    yield from ("ﬁsh", "straße", "ΙQUA", "iquа", "ⅷ", "北極", "роботи", "🤖", "ro🤖bot", "\U0001d7d9", "مرحبا", "İqua")


def _paths() -> Iterator[str]:
    parts = (
        *("..", ".", "../..", "../etc/passwd", "..\\..", "%2e%2e", "%2f", "%00", "/", "//", "/etc/passwd", "~"),
        *("~root", "C:"),
    )
    for base in BASES:
        for part in parts:
            yield from (part, f"{part}/{base}", f"{base}/{part}", f"{part}{base}", f"{base}{part}")
        yield from (
            f".{base}",
            f".revoked-{base}",
            f"{base}.ovpn",
            f"{base}.pem",
            f"{base}.2",
            f"{base}.",
            f".{base}.123",
        )


def _options() -> Iterator[str]:
    for word in (
        *("-", "--", "-rf", "--help", "--config", "--json", "-oProxyCommand=id", "--passphrase-fd", "-c"),
        *("-e", "-i"),
    ):
        yield from (word, *(f"{word}{base}" for base in BASES), *(f"{word}={base}" for base in BASES))
        yield from (f"{base} {word}" for base in BASES)


def _languages() -> Iterator[str]:
    """Words of shells, templates, YAML, JSON, nft, OpenVPN's files, distinguished names, SQL, HTML, formats."""
    pieces = (
        "$(id)",
        "`id`",
        ";id",
        "|id",
        "&&id",
        ">x",
        "<x",
        "${HOME}",
        "$HOME",
        "!!",
        "*",
        "?",
        "[a-z]",
        "{a,b}",
        "'",
        '"',
        "\\",
        "{{ 7*7 }}",
        "{%x%}",
        "{#",
        "}}",
        "{{lookup('pipe','id')}}",
        "!!python/object",
        "&a",
        "*a",
        "a: b",
        "- a",
        "#",
        "~",
        "%s",
        "%n",
        "{0}",
        "{}",
        "\\n",
        "\\x00",
        "\\u0000",
        "; drop",
        "} accept",
        "{ flush ruleset }",
        "@set",
        "$var",
        "\nifconfig-push",
        "\nclient-kill 0",
        "\r\nkill",
        "</cert>",
        "<ca>",
        "CN=x",
        ",CN=x",
        "+CN=x",
        "/CN=x",
        "\\,",
        "=x",
        "' OR 1=1",
        "<script>",
        "&amp;",
        "://x",
        "@host",
        ":22",
        "a b",
        "\ta",
        "\x1b[31m",
        "\x07",
        "\x08",
        "\x7f",
        "\x9b",
    )
    for piece in pieces:
        yield piece
        for base in BASES:
            yield from (f"{piece}{base}", f"{base}{piece}", f"{base[:2]}{piece}{base[2:]}")


def _words() -> Iterator[str]:
    """Reserved words as they are, in other cases, and beside a letter too many, with which they are good again."""
    for word in sorted(
        RESERVED_WORDS | {"default", "server", "ip", "ip6", "tcp", "udp", "log", "set", "map", "fwd", "dup"}
    ):
        yield from (word, word.upper(), word.capitalize(), f"{word} ", f"-{word}", f"{word}_")
    yield from (
        *("defaultx", "server-1", "log2", "null", "none", "nan", "yes", "no", "on", "off", "0", "1e9", "0x10"),
        *("con", "nul"),
    )


def _lengths() -> Iterator[str]:
    yield from ("", " ", "a", "-a", "a-", "a--b")
    yield from (
        "a" * length for length in (47, 48, 49, 50, 63, 64, 65, 127, 128, 255, 256, 1024, 4096, 65536, 1_000_000)
    )
    yield from (f"{'a' * 47}-", f"-{'a' * 47}", f"{'a' * 48}\n", "é" * 24, "🤖" * 12)


def _identities() -> Iterator[str]:
    """Somebody else's name, as one of the programs in the way would read it (facts 6)."""
    for other in ("iqua-sparus2", "inesc-laptop1"):
        yield from (f"{other}\0vtt", f"{other}\0", other.upper(), other.replace("-", "/"), other.replace("-", "_"))
        yield from (f"{other}\n", f" {other}", f"{other}.2", f"{other},OU=x", f"{other}/../server")


def _random() -> Iterator[str]:
    chance = random.Random(6)  # noqa: S311 - the same names in every run
    letters = [*sorted(PLAIN), *map(chr, range(0x20)), *"/\\.;|&$`'\"{}[]()<>@!#%^*+=~, AZаеорс\u200b\u202e"]
    for _ in range(600):
        yield "".join(chance.choices(letters, k=chance.randint(1, 60)))
