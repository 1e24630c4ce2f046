"""Files of a new inventory, computed from the answers, the encryption function and the report's vehicles.

Derived values (the router's address in a network, the order of its ports) are examples if their network is one.
"""

from __future__ import annotations

import secrets
from dataclasses import dataclass, field
from ipaddress import IPv4Network
from typing import TYPE_CHECKING, Any

from atlantis_netcfg.inventory import channels, model
from atlantis_netcfg.inventory._hosts import KIND_GROUPS
from atlantis_netcfg.inventory.json_schema import modeline
from atlantis_netcfg.inventory.new_inventory import yaml_text
from atlantis_netcfg.inventory.new_inventory.answers import MOST_PARTNERS, partner_row

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from atlantis_netcfg.inventory.new_inventory.answers import (
        BridgeAnswers,
        CableAnswers,
        CentreAnswers,
        InventoryAnswers,
        SiteAnswers,
    )

_PORTS = 8
_CERTUS = {"rtt_ms": 700, "up_kbps": 352, "down_kbps": 704}
"""Rates of Iridium Certus for the report's terminal."""


@dataclass(frozen=True, slots=True)
class AnsweredNetwork:
    """A network, and whether it is an example."""

    network: IPv4Network
    is_example: bool

    @property
    def value(self) -> yaml_text.Value:
        """The network itself."""
        return yaml_text.Value(self.network, self.is_example)

    def at(self, number: int) -> yaml_text.Value:
        """Return the address with that number; a negative number counts from the end."""
        return yaml_text.Value(self.network[number], self.is_example)


def network_or_example(answer: IPv4Network | None, example: str) -> AnsweredNetwork:
    """Return the answered network, else the example."""
    return AnsweredNetwork(answer if answer is not None else IPv4Network(example), answer is None)


def value_or_example(answer: Any, example: Any) -> yaml_text.Value:  # noqa: ANN401 - any scalar
    """Return the answered value, else the example."""
    return yaml_text.Value(answer if answer is not None else example, answer is None)


@dataclass(slots=True)
class InventoryWriter:
    """Collects the files of one inventory."""

    answers: InventoryAnswers
    vehicles: Mapping[str, Mapping[str, Any]]
    """Vehicles from the report, without endpoints."""
    encrypt: Callable[[str], str] | None
    """Encryption function; None: there is no vault password, so secrets are examples."""
    hosts: dict[str, dict[str, str]] = field(default_factory=dict)
    """Site to hosts and their kinds."""
    trees: dict[str, tuple[str, str, dict[str, yaml_text.Tree]]] = field(default_factory=dict)
    """File to its first comment, schema and content."""

    @property
    def centre(self) -> CentreAnswers:
        """The answers about the control centre."""
        return self.answers.control_centre

    @property
    def vpn(self) -> AnsweredNetwork:
        """Network of all tunnel addresses."""
        return network_or_example(self.answers.vpn.network, "10.80.0.0/16")

    @property
    def pools(self) -> list[IPv4Network]:
        """Address pools: the first for infrastructure, the others for partners."""
        pools = self.vpn.network.subnets(new_prefix=24)
        return [next(pools) for _ in range(1 + MOST_PARTNERS)]

    def tunnel(self, number: int) -> yaml_text.Value:
        """Return an address of the infrastructure's pool."""
        return yaml_text.Value(self.pools[0][number], self.vpn.is_example)

    def secret(self, name: str) -> yaml_text.Tree:
        """Return a new encrypted secret, or an example if encryption is unavailable."""
        if self.encrypt is None:
            return yaml_text.Value(f"EXAMPLE-{name}", is_example=True)
        return yaml_text.VaultSecret(self.encrypt(secrets.token_urlsafe(18)))

    def add(self, site: str, host: str, kind: str, comment: str, device: Mapping[str, yaml_text.Tree]) -> None:
        """Add a host with its file."""
        self.hosts.setdefault(site, {})[host] = kind
        tree: dict[str, yaml_text.Tree] = {"device": {"kind": kind, **device}}
        self.trees[f"host_vars/{host}.yml"] = (comment, kind, tree)


def files(
    answers: InventoryAnswers, vehicles: Mapping[str, Mapping[str, Any]], encrypt: Callable[[str], str] | None
) -> dict[str, str]:
    """Return every file of the inventory, by path."""
    writer = InventoryWriter(answers, vehicles, encrypt)
    _control_centre(writer)
    for number, (name, place) in enumerate(answers.sites.items(), start=1):
        _add_site(writer, number, name, place)
    _add_partners(writer)
    _add_vehicles(writer)
    is_example = any(yaml_text.has_examples(tree) for _, _, tree in writer.trees.values()) or yaml_text.has_examples(
        _pilot(writer, example_values=False)
    )
    pilot: dict[str, yaml_text.Tree] = {"pilot": _pilot(writer, example_values=is_example)}
    writer.trees["group_vars/all/pilot.yml"] = ("What holds for the whole pilot.", "pilot", pilot)
    writer.trees["hosts.yml"] = (
        "Every host of the pilot: once under its site, once under what it is.",
        "hosts",
        _hosts(writer),
    )
    return {path: _text(path, *row) for path, row in sorted(writer.trees.items())}


def _text(path: str, comment: str, schema: str, tree: dict[str, yaml_text.Tree]) -> str:
    comments = [modeline(schema, path.count("/")), f"# {comment}"]
    if "host_vars/" in path:
        comments.append("# Secrets: ansible-vault encrypt_string --stdin-name password")
    if yaml_text.has_examples(tree):
        comments.append(
            "# Replace what is marked EXAMPLE, and delete the mark: `provision inventory validate --examples` lists it."
        )
    return yaml_text.document(tree, comments)


def _hosts(writer: InventoryWriter) -> dict[str, yaml_text.Tree]:
    sites: dict[str, yaml_text.Tree] = {
        site: {"hosts": dict.fromkeys(hosts, None)} for site, hosts in writer.hosts.items()
    }
    groups: dict[str, yaml_text.Tree] = {"sites": {"children": sites}}
    for group, kind in KIND_GROUPS.items():
        group_hosts = [host for hosts in writer.hosts.values() for host, sort in hosts.items() if sort == kind]
        if group_hosts:
            groups[group] = {"hosts": dict.fromkeys(group_hosts, None)}
    return {"all": {"children": groups}}


def _country(answers: InventoryAnswers) -> yaml_text.Value:
    return yaml_text.Value(answers.pilot.country, answers.pilot.country == channels.UNKNOWN)


def _pilot(writer: InventoryWriter, *, example_values: bool) -> dict[str, yaml_text.Tree]:
    answers = writer.answers
    servers = answers.pilot.time_servers or (None,)
    example = ("ntp.example.org", "192.0.2.123")
    names = [
        value_or_example(None if server is None else f"time server {n}", example[0])
        for n, server in enumerate(servers, 1)
    ]
    pilot: dict[str, yaml_text.Tree] = {
        "name": answers.pilot.name,
        "example_values": example_values,
        "country": _country(answers),
        "time_zone": answers.pilot.time_zone
        or yaml_text.Value(channels.TIME_ZONES[answers.pilot.country], answers.pilot.country == channels.UNKNOWN),
        "time_servers": [
            {"name": name, "address": value_or_example(server, example[1])}
            for name, server in zip(names, servers, strict=True)
        ],
        "vpn": {
            "server": f"{writer.centre.name}-vpn",
            "endpoint": value_or_example(answers.vpn.endpoint, "203.0.113.2"),
            "endpoint_name": value_or_example(answers.vpn.endpoint_name, "vpn.example.org"),
            "port": 1194,
            "transport": "udp",
            "network": writer.vpn.value,
            "infrastructure": yaml_text.Value(writer.pools[0], writer.vpn.is_example),
        },
    }
    if (release := answers.pilot.ros_distribution) is not None:
        pilot["dds"] = {"distribution": release.value, "over": "vpn"}
        origin = "snapshot" if release is model.RosDistribution.FOXY else "live"
        pilot["gateways"] = {"ros2": {"origin": origin}}
    return pilot


def _add_partners(writer: InventoryWriter) -> None:
    rows: dict[str, yaml_text.Tree] = {
        name: {"full_name": full_name, "vpn_pool": yaml_text.Value(pool, writer.vpn.is_example)}
        for (name, full_name), pool in zip(
            map(partner_row, writer.answers.pilot.partners), writer.pools[1:], strict=False
        )
    }
    comment = "Organisations that join through the VPN, each with a pool of tunnel addresses of its own."
    writer.trees["group_vars/all/partners.yml"] = (comment, "partners", {"partners": rows})


def _add_vehicles(writer: InventoryWriter) -> None:
    rows: dict[str, yaml_text.Tree] = {}
    partners = [partner_row(text)[0] for text in writer.answers.pilot.partners]
    for key, vehicle in writer.vehicles.items():
        partner = vehicle.get("partner")
        row = {name: value for name, value in vehicle.items() if name not in {"endpoints", "telemetry"}}
        row["partner"] = partner if partner in partners else None
        row["aliases"] = tuple(vehicle.get("aliases", ()))
        row["table3"] = tuple(vehicle["table3"])
        rows[key] = {name: yaml_text.Value(value) if isinstance(value, tuple) else value for name, value in row.items()}
    comment = "The vehicles of the report's Table 3. Without `endpoints:` a person confirms each."
    writer.trees["group_vars/all/vehicles.yml"] = (comment, "vehicles", {"vehicles": rows})


def _lan(lan: AnsweredNetwork, name: str, place: SiteAnswers | CentreAnswers) -> dict[str, yaml_text.Tree]:
    half = lan.network.num_addresses // 2
    return {
        "network": lan.value,
        "gateway": lan.at(1),
        "domain": value_or_example(place.domain, f"{name}.example.org"),
        "dhcp": {"first": lan.at(half), "last": lan.at(-2)},
    }


def _management(writer: InventoryWriter, management: AnsweredNetwork) -> dict[str, yaml_text.Tree]:
    is_example = management.is_example or writer.vpn.is_example
    return {
        "network": management.value,
        "technician": management.at(10),
        "admit": yaml_text.Value((management.network, writer.pools[0]), is_example),
    }


def _rate(rate: model.LinkRate | None, example: Mapping[str, float]) -> dict[str, yaml_text.Tree]:
    return {key: value_or_example(getattr(rate, key, None), value) for key, value in example.items()}


def _probe_targets(answer: tuple[Any, ...], number: int, *, is_required: bool) -> dict[str, yaml_text.Tree]:
    if answer:
        return {"canaries": yaml_text.Value(answer)}
    if not is_required:
        return {}
    return {"canaries": yaml_text.Value((f"198.51.100.{number}", f"198.51.100.{number + 1}"), is_example=True)}


def _ports(place: SiteAnswers | CentreAnswers, links: list[str]) -> yaml_text.Tree:
    """Return the router's ports: links first, the management port last, the local network between."""
    is_example = place.router_ports is None
    count = place.router_ports or max(_PORTS, len(links) + 2)
    ports: list[yaml_text.Tree] = [
        {"name": yaml_text.Value(f"ether{number}", is_example), "use": "link", "link": link}
        for number, link in enumerate(links, start=1)
    ]
    ports += [{"name": yaml_text.Value(f"ether{n}", is_example), "use": "lan"} for n in range(len(links) + 1, count)]
    return [*ports, {"name": yaml_text.Value(f"ether{count}", is_example), "use": "management"}]


def _access(writer: InventoryWriter, address: yaml_text.Value) -> dict[str, yaml_text.Tree]:
    return {"address": address, "user": "provision", "password": writer.secret("password")}


def _bridge_names(writer: InventoryWriter, site: str) -> tuple[str, str]:
    """Return the bridge's link name at the control centre, and its CPE; a single bridge needs no site in its name."""
    bridge_sites = [name for name, place in writer.answers.sites.items() if place.wifi_bridge is not None]
    centre = writer.centre.name
    return ("wifi-ptp", f"{centre}-cpe") if len(bridge_sites) == 1 else (f"wifi-{site}", f"{centre}-cpe-{site}")


def _add_control_centre(number: int, bridge: BridgeAnswers) -> AnsweredNetwork:
    return network_or_example(bridge.network, f"10.10.{number}.0/29")


def _control_centre(writer: InventoryWriter) -> None:
    centre = writer.centre
    lan = network_or_example(centre.lan, "10.64.0.0/24")
    management = network_or_example(centre.management, "10.64.100.0/24")
    bridges = [
        (number, name, place.wifi_bridge)
        for number, (name, place) in enumerate(writer.answers.sites.items(), start=1)
        if place.wifi_bridge is not None
    ]
    served_links: list[yaml_text.Tree] = [
        {
            "name": _bridge_names(writer, name)[0],
            "device": _bridge_names(writer, name)[1],
            "network": _add_control_centre(number, bridge).value,
            "address": _add_control_centre(number, bridge).at(1),
            "carries": name,
        }
        for number, name, bridge in bridges
    ]
    site: dict[str, yaml_text.Tree] = {
        "title": centre.title or centre.name,
        "lan": _lan(lan, centre.name, centre),
        "management": _management(writer, management),
        "bearers": [_cable(centre.uplink, "uplink", "203.0.113.0/29", 1, needs_probe_targets=False)],
    }
    if served_links:
        site["served_links"] = served_links
    site["checklist"] = {"vehicles": []}
    writer.trees[f"group_vars/{centre.name}.yml"] = (
        "The control centre: far end of all links.",
        "site",
        {"site": site},
    )
    links = ["uplink", *(_bridge_names(writer, name)[0] for _, name, _ in bridges)]
    writer.add(
        centre.name,
        f"{centre.name}-router",
        "router",
        "Router of the control centre.",
        {
            "access": _access(writer, management.at(1)),
            "ports": _ports(centre, links),
            "forwards": [{"transport": "udp", "port": 1194, "to": f"{centre.name}-vpn"}],
        },
    )
    writer.add(
        centre.name,
        f"{centre.name}-vpn",
        "vpn_server",
        "Runs the OpenVPN server.",
        {"address": lan.at(10), "vpn_address": writer.tunnel(1)},
    )
    if centre.computer:
        writer.add(
            centre.name,
            f"{centre.name}-control",
            "control_centre",
            "Runs the control centre's services.",
            {"address": lan.at(11), "vpn_address": writer.tunnel(2)},
        )


def _cable(
    cable: CableAnswers, name: str, example: str, number: int, *, needs_probe_targets: bool
) -> dict[str, yaml_text.Tree]:
    network = network_or_example(cable.network, example)
    return {
        "name": name,
        "kind": "ethernet",
        "metered": False,
        "network": network.value,
        "address": yaml_text.Value(cable.address) if cable.address is not None else network.at(2),
        "gateway": yaml_text.Value(cable.gateway) if cable.gateway is not None else network.at(1),
        **_probe_targets(cable.canaries, number, is_required=needs_probe_targets),
        "rate": _rate(cable.rate, {"rtt_ms": 10, "up_kbps": 100_000, "down_kbps": 100_000}),
    }


def _add_site(writer: InventoryWriter, number: int, name: str, place: SiteAnswers) -> None:
    lan = network_or_example(place.lan, f"10.64.{number}.0/24")
    management = network_or_example(place.management, f"10.64.{100 + number}.0/24")
    site_links = _links(number, name, place)
    site: dict[str, yaml_text.Tree] = {
        "title": place.title or name,
        "lan": _lan(lan, name, place),
        "management": _management(writer, management),
        "bearers": site_links,
        "location": {"table3": []},
    }
    writer.trees[f"group_vars/{name}.yml"] = (
        f"The test site {name}; its links in order of preference.",
        "site",
        {"site": site},
    )
    links = [str(link["name"]) for link in site_links]
    router = f"{name}-router"
    writer.add(
        name,
        router,
        "router",
        f"Router of {name}.",
        {
            "access": _access(writer, management.at(1)),
            "ports": _ports(place, links),
            "vpn_client": {
                "certificate": "atlantis-vpn",
                "user": router[:27],
                "password": writer.secret("vpn"),
                "address": writer.tunnel(10 + number),
            },
        },
    )
    _boxes(writer, number, name, place)
    if place.gateway is not None:
        gateway: dict[str, yaml_text.Tree] = {"address": lan.at(10), "vpn_address": writer.tunnel(100 + number)}
        if place.gateway.ssh_key is not None:
            gateway["image"] = {"layout": place.gateway.layout.value, "ssh_keys": [place.gateway.ssh_key]}
        writer.add(name, f"{name}-gateway", "gateway", f"Data gateway computer of {name}.", gateway)


def _links(number: int, name: str, place: SiteAnswers) -> list[dict[str, yaml_text.Tree]]:
    kinds = [place.wifi_bridge, place.cable, place.lte, place.satellite]
    several = len([kind for kind in kinds if kind is not None]) > 1
    first = 10 * number
    links: list[dict[str, yaml_text.Tree]] = []
    if (bridge := place.wifi_bridge) is not None:
        network = _add_control_centre(number, bridge)
        links.append(
            {
                "name": "wifi-ptp",
                "kind": "wifi_ptp",
                "device": f"{name}-cpe",
                "metered": False,
                "network": network.value,
                "address": network.at(2),
                "gateway": network.at(1),
                **_probe_targets(bridge.canaries, first, is_required=several),
                "rate": _rate(bridge.rate, {"rtt_ms": 4, "up_kbps": 50_000, "down_kbps": 50_000}),
            }
        )
    if place.cable is not None:
        example = f"10.13.{number}.0/29"
        links.append(_cable(place.cable, "cable", example, first + 2, needs_probe_targets=several))
    if (lte := place.lte) is not None:
        rate = _rate(lte.rate, {"rtt_ms": 60, "up_kbps": 20_000, "down_kbps": 20_000})
        probe_targets = _probe_targets(lte.canaries, first + 4, is_required=several)
        links.append(
            _metered_link(
                "4g", "lte", f"{name}-4g", network_or_example(lte.network, f"10.11.{number}.0/29"), lte.price_per_mb
            )
        )
        links[-1].update({**probe_targets, "rate": rate})
    if (satellite := place.satellite) is not None:
        network = network_or_example(satellite.network, f"10.12.{number}.0/29")
        links.append(_metered_link("satellite", "satellite", f"{name}-sat", network, satellite.price_per_mb))
        links[-1]["rate"] = dict(_CERTUS)
    return links


def _metered_link(
    name: str, kind: str, device: str, network: AnsweredNetwork, price: float | None
) -> dict[str, yaml_text.Tree]:
    billing: dict[str, yaml_text.Tree] = {} if price is None else {"billing": {"price_per_mb": float(price)}}
    return {
        "name": name,
        "kind": kind,
        "device": device,
        "metered": True,
        **billing,
        "network": network.value,
        "address": network.at(2),
        "gateway": network.at(1),
    }


def _boxes(writer: InventoryWriter, number: int, name: str, place: SiteAnswers) -> None:
    """Add the devices of a site's links."""
    if place.wifi_bridge is not None:
        _add_bridge(writer, number, name, place.wifi_bridge)
    if (lte := place.lte) is not None:
        unit: dict[str, yaml_text.Tree] = {
            "address": network_or_example(lte.network, f"10.11.{number}.0/29").at(1),
            "driver": lte.driver.value,
        }
        if lte.driver in {model.LteDriver.ROUTEROS, model.LteDriver.RUTOS}:
            unit["access"] = {"user": "provision", "password": writer.secret("password")}
        if lte.apn is not None:
            unit["sim"] = {"apn": lte.apn}
        writer.add(name, f"{name}-4g", "lte_router", f"4G unit of {name}.", unit)
    if (satellite := place.satellite) is not None:
        address = network_or_example(satellite.network, f"10.12.{number}.0/29").at(1)
        terminal: dict[str, yaml_text.Tree] = {"model": "Thales VesseLINK", "address": address}
        writer.add(name, f"{name}-sat", "satellite_terminal", f"Satellite terminal of {name}.", terminal)


def _add_bridge(writer: InventoryWriter, number: int, name: str, bridge: BridgeAnswers) -> None:
    far = _bridge_names(writer, name)[1]
    near = f"{name}-cpe"
    network = _add_control_centre(number, bridge)
    key = writer.secret("bridge-key")
    radio: dict[str, yaml_text.Tree] = {
        "ssid": value_or_example(bridge.ssid, f"EXAMPLE-{name}"),
        "protocol": bridge.protocol,
        "standard": "802.11ac",
        "band": "5ghz",
        "frequency_mhz": value_or_example(bridge.frequency_mhz, 5500),
        "width_mhz": 20,
        "country": _country(writer.answers),
        "outdoor": True,
        "key": key,
        "tx_power_dbm": value_or_example(bridge.tx_power_dbm, 10),
        "antenna_gain_dbi": value_or_example(bridge.antenna_gain_dbi, 16),
        "distance_m": value_or_example(bridge.distance_m, 150),
    }
    comment = "Both ends of a bridge agree on everything below `ptp` but `peer` and `mode`."
    for site, host, peer, mode, address in (
        (writer.centre.name, far, near, "access_point", 3),
        (name, near, far, "station", 4),
    ):
        device: dict[str, yaml_text.Tree] = {
            "access": _access(writer, network.at(address)),
            "ptp": {"peer": peer, "mode": mode, **radio},
        }
        writer.add(site, host, "cpe", comment, device)
