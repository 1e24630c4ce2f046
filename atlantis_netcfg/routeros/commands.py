r"""One action as the device takes it: a console line for a script, or a sentence of the API.

Both hold secrets in clear.

Console: manual, Scripting, and Configuration Management. Values in quotes are escaped so that `$`, `\`, `"` and line
ends arrive as they are: inside quotes the console would replace `$name` without a word.
Sentence: manual, API (`!name` unsets a property, ids are joined by commas, `destination` is the row to stand before).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.routeros._types import Verb
from atlantis_netcfg.routeros.api import Command
from atlantis_netcfg.routeros.menus import MENUS, Kind, canonical
from atlantis_netcfg.rsc import quote

if TYPE_CHECKING:
    from collections.abc import Iterator

    from atlantis_netcfg.routeros._types import Action


def console(action: Action) -> str:
    """Return the console line, without line end: `/ip/firewall/filter/add chain=input place-before=*A3`."""
    words = [f"{action.menu}/{action.verb}"]
    if action.ids:
        words.append(",".join(action.ids))
    words += (_word(name, value) for name, value in _values(action))
    if action.before is not None:
        words.append(f"{_PLACE[action.verb]}={action.before}")
    return " ".join(words)


def _word(name: str, value: str | None) -> str:
    return name if value is None else f"{name}={quote(value)}"


def _values(action: Action) -> Iterator[tuple[str, str | None]]:
    """Yield names with values; None stands for a bare word, which sets a flag (`fib`) or unsets (`!fib`).

    A boolean that was read over the API says `true`, which is a syntax error on the console (7.23.3).
    """
    fields = MENUS[action.menu].by_name
    for name, value in action.values:
        if name.startswith("!"):
            yield name, None
        elif fields[name].kind is Kind.FLAG:
            yield (name if canonical(Kind.FLAG, value) == "yes" else f"!{name}"), None
        elif fields[name].kind is Kind.BOOLEAN:
            yield name, canonical(Kind.BOOLEAN, value)
        else:
            yield name, value


_PLACE = {Verb.ADD: "place-before", Verb.MOVE: "destination"}


def sentence(action: Action) -> tuple[str, tuple[tuple[str, str], ...]]:
    """Return the command word and its arguments: `/ip/address/set`, `(.id, *5), (disabled, yes)`."""
    arguments = [(name, value or "") for name, value in _values(action)]
    if action.ids:
        arguments.insert(0, ("numbers" if action.verb is Verb.MOVE else ".id", ",".join(action.ids)))
    if action.before is not None:
        arguments.append((_PLACE[action.verb], action.before))
    return f"{action.menu}/{action.verb}", tuple(arguments)


def executed(text: str) -> Command:
    """Return the command that runs a script and answers with its output (in the command trees from 7.9 on)."""
    return Command("/execute", (("script", text), ("as-string", "")))
