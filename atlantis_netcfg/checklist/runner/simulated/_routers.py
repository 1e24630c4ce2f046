"""What stands around the RouterOS twins of a rehearsal when all is well, and what a fault does to them."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from atlantis_netcfg.checklist.runner.simulated._computer import ROUTER_MAC
from atlantis_netcfg.declaration.model import Gateway, Router
from atlantis_netcfg.render import router_view

if TYPE_CHECKING:
    from collections.abc import Mapping
    from datetime import datetime

    from atlantis_netcfg.declaration import Declaration, Host

Do = Callable[..., Any]
"""Command a twin: its name, the word, arguments."""
Act = Callable[[Do], Callable[[], object]]
"""Done to a twin when all stands; what it returns takes it back."""


def refitted(twin: str, before: Mapping[str, Any], after: Mapping[str, Any]) -> Act:
    """Change card or network of a 4G unit; `before` is what it has when all is well."""

    def act(do: Do) -> Callable[[], object]:
        do(twin, "modem", **after)
        return lambda: do(twin, "modem", **before)

    return act


def hushed(twin: str, addresses: list[str]) -> Act:
    """Let these addresses answer nothing that the router asks."""

    def act(do: Do) -> Callable[[], object]:
        do(twin, "silence", addresses=addresses)
        return lambda: do(twin, "silence", addresses=[])

    return act


def added(twin: str, menu: str, **row: str) -> Act:
    """Add a row, as somebody does who means well."""

    def act(do: Do) -> Callable[[], object]:
        number = _returned(do(twin, "console", words=[f"{menu}/add", *_words(row)]))
        return lambda: do(twin, "console", words=[f"{menu}/remove", f"=numbers={number}"])

    return act


def changed(twin: str, menu: str, where: Mapping[str, str], **values: str) -> Act:
    """Set values of the rows that have these values now."""

    def act(do: Do) -> Callable[[], object]:
        rows = [row for row in _rows(do(twin, "console", words=[f"{menu}/print"])) if where.items() <= row.items()]
        if not rows:
            raise LookupError(f"{twin} has no row of {menu} with {dict(where)}")
        numbers = ",".join(row[".id"] for row in rows)
        before = {name: rows[0].get(name, "") for name in values}
        _refused(do(twin, "console", words=[f"{menu}/set", f"=numbers={numbers}", *_words(values)]))
        return lambda: do(twin, "console", words=[f"{menu}/set", f"=numbers={numbers}", *_words(before)])

    return act


def apart(near: str, *, before: Mapping[str, float], after: Mapping[str, float]) -> Act:
    """Put other air between the ends of a bridge, which find each other again before anything is asked."""

    def put(do: Do, air: Mapping[str, float]) -> None:
        do(near, "air", **air)
        _registered(do, near)

    def act(do: Do) -> Callable[[], object]:
        put(do, after)
        return lambda: put(do, before)

    return act


def _registered(do: Do, near: str) -> None:
    """Wait until an end of a bridge has registered the other. Raises LookupError if it does not in half a minute."""
    until = time.monotonic() + 30
    while not _rows(do(near, "console", words=["/interface/wireless/registration-table/print"])):
        if time.monotonic() > until:
            raise LookupError(f"{near} does not find the other end again")
        time.sleep(0.05)


def set_clock(twin: str, moment: datetime) -> Act:
    """Set a router's clock, by its own time zone; it is set right when a world is made around it."""

    def act(do: Do) -> Callable[[], object]:
        _refused(do(twin, "console", words=clock_words(moment)))
        return lambda: None

    return act


def clock_words(moment: datetime) -> list[str]:
    """The sentence that sets a router's clock."""
    return ["/system/clock/set", f"=date={moment:%Y-%m-%d}", f"=time={moment:%H:%M:%S}"]


def _words(values: Mapping[str, str]) -> list[str]:
    return [f"={name.replace('_', '-')}={value}" for name, value in values.items()]


def _rows(answers: list[list[str]]) -> list[dict[str, str]]:
    return [dict(word[1:].split("=", 1) for word in words) for kind, *words in answers if kind == "!re"]


def _refused(answers: list[list[str]]) -> list[list[str]]:
    """Raise LookupError for what the twin did not take: a fault that breaks nothing would be no fault."""
    for kind, *words in answers:
        if kind == "!trap":
            raise LookupError(" ".join(words))
    return answers


def _returned(answers: list[list[str]]) -> str:
    done = next(words for kind, *words in _refused(answers) if kind == "!done")
    return next(word.removeprefix("=ret=") for word in done if word.startswith("=ret="))


def surroundings(declaration: Declaration, host: Host) -> dict[str, Any]:
    """Describe the place of a router: who is in its LAN, what it feeds, that its tunnel and its time server answer."""
    assert isinstance(host.device, Router)  # noqa: S101 - the caller has looked
    site, client, tunnel = declaration.sites[host.site], host.device.vpn_client, router_view(declaration, host).tunnel
    tunnels = {}
    if client is not None and tunnel is not None:
        tunnels[tunnel.interface] = f"{client.address}/{declaration.pilot.vpn.network.prefixlen}"
    return {
        "cards": _cards(declaration, host.site) | {str(site.lan.gateway): ROUTER_MAC},
        "loads": {port: {} for port in _fed(declaration, host.name)},
        "leases": {str(reservation.address): "bound" for reservation in site.lan.reservations},
        "tunnels": tunnels,
        "time_server": str(declaration.pilot.time_servers[0].address),
        "called": [],
        "validity": {},
    }


def _cards(declaration: Declaration, site: str) -> dict[str, str]:
    cards = {str(reservation.address): reservation.mac for reservation in declaration.sites[site].lan.reservations}
    for host in declaration.site_hosts(site):
        if isinstance(host.device, Gateway) and host.device.mac is not None:
            cards[str(host.device.address)] = host.device.mac
    return cards


def _fed(declaration: Declaration, router: str) -> list[str]:
    """Ports on which a box hangs that the router feeds."""
    sources = (getattr(host.device, "powered_by", None) for host in declaration.hosts.values())
    return [source.port for source in sources if source is not None and source.device == router]
