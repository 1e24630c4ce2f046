"""Checks whether the router lets us in: the service, its certificate, the user and its group.

Also checks whether one action touches the management path: then it needs protection, whatever the final state.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.core.messages import arg, msg
from atlantis_netcfg.routeros import _types
from atlantis_netcfg.routeros.guard import _firewall
from atlantis_netcfg.routeros.guard._link import interfaces
from atlantis_netcfg.routeros.guard._state import State, is_set
from atlantis_netcfg.routeros.menus import MENUS

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping


POLICIES = frozenset({"api", "read", "write", "policy", "test", "sensitive"})

_ENOUGH_SESSIONS = 2


def access_objections(before: State, after: State) -> Iterator[str]:
    """Yield what would prevent a new session of ours."""
    yield from _service_harm(before, after)
    yield from _user_harm(before, after)
    yield from _group_harm(before, after)


def _service_harm(before: State, after: State) -> Iterator[str]:
    path = before.path
    old = before.find("/ip/service", "name", path.service)
    new = after.find("/ip/service", "name", path.service)
    if old is None or new is None:
        return
    text = f"/ip service: {path.service}, which this session uses,"
    if is_set(new, "disabled") and not is_set(old, "disabled"):
        yield msg(f"{arg(text)} would be disabled: leave it enabled")
    if _form("port", old) != _form("port", new):
        yield msg(
            f"{arg(text)} would move from port {arg(old.get('port'))} to {arg(new.get('port'))}: leave the port, or "
            "enter the new one in the inventory and change it on the router by hand"
        )
    if _is_technician_admitted(old, before) and not _is_technician_admitted(new, after):
        yield msg(
            f"{arg(text)} would allow only {arg(new.get('address'))}, not you at {arg(path.technician)}: add your "
            "address"
        )
    if _form("certificate", old) != _form("certificate", new):
        yield msg(
            f"{arg(text)} would change its certificate from {arg(old.get('certificate', 'none'))} to "
            f"{arg(new.get('certificate', 'none'))}, and this computer would no longer recognise the router: keep it"
        )
    if _form("vrf", old) != _form("vrf", new):
        yield msg(f"{arg(text)} would listen in {arg(new.get('vrf'))} only: leave vrf={arg(old.get('vrf', 'main'))}")
    if int(new.get("max-sessions", "20")) < _ENOUGH_SESSIONS <= int(old.get("max-sessions", "20")):
        yield msg(f"{arg(text)} would allow only one session, but a change is verified in a second: raise max-sessions")


def _form(name: str, row: _types.Row) -> str:
    return MENUS["/ip/service"].form(name, row)


def _is_technician_admitted(row: _types.Row, state: State) -> bool:
    return _firewall.in_networks(row.get("address", ""), state.technician) is not _firewall.MatchResult.NO


def _user_harm(before: State, after: State) -> Iterator[str]:
    name = before.path.user
    old, new = before.find("/user", "name", name), after.find("/user", "name", name)
    if old is None:
        return
    if new is None:
        yield f"/user: {name}, as whom we are logged in, would be removed: keep that user"
    elif is_set(new, "disabled") and not is_set(old, "disabled"):
        yield f"/user: {name}, as whom we are logged in, would be disabled: leave it enabled"
    elif _is_technician_admitted(old, before) and not _is_technician_admitted(new, after):
        yield (
            f"/user: {name}, as whom we are logged in, would be admitted only from {new.get('address')}, not from "
            f"{before.path.technician}: add your address"
        )


def _group_harm(before: State, after: State) -> Iterator[str]:
    lost_policies = sorted((_policies(before) - _policies(after)) & POLICIES)
    if lost_policies and after.find("/user", "name", before.path.user) is not None:
        yield (
            f"/user group: {before.path.user} would lose the policies {', '.join(lost_policies)}: "
            "keep them in its group"
        )


def _policies(state: State) -> frozenset[str]:
    user = state.find("/user", "name", state.path.user) or {}
    group = state.find("/user/group", "name", user.get("group", "")) or {}
    return frozenset(word for word in group.get("policy", "").split(",") if word and not word.startswith("!"))


def touches_path(action: _types.Action, before: State, after: State) -> bool:
    """Return True if the action changes a row of the path, in its state before or after."""
    judge = _JUDGE_BY_MENU.get(action.menu)
    if judge is None or action.inert or _is_cosmetic(action):
        return False
    return any(judge(row, state) for state in (before, after) for row in _rows(action, before, after, state))


def _is_cosmetic(action: _types.Action) -> bool:
    fields = MENUS[action.menu].by_name
    return action.verb is _types.Verb.SET and all(fields[name.removeprefix("!")].cosmetic for name, _ in action.values)


def _rows(action: _types.Action, before: State, after: State, state: State) -> list[_types.Row]:
    """Return the rows affected by the action, as in `state`."""
    if action.verb is _types.Verb.ADD:
        old = {row[".id"] for row in before.all(action.menu)}
        return [row for row in after.all(action.menu) if row[".id"] not in old] if state is after else []
    # Settings are one row without an id.
    return [row for row in state.all(action.menu) if not action.ids or row.get(".id") in action.ids]


def _has_interface(*names: str) -> Callable[[_types.Row, State], bool]:
    def judge(row: _types.Row, state: State) -> bool:
        return bool({row.get(name) for name in names} & interfaces(state))

    return judge


def _is_address_touched(row: _types.Row, state: State) -> bool:
    return row.get("address", "").partition("/")[0] == state.path.local or row.get("interface") in interfaces(state)


def _rule_touched(menu: str, bases: Mapping[str, bool]) -> Callable[[_types.Row, State], bool]:
    """Return a check for rules in chains that our packets pass; `bases` maps a chain to whether it sees replies."""

    def judge(row: _types.Row, state: State) -> bool:
        for base, is_answer in bases.items():
            packet = (_firewall.answer_of if is_answer else _firewall.new_session)(state)
            if (
                row.get("chain") in _reachable_chains(menu, base, state)
                and _firewall.matches(menu, row, packet, state) is not _firewall.MatchResult.NO
            ):
                return True
        return False

    return judge


def _reachable_chains(menu: str, base: str, state: State) -> set[str]:
    chains, waiting = {base}, [base]
    while waiting:
        chain = waiting.pop()
        jumps = (row for row in state.all(menu) if row.get("chain") == chain and row.get("action") == "jump")
        fresh = {row.get("jump-target", "") for row in jumps} - chains
        chains |= fresh
        waiting += fresh
    return chains


def _is_list_entry_touched(row: _types.Row, state: State) -> bool:
    return any(
        _firewall.in_networks(row.get("address", ""), each) is not _firewall.MatchResult.NO
        for each in (state.technician, state.local)
    )


def _is_route_touched(row: _types.Row, state: State) -> bool:
    return (
        _firewall.in_networks(row.get("dst-address") or "0.0.0.0/0", state.technician) is not _firewall.MatchResult.NO
    )


def _is_routing_rule_touched(row: _types.Row, state: State) -> bool:
    ends = ((row.get("src-address", ""), state.local), (row.get("dst-address", ""), state.technician))
    return all(_firewall.in_networks(text, address) is not _firewall.MatchResult.NO for text, address in ends)


def _is_group_touched(row: _types.Row, state: State) -> bool:
    user = state.find("/user", "name", state.path.user) or {}
    return row.get("name") == user.get("group")


_JUDGE_BY_MENU: Mapping[str, Callable[[_types.Row, State], bool]] = {
    "/interface/bridge": _has_interface("name"),
    "/interface/bridge/port": _has_interface("interface", "bridge"),
    "/interface/ethernet": _has_interface("name"),
    "/interface/list": lambda *_: True,
    "/interface/list/member": _has_interface("interface"),
    "/interface/ovpn-client": _has_interface("name"),
    "/ip/address": _is_address_touched,
    "/ip/dhcp-client": _has_interface("interface"),
    "/ip/firewall/address-list": _is_list_entry_touched,
    _firewall.FILTER: _rule_touched(_firewall.FILTER, {"input": False, "output": True}),
    _firewall.NAT: _rule_touched(_firewall.NAT, {"dstnat": False}),
    _firewall.MANGLE: _rule_touched(_firewall.MANGLE, {"prerouting": False, "input": False, "output": True}),
    "/ip/route": _is_route_touched,
    "/ip/service": lambda row, state: row.get("name") == state.path.service,
    "/routing/rule": _is_routing_rule_touched,
    "/routing/settings": lambda *_: True,
    "/routing/table": lambda *_: True,
    "/user": lambda row, state: row.get("name") == state.path.user,
    "/user/group": _is_group_touched,
}
