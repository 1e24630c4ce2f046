"""Single faults of the joined pilot: how each strikes, how it ends, and which checklist items turn meanwhile."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from atlantis_netcfg.computers import reflector
from atlantis_netcfg.vpn import client, identity, server
from campaign import pilot_acts as acts

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

CENTRE, SERVER = "scc-control", "scc-vpn"
GATEWAYS = {"coastal": "coastal-gateway", "te4sea": "te4sea-gateway"}
COMPUTER = {"scc": CENTRE, **GATEWAYS}
"""The computer from which each site's checklist runs."""
LAN = {"scc": "10.64.0.", "coastal": "10.64.1.", "te4sea": "10.64.2."}
LINKS = (
    ("coastal", "wifi-ptp"),
    ("coastal", "4g"),
    ("coastal", "satellite"),
    ("te4sea", "4g"),
    ("te4sea", "satellite"),
)
MISSED_S = float(identity.TIMERS[identity.MemberLink.SATELLITE][1]) + 60
"""After so long a gateway behind a satellite has missed a server that has forgotten it, and is connected again."""
GATEWAY_SILENT = {"scc/site/data-reaches-scc": "INCONCLUSIVE gateway-silent"}
CENTRE_SILENT = {f"{site}/site/data-reaches-scc": "FAIL far-end-silent" for site in GATEWAYS}
NO_SERVER = {**{f"{site}/site/vpn": "FAIL.* server-silent" for site in COMPUTER}, **CENTRE_SILENT, **GATEWAY_SILENT}


def alone(site: str) -> dict[str, str]:
    """Return what turns if a site's computer reaches the VPN's server no more."""
    silent = {f"{site}/site/vpn": "FAIL server-silent", f"{site}/site/data-reaches-scc": "FAIL far-end-silent"}
    return {**silent, **GATEWAY_SILENT}


def unreachable(site: str) -> dict[str, str]:
    """Return what nobody can tell while a site's computer is not reached."""
    names = (
        "certificates",
        "data-reaches-scc",
        "default-route",
        "one-subnet-twice",
        "rogue-router",
        "static-addresses",
    )
    return {f"{site}/site/{name}": "INCONCLUSIVE not-reached" for name in (*names, "vpn")}


def no_tunnel(site: str) -> dict[str, str]:
    return {f"{site}/site/vpn": "FAIL gateway-no-tunnel", f"{site}/site/data-reaches-scc": "FAIL no-vpn"}


@dataclass(frozen=True)
class Fault:
    name: str
    pair: acts.Pair
    turns: Mapping[str, str] = field(default_factory=dict)
    """Item to a pattern of its verdict and codes; all others stay as they are."""
    over: tuple[str, str] | None = None
    """Site, and the link that has to carry its traffic within the declared time."""
    within_s: float | None = None
    """Seconds after mending within which data flow again; None: the time in which a site comes back to a link."""


def _links() -> Iterator[Fault]:
    moves = {
        "coastal/wifi-ptp": ("4g", r"PASS traffic leaves by 4g, because wifi-ptp is not up"),
        "te4sea/4g": ("satellite", r"PASS traffic leaves by satellite, because 4g is not up"),
    }
    for way, what in (("cut", acts.cut), ("cable-out", acts.unplug)):
        yield Fault(f"scc-uplink-{way}", what("scc", "uplink"), alone("te4sea"))
        for site, link in LINKS:
            after, words = moves.get(f"{site}/{link}", ("", ""))
            turns = {f"{site}/site/default-route": words} if after else {}
            yield Fault(f"{site}-{link}-{way}", what(site, link), turns, (site, after) if after else None)
    yield Fault(
        "scc-bridge-cable-out",
        acts.unplug("scc", "wifi-ptp"),
        {"coastal/site/default-route": moves["coastal/wifi-ptp"][1]},
        ("coastal", "4g"),
    )
    for site, link in (("coastal", "wifi-ptp"), ("te4sea", "4g")):
        after, words = moves[f"{site}/{link}"]
        yield Fault(
            f"{site}-{link}-late", acts.delay(site, link, 2), {f"{site}/site/default-route": words}, (site, after)
        )
    yield Fault(
        "scc-uplink-lossy",
        (acts.shape("scc", "uplink", loss=0.8), acts.shape("scc", "uplink", loss=-0.8)),
        {
            "te4sea/site/vpn": "WARN server-lossy|FAIL server-silent",
            "te4sea/site/data-reaches-scc": "WARN data-lost|FAIL far-end-silent",
            "scc/site/data-reaches-scc": "WARN data-lost|INCONCLUSIVE gateway-silent",
        },
    )


def _computers() -> Iterator[Fault]:
    yield Fault("server-stopped", acts.stop(SERVER, server.SERVICE), NO_SERVER)
    yield Fault("scc-client-stopped", acts.stop(CENTRE, client.SERVICE), {**CENTRE_SILENT, **no_tunnel("scc")})
    yield Fault(
        "scc-reflector-stopped",
        acts.stop(CENTRE, reflector.SERVICE),
        dict.fromkeys((f"{site}/site/data-reaches-scc" for site in GATEWAYS), "FAIL nobody-answers-data"),
    )
    for site, name in GATEWAYS.items():
        yield Fault(f"{site}-client-stopped", acts.stop(name, client.SERVICE), {**GATEWAY_SILENT, **no_tunnel(site)})
        yield Fault(
            f"{site}-reflector-stopped",
            acts.stop(name, reflector.SERVICE),
            {"scc/site/data-reaches-scc": "FAIL nobody-answers-data"},
        )
        yield Fault(
            f"{site}-data-outside",
            acts.add(name, "route", f"10.80.0.2/32 via {LAN[site]}1"),
            {f"{site}/site/data-reaches-scc": "FAIL way-outside-vpn", **GATEWAY_SILENT},
        )
    yield Fault(
        "scc-data-outside",
        acts.add(CENTRE, "route", f"10.80.0.21/32 via {LAN['scc']}1"),
        {"scc/site/data-reaches-scc": "FAIL way-outside-vpn", "coastal/site/data-reaches-scc": "FAIL far-end-silent"},
    )
    for site, name in COMPUTER.items():
        yield Fault(
            f"{site}-identity-expired",
            (acts.expire_identity(name), acts.restore_identity(name)),
            {f"{site}/site/certificates": "FAIL expired"},
        )
        yield Fault(
            f"{site}-spare-default",
            acts.add(name, "route", f"default via {LAN[site]}99 metric 500"),
            {f"{site}/site/default-route": "WARN gateway-spare-route"},
        )
        yield Fault(
            f"{site}-broad-route",
            acts.add(name, "route", f"0.0.0.0/1 via {LAN[site]}1"),
            {f"{site}/site/default-route": "FAIL gateway-broader-route"},
        )
        yield Fault(
            f"{site}-second-address",
            acts.add(name, "address", f"{LAN[site]}77/24 dev eth0"),
            {f"{site}/site/one-subnet-twice": "FAIL subnet-twice"},
        )
        yield Fault(f"{site}-disk-full", (acts.fill_disk(name), acts.free_disk(name)))
        yield Fault(
            f"{site}-rogue-router",
            (acts.advertise(site), acts.stop_advertising(site)),
            {f"{site}/site/rogue-router": "FAIL rogue-router"},
        )


def _routers() -> Iterator[Fault]:
    nat, rules = "/ip/firewall/nat", "/ip/firewall/filter"
    for site in GATEWAYS:
        yield Fault(
            f"{site}-tunnel-disabled",
            acts.disable(site, "/interface/ovpn-client", comment="atlantis: VPN"),
            {f"{site}/site/vpn": "FAIL router-tunnel-off"},
        )
        yield Fault(
            f"{site}-allow-list-disabled",
            acts.disable(site, rules, comment="atlantis: VPN server", chain="to-satellite"),
            {f"{site}/site/satellite-filter": "FAIL too-narrow"},
        )
        yield Fault(f"{site}-translation-disabled", acts.disable(site, nat, comment="atlantis: uplinks"), alone(site))
        yield Fault(
            f"{site}-lan-disabled", acts.disable(site, rules, comment="atlantis: LAN by the best link"), alone(site)
        )


def _power_and_cables() -> Iterator[Fault]:
    """Last, because they take longest: a computer boots, and an OpenVPN server that is gone is missed late."""
    for site, name in COMPUTER.items():
        turns = {**(CENTRE_SILENT if name == CENTRE else GATEWAY_SILENT), **unreachable(site)}
        yield Fault(
            f"{site}-computer-cable-out", (acts.computer_cable(name, "down"), acts.computer_cable(name, "up")), turns
        )
        yield Fault(f"{site}-computer-off", (acts.power(name, is_on=False), acts.power(name, is_on=True)), turns)
    yield Fault("server-cable-out", (acts.computer_cable(SERVER, "down"), acts.computer_cable(SERVER, "up")), NO_SERVER)
    yield Fault(
        "server-off", (acts.power(SERVER, is_on=False), acts.power(SERVER, is_on=True)), NO_SERVER, within_s=MISSED_S
    )
    yield Fault("time-servers-dead", (acts.time_servers("del"), acts.time_servers("add")))


FAULTS: tuple[Fault, ...] = (*_links(), *_computers(), *_routers(), *_power_and_cables())
