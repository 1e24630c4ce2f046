"""A laptop's network as iproute2 prints it, with a router, for the cases of `provision inventory doctor`."""

import json
from dataclasses import dataclass
from ipaddress import IPv4Address, IPv4Network
from typing import Any

from atlantis_netcfg.operations.doctor import DoctorItem
from atlantis_netcfg.operations.doctor.network import CardFacts, IpPrints, NetworkFacts, facts_of
from atlantis_netcfg.operations.doctor.reachability import RouterPlace

PLACE = RouterPlace(
    site="coastal",
    router="coastal-router",
    address=IPv4Address("10.64.101.1"),
    api_port=8729,
    network=IPv4Network("10.64.101.0/24"),
    technician=IPv4Address("10.64.101.10"),
    admit=(IPv4Network("10.64.101.0/24"), IPv4Network("10.80.0.0/24")),
    plug="ether8",
    link="lan",
    is_metered=False,
    pin=None,
    example=False,
)


@dataclass(frozen=True)
class Plug:
    """An interface: `state` is `off`, `no cable` or `cable`; `kind` is iproute2's, None for a real card."""

    name: str
    state: str = "cable"
    addresses: tuple[str, ...] = ()
    kind: str | None = None
    speed: int | None = 1000
    wireless: bool = False
    managed: bool = False
    master: str | None = None


def links(plugs: tuple[Plug, ...]) -> str:
    """`ip -json -details link show`."""
    rows: list[dict[str, Any]] = [{"ifname": "lo", "flags": ["LOOPBACK", "UP", "LOWER_UP"], "link_type": "loopback"}]
    for plug in plugs:
        flags = {"off": [], "no cable": ["NO-CARRIER", "UP"], "cable": ["UP", "LOWER_UP"]}[plug.state]
        row: dict[str, Any] = {"ifname": plug.name, "flags": ["BROADCAST", *flags], "link_type": "ether"}
        if plug.kind is not None:
            row["linkinfo"] = {"info_kind": plug.kind}
        if plug.master is not None:
            row["master"] = plug.master
        rows.append(row)
    return json.dumps(rows)


def addresses(plugs: tuple[Plug, ...]) -> str:
    """`ip -json -4 address show`."""
    rows = [{"ifname": "lo", "addr_info": [{"family": "inet", "local": "127.0.0.1", "prefixlen": 8}]}]
    for plug in plugs:
        pairs = [each.split("/") for each in plug.addresses]
        info = [{"family": "inet", "local": address, "prefixlen": int(length)} for address, length in pairs]
        rows.append({"ifname": plug.name, "addr_info": info})
    return json.dumps(rows)


def route(target: str, port: str, gateway: str | None = None, source: str | None = None) -> dict[str, Any]:
    row: dict[str, Any] = {"dst": target, "dev": port, "gateway": gateway, "prefsrc": source, "flags": []}
    return {name: value for name, value in row.items() if value is not None}


def network(
    *plugs: Plug,
    taken: dict[str, Any] | None = None,
    matching: tuple[dict[str, Any], ...] = (),
    defaults: tuple[dict[str, Any], ...] = (),
) -> NetworkFacts:
    """What follows from what iproute2 prints."""
    prints = IpPrints(
        links(plugs),
        addresses(plugs),
        json.dumps(defaults),
        json.dumps([] if taken is None else [taken]),
        json.dumps(matching),
    )
    cards = {plug.name: CardFacts(plug.wireless, plug.speed) for plug in plugs}
    return facts_of(prints, cards, frozenset(plug.name for plug in plugs if plug.managed))


def lines(*items: DoctorItem) -> list[str]:
    """What an item says, and what is to be typed: one line each."""
    found = []
    for item in items:
        found.append(f"{item.verdict} {item.name}: {item.observation}")
        found += [f"  {text}" for text in (item.hint, *item.commands) if text]
    return found
