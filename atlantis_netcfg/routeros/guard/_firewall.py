"""What the firewall does to our packets: a new session inwards, its answers outwards.

The verification after a change comes by a new session, so that is what must pass; the session that is there is
`established` and lives on under most rules. A rule that nobody can judge from here counts against us: it may drop us,
but it is never what lets us in.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from atlantis_netcfg.routeros._types import is_bare
from atlantis_netcfg.routeros.guard._packet import Answer, Packet, matches
from atlantis_netcfg.routeros.guard._route import way_back
from atlantis_netcfg.routeros.menus import MENUS

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from atlantis_netcfg.routeros._types import Row
    from atlantis_netcfg.routeros.guard._state import State

FILTER, NAT, MANGLE = "/ip/firewall/filter", "/ip/firewall/nat", "/ip/firewall/mangle"

_DROPS = frozenset({"drop", "reject", "tarpit"})
_TURNS = frozenset({"dst-nat", "redirect", "netmap"})


def service_port(state: State) -> int | None:
    """Return the port of the service that we talk to."""
    text = (state.find("/ip/service", "name", state.path.service) or {}).get("port", "")
    return int(text) if text.isdecimal() else None


def new_session(state: State) -> Packet:
    """Return the first packet of a new session of ours."""
    return Packet(
        source=state.technician,
        target=state.local,
        source_port=None,
        target_port=service_port(state),
        state="new",
        in_interface=way_back(state).interface,
    )


def answer_of(state: State) -> Packet:
    """Return a packet of the router's answer."""
    return Packet(
        source=state.local,
        target=state.technician,
        source_port=service_port(state),
        target_port=None,
        state="established",
        out_interface=way_back(state).interface,
    )


@dataclass(frozen=True, slots=True)
class _Check:
    """Rules of one chain that would harm one kind of packet."""

    menu: str
    chain: str
    packet: Callable[[State], Packet]
    harms: Callable[[Row], bool]
    words: str
    cure: str


_CHECKS = (
    _Check(
        FILTER,
        "input",
        new_session,
        lambda rule: rule.get("action") in _DROPS,
        "drop a new session of yours",
        "put a rule above it that accepts your address and port",
    ),
    _Check(
        FILTER,
        "output",
        answer_of,
        lambda rule: rule.get("action") in _DROPS,
        "drop the router's answers to you",
        "put a rule above it that accepts them",
    ),
    _Check(
        NAT,
        "dstnat",
        new_session,
        lambda rule: rule.get("action") in _TURNS,
        "send a new session of yours elsewhere",
        "let it match other addresses or ports only",
    ),
    _Check(
        MANGLE,
        "output",
        answer_of,
        lambda rule: rule.get("action") == "mark-routing",
        "route the router's answers to you by another table",
        "exclude your address from it",
    ),
)


def objections(before: State, after: State) -> Iterator[str]:
    """Yield rules that harm us after the change and did not before.

    Where not all entries of the address lists were read, nobody knows what did before.
    """
    unread = any(map(is_bare, before.all("/ip/firewall/address-list")))
    for check in _CHECKS:
        known = frozenset() if unread else {_key(check, each) for each in _harmful(check, before)}
        yield from (_words(check, each) for each in _harmful(check, after) if _key(check, each) not in known)


@dataclass(frozen=True, slots=True)
class _Harm:
    rule: Row
    certain: bool


def _key(check: _Check, harm: _Harm) -> tuple[object, ...]:
    """Return what makes a rule the same before and after, wherever it stands."""
    menu = MENUS[check.menu]
    content = {name: menu.form(name, harm.rule) for name in harm.rule if name in menu.by_name}
    return harm.certain, *sorted((name, form) for name, form in content.items() if not menu.by_name[name].cosmetic)


def _words(check: _Check, harm: _Harm) -> str:
    menu = MENUS[check.menu]
    may = "would" if harm.certain else "may"
    doubt = "" if harm.certain else " (it has conditions that cannot be judged from here)"
    return f"{menu.title}: the rule `{menu.name_of(harm.rule)}` {may} {check.words}{doubt}: {check.cure}"


def _harmful(check: _Check, state: State) -> list[_Harm]:
    walk = _Walk(check, state, check.packet(state))
    walk.through(check.chain, Answer.YES, frozenset())
    return walk.harms


@dataclass(slots=True)
class _Walk:
    """One packet on its way through chains; YES, MAYBE and NO say how surely it gets somewhere."""

    check: _Check
    state: State
    packet: Packet
    harms: list[_Harm] = field(default_factory=list)

    def through(self, chain: str, reach: Answer, callers: frozenset[str]) -> Answer:
        """Follow the packet through a chain and return how surely it comes out at its end."""
        returned = Answer.NO
        for rule in self.state.enabled(self.check.menu):
            met = matches(self.check.menu, rule, self.packet, self.state) if rule.get("chain") == chain else Answer.NO
            if met is Answer.NO:
                continue
            goes_on = self._meet(rule, min(reach, met), callers | {chain})
            if goes_on is None:
                continue
            if rule.get("action") == "return":
                returned = max(returned, min(reach, met))
            reach = min(reach, goes_on) if met is Answer.YES else Answer.MAYBE
            if reach is Answer.NO:
                return returned
        return max(returned, reach)

    def _meet(self, rule: Row, surely: Answer, callers: frozenset[str]) -> Answer | None:
        """Return how surely the packet goes on to the next rule; None when the rule leaves it alone."""
        action, target = rule.get("action", "accept"), rule.get("jump-target", "")
        if self.check.harms(rule):
            self.harms.append(_Harm(rule, surely is Answer.YES))
            return Answer.NO
        if action in ("accept", "return"):
            return Answer.NO
        if action == "jump" and target not in callers:
            return self.through(target, surely, callers)
        return None
