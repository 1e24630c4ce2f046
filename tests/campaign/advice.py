"""What a run tells a person to do next, as a person would read it."""

import re
import shlex
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass

from atlantis_netcfg.cli.base import commands as names
from atlantis_netcfg.core.errors import NetcfgError

_COMMAND = re.compile(
    r"`(?:\./)?provision ([^`]+)`|(?:(?:then|died|type|run|again):\s+|^next\s{2,})(?:\./)?provision ([^\n]+)",
    re.MULTILINE,
)
_INFORMS = {"report runs", "report checklists", "report show", "report verify", "help", "links", "inventory validate"}
"""Commands that show something and settle nothing."""
TERMINAL = ("device trust",)
"""Commands that ask a person, and have neither `--yes` nor `--json`."""
_REMARKS = ("note:", "drift:")
"""Lines of a device's result that advise nothing; they stand as far to the right as its hint goes on."""
_AGAIN = re.compile(r"\b(again|repeat|once more|run it)\b", re.IGNORECASE)
_WAIT = re.compile(r"\b(wait|minutes|by itself|later|until)\b", re.IGNORECASE)

TABLE: Mapping[int, tuple[str, ...] | None] = {3: None, 4: None, 5: ("recover", "resume", "site=coastal")}
"""What docs/exit-codes.md advises where an output has no advice of its own."""


@dataclass(frozen=True)
class Advice:
    typed: tuple[str, ...] | None
    """Words behind `provision`; None: the same command again."""
    waits: bool
    """The text says that time has to pass first."""
    text: str
    on_terminal: bool = False
    """The text says that a person has to type it on a terminal."""


def name_of(words: Sequence[str]) -> str:
    """Return the command of a line; empty if it is none."""
    with suppress(NetcfgError):
        return names.choose(words, names.COMMANDS)[0]
    return ""


def read(output: str, site: str) -> Advice | None:
    """The last advice of an output; None: there is none."""
    tail = "\n".join(line for line in output.splitlines() if not line.lstrip().startswith(_REMARKS))
    joined = re.sub(r"(?: \\)?\n {7,}", " ", tail)
    commands = [(found[1] or found[2]).strip() for found in _COMMAND.finditer(joined)]
    commands = [line for line in commands if name_of(shlex.split(line)) not in _INFORMS and "--help" not in line]
    waits = bool(_WAIT.search(joined))
    if commands:
        on_terminal = f"`provision {commands[-1]}` on a terminal" in " ".join(joined.split())
        return Advice(_complete(commands[-1], site), waits, commands[-1], on_terminal)
    if _AGAIN.search(joined) or waits:
        return Advice(None, waits, "the same again")
    return None


def _complete(command: str, site: str) -> tuple[str, ...]:
    """Fill in what the advice leaves to the reader: the site, unless a saved plan has it. All have the inventory."""
    words = [word for word in shlex.split(command.rstrip(".;,")) if not word.startswith("inventory=")]
    words = [f"site={site}" if word.startswith("site=") and ("…" in word or "NAME" in word) else word for word in words]
    if name_of(words) != "plan apply" and not any(word.startswith("site=") for word in words):
        words.append(f"site={site}")
    return tuple(words)
