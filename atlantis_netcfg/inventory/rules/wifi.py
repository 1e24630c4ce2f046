"""Rules for the gateway's radios: the vehicles' access points that they join, and their own access point."""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.core.messages import arg, msg
from atlantis_netcfg.inventory import _draft, model
from atlantis_netcfg.inventory.rules.networks import example_in, why_unusable
from atlantis_netcfg.inventory.rules.radio import is_passphrase

if TYPE_CHECKING:
    from collections.abc import Iterator

    from atlantis_netcfg.core.secret import Secret
    from atlantis_netcfg.inventory.findings import Finding

_WIFI = ("endpoints", "wifi")
_WIDTH_MHZ = 20


def _vehicle_networks(draft: _draft.Draft) -> Iterator[tuple[str, model.WifiEndpoint, Secret]]:
    """Yield the vehicles with a Wi-Fi key: a radio of the gateway joins their access points."""
    for name, vehicle in draft.vehicles.items():
        wifi = vehicle.endpoints.wifi
        if wifi is not None and wifi.key is not None:
            yield name, wifi, wifi.key


def require_access_point(draft: _draft.Draft) -> Iterator[Finding]:
    """Require an access point with an SSID wherever a vehicle has a Wi-Fi key: a key is for nothing else."""
    for name, wifi, key in _vehicle_networks(draft):
        part = _draft.Part("vehicle", name)
        if wifi.role is not model.WifiRole.ACCESS_POINT:
            message = msg(f"`{arg(name)}` is a station: the key of the site's network belongs to its access point")
            yield draft.finding_at(part, (*_WIFI, "key"), message, "remove `key`, or write `role: access_point`")
        elif wifi.seen_from is not model.SeenFrom.GATEWAY:
            message = msg(f"the laptop joins the access point of `{arg(name)}`, and nothing configures the laptop")
            yield draft.finding_at(part, (*_WIFI, "key"), message, "remove `key`, or write `seen_from: gateway`")
        elif wifi.ssid is None:
            message = msg(
                f"the access point of `{arg(name)}` has a key but no name: a radio joins a network by its name"
            )
            yield draft.finding_at(part, (*_WIFI, "key"), message, "add its `ssid` next to it")
        elif not is_passphrase(key):
            message = "the access point's key must have 8 to 63 printable ASCII characters"
            yield draft.finding_at(part, (*_WIFI, "key"), message, "write the key of the vehicle")


def not_of_a_location(draft: _draft.Draft) -> Iterator[Finding]:
    """Report `key` or `client` in a location's Wi-Fi endpoint: it only describes a check and configures nothing."""
    for name, site in draft.sites.items():
        wifi = site.location.endpoints.wifi
        for key in ("key", "client"):
            if wifi is not None and getattr(wifi, key) is not None:
                message = msg(f"`{arg(key)}` is for the access point of a vehicle, but this is the location")
                path = ("location", "endpoints", "wifi", key)
                yield draft.finding_at(_draft.Part("site", name), path, message, msg(f"remove `{arg(key)}`"))


def require_distinct_ssids(draft: _draft.Draft) -> Iterator[Finding]:
    """Require different SSIDs for the access points that one radio may join."""
    first: dict[tuple[str, str], str] = {}
    for name, wifi, _ in _vehicle_networks(draft):
        if wifi.ssid is None or wifi.role is not model.WifiRole.ACCESS_POINT:
            continue
        other = first.setdefault((wifi.interface, wifi.ssid), name)
        if other != name:
            where = draft.where(_draft.Part("vehicle", other), *_WIFI, "ssid")
            message = msg(
                f"`{arg(wifi.ssid)}` is already the access point of `{arg(other)}` ({arg(where)}), for the same radio"
            )
            hint = "give each access point its own name, also on the vehicle; or another `interface`"
            yield draft.finding_at(_draft.Part("vehicle", name), (*_WIFI, "ssid"), message, hint)


def addresses(draft: _draft.Draft) -> Iterator[Finding]:
    """Require that the gateway's address in a vehicle's network is usable there and not the vehicle's."""
    for name, vehicle in draft.vehicles.items():
        wifi, part = vehicle.endpoints.wifi, _draft.Part("vehicle", name)
        if wifi is None or wifi.client is None:
            continue
        client, path = wifi.client, (*_WIFI, "client")
        if wifi.key is None:
            message = "`client` is the address of the gateway's radio, which is configured only if there is a `key`"
            yield draft.finding_at(
                part, path, message, "add the `key` of the access point next to it, or remove `client`"
            )
        if why := why_unusable(client.address, client.network):
            yield draft.finding_at(
                part, (*path, "address"), msg(f"{arg(client.address)} {arg(why)}"), example_in(client.network)
            )
        if wifi.address is None:
            continue
        if wifi.address == client.address:
            message = msg(f"{arg(client.address)} is the address of `{arg(name)}` itself")
            yield draft.finding_at(
                part, (*path, "address"), message, msg(f"choose another one of {arg(client.network)}")
            )
        elif why := why_unusable(wifi.address, client.network):
            message = msg(f"{arg(wifi.address)} of `{arg(name)}` {arg(why)}, the network of its access point")
            yield draft.finding_at(part, (*_WIFI, "address"), message, "correct this address, or `client.network`")


def radios(draft: _draft.Draft) -> Iterator[Finding]:
    """Report a vehicle-joining radio that is the interface of the gateway's LAN."""
    for host, site, gateway in draft.valid_devices(model.Gateway):
        tested_vehicles = draft.sites[site].checklist.vehicles if site in draft.sites else None
        for name, wifi, _ in _vehicle_networks(draft):
            if wifi.interface in _lan_interfaces(gateway) and (tested_vehicles is None or name in tested_vehicles):
                message = msg(f"`{arg(wifi.interface)}` is the interface of the LAN at `{arg(host)}`, not a radio")
                hint = "write the name of a radio, for example wlan0: `iw dev` on the gateway lists them"
                yield draft.finding_at(_draft.Part("vehicle", name), (*_WIFI, "interface"), message, hint)


def _lan_interfaces(gateway: model.Gateway) -> set[str | None]:
    blocks = (gateway.network, gateway.image)
    return {block.interface for block in blocks if block is not None and block.interface is not None}


def check_access_point(draft: _draft.Draft) -> Iterator[Finding]:
    """Require settings that hostapd 2.9 (Ubuntu 20.04) supports with one radio, and a usable address."""
    for host, _, gateway in draft.valid_devices(model.Gateway):
        radio, part = gateway.access_point, _draft.Part("device", host)
        if radio is None:
            continue
        if radio.standard == "802.11ax":
            message = "hostapd 2.9 of Ubuntu 20.04 does not support 802.11ax"
            yield draft.finding_at(part, ("access_point", "standard"), message, "choose 802.11ac or an older standard")
        if radio.width_mhz != _WIDTH_MHZ:
            message = msg(f"this toolkit supports only {arg(_WIDTH_MHZ)} MHz for the access point of a gateway")
            yield draft.finding_at(part, ("access_point", "width_mhz"), message, "remove `width_mhz`")
        for name in ("tx_power_dbm", "antenna_gain_dbi"):
            if getattr(radio, name) is not None:
                message = msg(f"hostapd does not set the power: `{arg(name)}` would have no effect on a gateway")
                hint = msg(f"remove `{arg(name)}`: the radio keeps to the limit of the country")
                yield draft.finding_at(part, ("access_point", name), message, hint)
        if why := why_unusable(radio.address, radio.network):
            path = ("access_point", "address")
            yield draft.finding_at(part, path, msg(f"{arg(radio.address)} {arg(why)}"), example_in(radio.network))


def require_one_use_per_radio(draft: _draft.Draft) -> Iterator[Finding]:
    """Require one use per radio: it opens a network or joins others, and is not the LAN's interface."""
    for host, site, gateway in draft.valid_devices(model.Gateway):
        if gateway.access_point is None:
            continue
        name, path = gateway.access_point.interface, ("access_point", "interface")
        tested_vehicles = draft.sites[site].checklist.vehicles if site in draft.sites else None
        joins = [
            key
            for key, wifi, _ in _vehicle_networks(draft)
            if wifi.interface == name and (tested_vehicles is None or key in tested_vehicles)
        ]
        if name in _lan_interfaces(gateway):
            message = msg(f"`{arg(name)}` is the interface of the LAN, not a radio")
            yield draft.finding_at(
                _draft.Part("device", host), path, message, "write the name of a radio, for example wlan3"
            )
        elif joins:
            message = msg(
                f"`{arg(name)}` joins the access point of `{arg(joins[0])}`: one radio cannot open a network as well"
            )
            yield draft.finding_at(
                _draft.Part("device", host), path, message, "name another radio, here or at the vehicle"
            )


RULES: tuple[_draft.Rule, ...] = (
    require_access_point,
    not_of_a_location,
    require_distinct_ssids,
    addresses,
    radios,
    check_access_point,
    require_one_use_per_radio,
)
