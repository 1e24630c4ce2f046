"""Scripts that a person would type, and the twenty-rule change of the firewall: what is taken away from a router."""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.routeros.rsc import parse, print_statement, quote

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence

    from bench.declared import Declared

__all__ = ["FILTER", "damage", "first_script", "repair_script"]

FILTER = "/ip/firewall/filter"
_MISSING_CHAINS = ("output", "forward", "to-satellite")
"""Rules of these chains are missing; those of `input` guard the router itself and stay: nobody is locked out."""
_ALTERED: Mapping[tuple[str, str], Mapping[str, str]] = {
    ("input", "atlantis: what is dropped, a sample"): {"limit": "5/1m,5:packet"},
    ("output", "atlantis: satellite, allow-list"): {"out-interface": "ether2"},
    ("forward", "atlantis: responses"): {"connection-state": "established,related"},
    ("forward", "atlantis: LAN by the best link"): {"src-address": "10.64.9.0/24"},
    ("forward", "atlantis: our hosts to the VPN"): {"dst-address-list": "management"},
}
"""Chain and comment of the rules that have another value."""

Row = dict[str, str]


def damage(ask: Callable[[Sequence[str]], list[list[str]]]) -> None:
    """Take a finished router back to the state before the change; `ask` runs a sentence on it."""
    answers = ask([f"{FILTER}/print"])
    rows = [dict(word[1:].split("=", 1) for word in answer[1:] if word[0] == "=") for answer in answers]
    rows = [row for row in rows if ".id" in row]
    for row in rows:
        for name, value in _ALTERED.get(_name(row), {}).items():
            ask([f"{FILTER}/set", f"=.id={row['.id']}", f"={name}={value}"])
    gone = [row[".id"] for row in rows if _is_missing(row)]
    ask([f"{FILTER}/remove", f"=.id={','.join(gone)}"])


def repair_script(declared: Declared) -> Iterator[str]:
    """Write what a person would type to put it right, knowing what is wrong: five `set`, and `add` in their places."""
    rules = _rules(declared)
    for rule in rules:
        for name in _ALTERED.get(_name(rule), {}):
            yield f"/ip firewall filter set {_find(rule)} {name}={quote(rule[name])}"
    for place, rule in enumerate(rules):
        if _is_missing(rule):
            words = " ".join(f"{name}={quote(value)}" for name, value in rule.items())
            after = next((row for row in rules[place:] if not _is_missing(row)), None)
            yield f"/ip firewall filter add {words}" + (f" place-before={_find(after)}" if after else "")


def first_script(text: str, address: str) -> Iterator[str]:
    """Write what a person would type on an adopted router: the desired text, its own address being there already."""
    for statement in parse(text, "the desired text").statements:
        known = statement.get("address") or ""
        if statement.menu == "/ip/address" and known.startswith(f"{address}/"):
            comment = quote(statement.get("comment") or "")
            yield f'/ip address set [ find address="{known}" ] comment={comment}'
        else:
            yield print_statement(statement, path=True)


def _rules(declared: Declared) -> list[Row]:
    statements = parse(declared.text, "the desired text").statements
    return [
        {name: value or "" for name, value in statement.values} for statement in statements if statement.menu == FILTER
    ]


def _name(rule: Row) -> tuple[str, str]:
    return rule.get("chain", ""), rule.get("comment", "")


def _is_missing(rule: Row) -> bool:
    return rule.get("chain") in _MISSING_CHAINS and rule.get("action") != "reject" and _name(rule) not in _ALTERED


def _find(rule: Row) -> str:
    return f"[ find chain={rule['chain']} comment={quote(rule['comment'])} ]"
