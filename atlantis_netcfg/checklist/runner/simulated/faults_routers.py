"""Faults of the RouterOS devices: bearers, power, tunnel, clock, filter."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta
from typing import TYPE_CHECKING, Any

from atlantis_netcfg.checklist.runner.simulated._fault import Fault
from atlantis_netcfg.checklist.runner.simulated._routers import added, apart, changed, hushed, refitted, set_clock

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from atlantis_netcfg.checklist.runner.simulated._routers import Act
    from atlantis_netcfg.checklist.runner.simulated._world import World

_ROUTER, _UNIT = "coastal-router", "coastal-4g"
_LONG_AGO = datetime(2025, 1, 1, tzinfo=UTC)


def _done(*acts: Act) -> Callable[[World], None]:
    return lambda world: world.acts.extend(acts)


def _around(**changes: Any) -> Callable[[World], None]:  # noqa: ANN401 - fields of what stands around a router
    def spoil(world: World) -> None:
        place = world.routers[_ROUTER]
        for name, value in changes.items():
            place[name] = {**place[name], **value} if isinstance(value, dict) and value and name in place else value

    return spoil


def _unit(before: Mapping[str, Any], after: Mapping[str, Any]) -> Callable[[World], None]:
    return _done(refitted(_UNIT, before, after))


def _years_ago(world: World) -> None:
    world.routers[_ROUTER]["time_server"] = None
    world.acts.append(set_clock(_ROUTER, _LONG_AGO))


FAULTS: Mapping[str, Fault] = {
    "bridge-saturated": Fault(
        "the two ends of the Wi-Fi bridge stand on one bench, 2 m apart",
        ("SITE/wifi",),
        _done(apart("coastal-cpe", before={"distance_m": 150.0}, after={"distance_m": 2.0})),
    ),
    "bridge-weak": Fault(
        "something stands between the two ends of the Wi-Fi bridge",
        ("SITE/wifi",),
        _done(apart("coastal-cpe", before={"loss_db": 0.0}, after={"loss_db": 32.0})),
    ),
    "lte-no-card": Fault("there is no SIM in the 4G unit", ("SITE/4g",), _unit({"sim": {}}, {"sim": None})),
    "lte-roaming": Fault(
        "the 4G unit hears a foreign network only, and roaming is off",
        ("SITE/4g",),
        _unit({"cell": {"plmn": "00101"}}, {"cell": {"plmn": "26803"}}),
    ),
    "lte-no-coverage": Fault("no network is heard", ("SITE/4g",), _unit({"cell": {}}, {"cell": None})),
    "lte-refused": Fault(
        "the network refuses the card",
        ("SITE/4g",),
        _unit({"cell": {"denies": False}}, {"cell": {"denies": True}}),
    ),
    "dear-route": Fault(
        "somebody has set a default route over 4G by hand",
        ("SITE/site/default-route", "SITE/wifi", "SITE/4g"),
        _done(added(_ROUTER, "/ip/route", dst_address="0.0.0.0/0", gateway="10.10.1.1", distance="1")),
    ),
    "bridge-beyond-silent": Fault(
        "nobody answers beyond the Wi-Fi bridge",
        ("SITE/wifi",),
        _done(hushed(_ROUTER, ["198.51.100.11", "198.51.100.12"])),
    ),
    "poe-overload": Fault(
        "the port of the 4G unit is overloaded", ("SITE/site/poe",), _around(loads={"ether2": {"status": "overload"}})
    ),
    "router-tunnel": Fault("the router is not in the VPN", ("SITE/site/vpn",), _around(tunnels={})),
    "router-clock": Fault(
        "the router's clock stands at the year before, and no time server answers",
        ("SITE/site/clock",),
        _years_ago,
    ),
    "router-ntp-waiting": Fault(
        "no time server answers the router, whose clock is right so far",
        ("SITE/site/clock",),
        _around(time_server=None),
    ),
    "router-certificate": Fault(
        "the router's certificate of the VPN ends in a week",
        ("SITE/site/certificates",),
        lambda world: world.routers[_ROUTER].update(validity={"atlantis-vpn": _week()}),
    ),
    "router-subnet-twice": Fault(
        "the router has a second address of its LAN on the same bridge",
        ("SITE/site/one-subnet-twice",),
        _done(added(_ROUTER, "/ip/address", address="10.64.1.2/24", interface="bridge-lan")),
    ),
    "filter-open": Fault(
        "a rule of the satellite's allow-list is switched off",
        ("SITE/site/satellite-filter", "SITE/satellite/allow-list"),
        _done(changed(_ROUTER, "/ip/firewall/filter", {"chain": "to-satellite", "action": "drop"}, disabled="yes")),
    ),
}


def _week() -> dict[str, str]:
    now = datetime.now(UTC)
    return {"since": (now - timedelta(days=358)).isoformat(), "until": (now + timedelta(days=7)).isoformat()}
