"""Does one action touch the management path: then it needs protection, whatever the end of the plan looks like."""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.routeros._types import Action, Row, Verb
from atlantis_netcfg.routeros.guard._firewall import FILTER, MANGLE, NAT, answer_of, new_session
from atlantis_netcfg.routeros.guard._link import interfaces
from atlantis_netcfg.routeros.guard._packet import Answer, in_networks, matches
from atlantis_netcfg.routeros.menus import MENUS

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from atlantis_netcfg.routeros.guard._state import State


def touches_path(action: Action, before: State, after: State) -> bool:
    """Tell whether the action changes a row of the path, as it is before or as it is after."""
    judge = _JUDGES.get(action.menu)
    if judge is None or action.inert or _is_cosmetic(action):
        return False
    return any(judge(row, state) for state in (before, after) for row in _rows(action, before, after, state))


def _is_cosmetic(action: Action) -> bool:
    fields = MENUS[action.menu].by_name
    return action.verb is Verb.SET and all(fields[name.removeprefix("!")].cosmetic for name, _ in action.values)


def _rows(action: Action, before: State, after: State, state: State) -> list[Row]:
    """Return the rows that the action is about, as `state` has them."""
    if action.verb is Verb.ADD:
        old = {row[".id"] for row in before.all(action.menu)}
        return [row for row in after.all(action.menu) if row[".id"] not in old] if state is after else []
    # Settings are one row without an id.
    return [row for row in state.all(action.menu) if not action.ids or row.get(".id") in action.ids]


def _has_interface(*names: str) -> Callable[[Row, State], bool]:
    def judge(row: Row, state: State) -> bool:
        return bool({row.get(name) for name in names} & interfaces(state))

    return judge


def _address(row: Row, state: State) -> bool:
    return row.get("address", "").partition("/")[0] == state.path.local or row.get("interface") in interfaces(state)


def _rule(menu: str, bases: Mapping[str, bool]) -> Callable[[Row, State], bool]:
    """Judge a rule of any chain that packets of ours go through; `bases` says which chains see the answers."""

    def judge(row: Row, state: State) -> bool:
        for base, is_answer in bases.items():
            packet = (answer_of if is_answer else new_session)(state)
            if row.get("chain") in _reached(menu, base, state) and matches(menu, row, packet, state) is not Answer.NO:
                return True
        return False

    return judge


def _reached(menu: str, base: str, state: State) -> set[str]:
    chains, waiting = {base}, [base]
    while waiting:
        chain = waiting.pop()
        jumps = (row for row in state.all(menu) if row.get("chain") == chain and row.get("action") == "jump")
        fresh = {row.get("jump-target", "") for row in jumps} - chains
        chains |= fresh
        waiting += fresh
    return chains


def _list_entry(row: Row, state: State) -> bool:
    return any(in_networks(row.get("address", ""), each) is not Answer.NO for each in (state.technician, state.local))


def _route(row: Row, state: State) -> bool:
    return in_networks(row.get("dst-address") or "0.0.0.0/0", state.technician) is not Answer.NO


def _routing_rule(row: Row, state: State) -> bool:
    ends = ((row.get("src-address", ""), state.local), (row.get("dst-address", ""), state.technician))
    return all(in_networks(text, address) is not Answer.NO for text, address in ends)


def _group(row: Row, state: State) -> bool:
    user = state.find("/user", "name", state.path.user) or {}
    return row.get("name") == user.get("group")


_JUDGES: Mapping[str, Callable[[Row, State], bool]] = {
    "/interface/bridge": _has_interface("name"),
    "/interface/bridge/port": _has_interface("interface", "bridge"),
    "/interface/ethernet": _has_interface("name"),
    "/interface/list": lambda *_: True,
    "/interface/list/member": _has_interface("interface"),
    "/interface/ovpn-client": _has_interface("name"),
    "/ip/address": _address,
    "/ip/dhcp-client": _has_interface("interface"),
    "/ip/firewall/address-list": _list_entry,
    FILTER: _rule(FILTER, {"input": False, "output": True}),
    NAT: _rule(NAT, {"dstnat": False}),
    MANGLE: _rule(MANGLE, {"prerouting": False, "input": False, "output": True}),
    "/ip/route": _route,
    "/ip/service": lambda row, state: row.get("name") == state.path.service,
    "/routing/rule": _routing_rule,
    "/routing/settings": lambda *_: True,
    "/routing/table": lambda *_: True,
    "/user": lambda row, state: row.get("name") == state.path.user,
    "/user/group": _group,
}
