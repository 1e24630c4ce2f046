"""What our side says to routers while a test runs: recorded where it leaves us, whatever process the router is in."""

import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any
from unittest.mock import patch

from holes import known
from spoken import Said, lines, sentence
from trees import Tree

from atlantis_netcfg.routeros.api import Command, Reply
from atlantis_netcfg.routeros.api._wire import Wire
from atlantis_netcfg.routeros.console.terminal import Terminal
from atlantis_netcfg.routeros.rsc import unquote

ASKED_EVERYWHERE = {"/safe-mode/print"}
"""How we learn whether a device has it."""
_PARSES = ":foreach n,s in={"
_TEXT = re.compile(r'"(?:\\.|[^"\\])*"')
_SCRIPTS = ("=script=", "=on-event=", "=source=")


def parsed(script: str) -> list[str]:
    """Return the commands that a script hands to the device's own parser, without the one that has to be refused."""
    array = script.removeprefix(_PARSES).partition("} do={:local v ")[0]
    *texts, control = [unquote(f'"{unquote(text)}"') for text in _TEXT.findall(array)]
    assert control == "/system/identity/set atlantis=no"
    return texts


@dataclass
class Heard:
    """Sentences of the API, and lines that were typed."""

    sentences: list[list[str]] = field(default_factory=list)
    typed: list[str] = field(default_factory=list)

    def said(self, tree: Tree) -> list[Said]:
        """Return all in one form, with the lines of the scripts that sentences bring along."""
        found = [sentence(words) for words in self.sentences]
        for words in self.sentences:
            for word in words:
                if word.startswith(_SCRIPTS):
                    script = word.partition("=")[2].partition("=")[2]
                    for text in parsed(script) if script.startswith(_PARSES) else [script]:
                        found += lines(text, tree)
        for line in self.typed:
            found += lines(line, tree)
        return found

    def unknown(self, tree: Tree) -> dict[str, frozenset[str]]:
        """Return what that version does not have, by command."""
        odd = {}
        for one in self.said(tree):
            path = f"{one.menu.rstrip('/')}/{one.command}"
            if path not in ASKED_EVERYWHERE and not known(one.menu, one.command) and (names := one.unknown(tree)):
                odd[path] = names
        return odd

    def proplists(self) -> list[tuple[str, str]]:
        """Return menus and the properties that were asked for."""
        return [
            (words[0].rpartition("/")[0], name)
            for words in self.sentences
            for word in words
            if word.startswith("=.proplist=")
            for name in word.removeprefix("=.proplist=").split(",")
        ]


@contextmanager
def listening() -> Iterator[Heard]:
    """Record everything that goes to any router."""
    heard = Heard()
    exchange, run, ask = Wire.exchange, Terminal.run, Terminal.ask

    async def exchanging(wire: Wire, commands: Sequence[Command], *patience_s: float) -> list[Reply]:
        heard.sentences += [list(command.words()) for command in commands]
        return await exchange(wire, commands, *patience_s)

    def running(terminal: Terminal, command: str, **how: Any) -> str:  # noqa: ANN401 - as Terminal.run has it
        heard.typed.append(command)
        return run(terminal, command, **how)

    def asking(terminal: Terminal, command: str, *words: str, **how: Any) -> None:  # noqa: ANN401 - as Terminal.ask
        heard.typed.append(command)
        ask(terminal, command, *words, **how)

    with (
        patch.object(Wire, "exchange", exchanging),
        patch.object(Terminal, "run", running),
        patch.object(Terminal, "ask", asking),
    ):
        yield heard
