"""`ip -j`: keys and order of iproute2 6.1 (`ip/ipaddress.c`, `ip/iproute.c`, `ip/ipneigh.c`), captured on a real one.

`iw`: the output of iw 5.4 to 6.7 (`link.c`, `station.c`, `interface.c`, `reg.c`), from general knowledge.
"""

from __future__ import annotations

import json
from ipaddress import AddressValueError, IPv4Address, IPv4Interface, IPv4Network
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from atlantis_netcfg.emulator.linux import _spec


ProgramOutput = tuple[int, str, str]
_FOREVER = 4294967295
_OF_CARDS = ("addr", "link")
"""Objects whose rows are interfaces."""
_LOOPBACK = {"ifindex": 1, "ifname": "lo", "flags": ["LOOPBACK", "UP", "LOWER_UP"], "mtu": 65536, "qdisc": "noqueue"}


def ip(spec: _spec.ComputerSpec, argv: Sequence[str]) -> ProgramOutput:
    """Emulate read commands of `ip`; unsupported ones fail with the program's own message."""
    words = list(argv[1:])
    statistics = "-s" in words
    words = [word for word in words if word not in {"-j", "-json", "-s", "-d"}]
    if not words:
        return 255, "", "Usage: ip [ OPTIONS ] OBJECT { COMMAND | help }\n"
    what, rest = words[0], [word for word in words[1:] if word != "show"]
    if what == "route" and rest[:1] == ["get"]:
        return _get_route(spec, rest[1:])
    selectors = dict(zip(rest[::2], rest[1::2], strict=False)) if rest[:1] != ["default"] else {"to": "default"}
    device = selectors.get("dev")
    if device is not None and device != "lo" and spec.interface(device) is None:
        message = f'Device "{device}" does not exist.\n' if what in _OF_CARDS else f'Cannot find device "{device}"\n'
        return 1, "", message
    rows = {
        "addr": lambda: _interfaces(spec, addresses=True, statistics=statistics),
        "link": lambda: _interfaces(spec, addresses=False, statistics=statistics),
        "route": lambda: _routes(spec, selectors),
        "neigh": lambda: _neighbours(spec, selectors.get("to")),
        "rule": lambda: _RULES,
    }.get(what)
    if rows is None:
        return 255, "", f'Object "{what}" is unknown, try "ip help".\n'
    return 0, _render_json(_of(device, rows(), what)), ""


def _of(device: str | None, rows: Iterable[dict[str, Any]], what: str) -> list[dict[str, Any]]:
    """Select the rows of a device; with `dev`, rows of routes and neighbours omit its name."""
    name = "ifname" if what in _OF_CARDS else "dev"
    matches = [row for row in rows if device is None or row.get(name) == device]
    is_redundant = what not in _OF_CARDS and device is not None
    return [{key: value for key, value in row.items() if not (is_redundant and key == "dev")} for row in matches]


def _render_json(rows: Sequence[dict[str, Any]]) -> str:
    return json.dumps(rows, separators=(",", ":")) + "\n" if rows else "[]\n"


_RULES: list[dict[str, Any]] = [
    {"priority": 0, "src": "all", "table": "local"},
    {"priority": 32766, "src": "all", "table": "main"},
    {"priority": 32767, "src": "all", "table": "default"},
]


def _interfaces(spec: _spec.ComputerSpec, *, addresses: bool, statistics: bool) -> list[dict[str, Any]]:
    rows = [_loopback(addresses=addresses)]
    for number, interface in enumerate(spec.interfaces, start=2):
        row = _interface(number, interface, linkmode=not addresses)
        if statistics:
            row["stats64"] = _statistics(interface)
        if addresses:
            row["addr_info"] = _addresses(interface)
        rows.append(row)
    return rows


def _loopback(*, addresses: bool) -> dict[str, Any]:
    row: dict[str, Any] = {
        **_LOOPBACK,
        "operstate": "UNKNOWN",
        **({} if addresses else {"linkmode": "DEFAULT"}),
        "group": "default",
    }
    row |= {"txqlen": 1000, "link_type": "loopback"}
    row |= {"address": "00:00:00:00:00:00", "broadcast": "00:00:00:00:00:00"}
    life = {"valid_life_time": _FOREVER, "preferred_life_time": _FOREVER}
    inner = {"family": "inet", "local": "127.0.0.1", "prefixlen": 8, "scope": "host", "label": "lo", **life}
    return row | ({"addr_info": [inner]} if addresses else {})


def _interface(number: int, interface: _spec.InterfaceSpec, *, linkmode: bool) -> dict[str, Any]:
    tunnel = interface.mac is None
    kind = ["POINTOPOINT", "MULTICAST", "NOARP"] if tunnel else ["BROADCAST", "MULTICAST"]
    flags = [*(() if interface.up else ("NO-CARRIER",)), *kind, "UP", *(("LOWER_UP",) if interface.up else ())]
    row: dict[str, Any] = {"ifindex": number, "ifname": interface.name, "flags": flags, "mtu": interface.mtu}
    row |= {"qdisc": "mq", "operstate": ("UNKNOWN" if tunnel else "UP") if interface.up else "DOWN"}
    row |= {"linkmode": "DORMANT" if interface.wireless else "DEFAULT"} if linkmode else {}
    row |= {"group": "default", "txqlen": 500 if tunnel else 1000, "link_type": "none" if tunnel else "ether"}
    return row if tunnel else row | {"address": (interface.mac or "").lower(), "broadcast": "ff:ff:ff:ff:ff:ff"}


def _statistics(interface: _spec.InterfaceSpec) -> dict[str, Any]:
    plain = {"bytes": 1_204_332, "packets": 9_120}
    into = {**plain, "errors": interface.rx_errors, "dropped": 0, "over_errors": 0, "multicast": 0}
    out = {**plain, "errors": interface.tx_errors, "dropped": 0, "carrier_errors": 0, "collisions": 0}
    return {"rx": into, "tx": out}


def _addresses(interface: _spec.InterfaceSpec) -> list[dict[str, Any]]:
    seen_networks: set[IPv4Network] = set()
    rows = []
    for address in interface.addresses:
        network = IPv4Interface(address.address).network
        rows.append(_address(interface, address, second=network in seen_networks))
        seen_networks.add(network)
    return rows


def _address(interface: _spec.InterfaceSpec, address: _spec.AddressSpec, *, second: bool) -> dict[str, Any]:
    whole = IPv4Interface(address.address)
    row: dict[str, Any] = {"family": "inet", "local": str(whole.ip), "prefixlen": whole.network.prefixlen}
    if interface.mac is not None:
        row["broadcast"] = str(whole.network.broadcast_address)
    row["scope"] = "global"
    row |= {"secondary": True} if second else {}
    row |= {"dynamic": True} if address.lease_s is not None else {}
    lifetime_s = _FOREVER if address.lease_s is None else address.lease_s
    return row | {"label": interface.name, "valid_life_time": lifetime_s, "preferred_life_time": lifetime_s}


def _routes(spec: _spec.ComputerSpec, selectors: dict[str, str]) -> list[dict[str, Any]]:
    """Return routes in kernel order; of several addresses in one network, the first gives the route."""
    rows = [_route(spec, way) for way in spec.routes]
    rows += [row for interface in spec.interfaces for row in _connected_routes(interface)]
    if selectors.get("table", "main") not in {"main", "all"}:
        return []
    destination = selectors.get("to")
    return sorted((row for row in rows if destination in {None, row["dst"]}), key=_route_sort_key)


def _route_sort_key(row: dict[str, Any]) -> tuple[IPv4Network, int]:
    return IPv4Network("0.0.0.0/0" if row["dst"] == "default" else row["dst"]), row.get("metric", 0)


def _route(spec: _spec.ComputerSpec, way: _spec.RouteSpec) -> dict[str, Any]:
    row: dict[str, Any] = {"dst": way.to}
    row |= {"gateway": way.via} if way.via is not None else {}
    row["dev"] = way.dev
    row |= {"protocol": way.protocol} if way.protocol != "boot" else {}
    row |= {"scope": "link"} if way.via is None else {}
    interface = spec.interface(way.dev)
    if way.protocol == "dhcp" and interface is not None and interface.addresses:
        row["prefsrc"] = str(IPv4Interface(interface.addresses[0].address).ip)
    row |= {"metric": way.metric} if way.metric is not None else {}
    return row | {"flags": _flags(interface)}


def _connected_routes(interface: _spec.InterfaceSpec) -> list[dict[str, Any]]:
    routes: dict[str, dict[str, Any]] = {}
    for whole in (IPv4Interface(address.address) for address in interface.addresses):
        row = {"dst": str(whole.network), "dev": interface.name, "protocol": "kernel", "scope": "link"}
        routes.setdefault(str(whole.network), row | {"prefsrc": str(whole.ip), "flags": _flags(interface)})
    return list(routes.values())


def _flags(interface: _spec.InterfaceSpec | None) -> list[str]:
    return [] if interface is None or interface.up else ["linkdown"]


def _neighbours(spec: _spec.ComputerSpec, address: str | None) -> list[dict[str, Any]]:
    return [
        {
            "dst": neighbour.address,
            "dev": neighbour.dev,
            **({} if neighbour.mac is None else {"lladdr": neighbour.mac.lower()}),
            "state": [neighbour.state if neighbour.mac is not None else "FAILED"],
        }
        for neighbour in spec.neighbours
        if address in {None, neighbour.address}
    ]


def _get_route(spec: _spec.ComputerSpec, words: Sequence[str]) -> ProgramOutput:
    try:
        address = str(IPv4Address(words[0]))
    except (IndexError, AddressValueError):
        return 1, "", 'Error: any valid prefix is expected rather than "".\n'
    way = spec.towards(address)
    if way is None:
        return 2, "", "RTNETLINK answers: Network is unreachable\n"
    device, via = way
    row: dict[str, Any] = {"dst": address}
    row |= {"gateway": via} if via is not None else {}
    row["dev"] = device
    interface = spec.interface(device)
    if interface is not None and interface.addresses:
        row["prefsrc"] = str(IPv4Interface(interface.addresses[0].address).ip)
    return 0, _render_json([row | {"flags": [], "uid": 0, "cache": []}]), ""


_ARP_S = 3.0
"""Seconds for three ARP requests, one a second (arp(7): mcast_solicit, retrans_time)."""
_WITH_VALUE = ("-c", "-i", "-W", "-I", "-s", "-w")


def ping(spec: _spec.ComputerSpec, argv: Sequence[str]) -> ProgramOutput:
    """Return the output of a ping at once, without waiting."""
    if len(argv) < 2:  # noqa: PLR2004 - the program and a target
        return 1, "", "ping: usage error: Destination address required\n"
    options = {word: argv[place + 1] for place, word in enumerate(argv[:-1]) if word in _WITH_VALUE}
    target, count = argv[-1], int(options.get("-c", "1"))
    through = options.get("-I")
    if not _is_address(target):
        return 2, "", f"ping: {target}: Name or service not known\n"
    if through is not None and spec.interface(through) is None:
        return 2, "", f"ping: SO_BINDTODEVICE {through}: No such device\n"
    way = spec.towards(target)
    if through is None and way is None:
        return 2, "", "ping: connect: Network is unreachable\n"
    device = through or (way[0] if way is not None else "")
    interface = spec.interface(device)
    source = "0.0.0.0"  # noqa: S104 - printed
    if interface is not None and interface.addresses:
        source = str(IPv4Interface(interface.addresses[0].address).ip)
    head = f"PING {target} ({target}) " + (f"from {source} {through}: " if through else "") + "56(84) bytes of data.\n"
    interval = float(options.get("-i", "1"))
    waits = (interval, float(options.get("-W", "10")))
    echo = spec.echoes.get(target)
    if echo is None or interface is None or not interface.up:
        on_segment = (
            interface is not None and interface.up and (way is None or way[1] is None) and interface.mac is not None
        )
        return 1, head + _silence(target, source, count, waits, on_segment=on_segment), ""
    lines, reply_count = _answers(target, echo, count)
    return (0 if reply_count else 1), head + lines + _ping_summary(target, count, reply_count, interval, echo), ""


def _is_address(text: str) -> bool:
    try:
        IPv4Address(text)
    except AddressValueError:
        return False
    return True


def _answers(target: str, echo: _spec.EchoSpec, count: int) -> tuple[str, int]:
    """Format the responses and count them; losses are spread evenly, at the end of each interval."""
    sequence_numbers = [number for number in range(1, count + 1) if not is_lost(number, echo.loss_percent)]
    lines = (
        f"64 bytes from {target}: icmp_seq={number} ttl=64 time={_time(echo.rtt_ms)} ms\n"
        for number in sequence_numbers
    )
    return "".join(lines), len(sequence_numbers)


def is_lost(number: int, percent: float) -> bool:
    """Return whether a message is lost at this loss rate."""
    return int(number * percent / 100) > int((number - 1) * percent / 100)


def _time(value: float) -> str:
    """Format a time with three figures, as iputils does."""
    digits = next((digits for least, digits in ((100, 0), (10, 1), (1, 2)) if value >= least), 3)
    return f"{value:.{digits}f}"


def _percent(count: int, reply_count: int) -> str:
    return f"{100 * (count - reply_count) / count:.6g}%"


def _ping_summary(target: str, count: int, reply_count: int, interval: float, echo: _spec.EchoSpec) -> str:
    took = round((count - 1) * interval * 1000)
    head = f"\n--- {target} ping statistics ---\n{count} packets transmitted, {reply_count} received, "
    rtt = f"{echo.rtt_ms:.3f}"
    tail = f"rtt min/avg/max/mdev = {rtt}/{rtt}/{rtt}/0.000 ms\n" if reply_count else "\n"
    return f"{head}{_percent(count, reply_count)} packet loss, time {took}ms\n{tail}"


def _silence(target: str, source: str, count: int, waits: tuple[float, float], *, on_segment: bool) -> str:
    """Format a ping without response; on a segment, ARP fails after some seconds and ping may report it."""
    interval, patience = waits
    unreachable = on_segment and (count - 1) * interval + patience > _ARP_S
    lines = [f"From {source} icmp_seq={number} Destination Host Unreachable\n" for number in range(1, count + 1)]
    errors = f"+{count} errors, " if unreachable else ""
    took = round((count - 1) * interval * 1000)
    middle = f"\n--- {target} ping statistics ---\n{count} packets transmitted, 0 received, "
    return f"{''.join(lines) if unreachable else ''}{middle}{errors}100% packet loss, time {took}ms\n\n"


_NO_DEVICE = (237, "", "command failed: No such device (-19)\n")
_USAGE = (1, "", "Usage:\tiw [options] command\n")


def iw(spec: _spec.ComputerSpec, argv: Sequence[str]) -> ProgramOutput:
    """Emulate `iw reg get` and `iw dev NAME link|info|station dump`."""
    words = list(argv[1:])
    if words == ["reg", "get"]:
        return 0, _REGULATION.format(country=spec.country, region=_REGIONS.get(spec.country, "ETSI")), ""
    if len(words) < 3 or words[0] != "dev":  # noqa: PLR2004 - dev, its name, a command
        return _USAGE
    interface = spec.interface(words[1])
    if interface is None or not interface.wireless:
        return _NO_DEVICE
    renderer = {"link": _link, "info": _info, "station dump": _stations}.get(" ".join(words[2:]))
    return _USAGE if renderer is None else (0, renderer(interface), "")


_REGIONS = {"00": "UNSET"}
_REGULATION = """global
country {country}: DFS-{region}
\t(2400 - 2483 @ 40), (N/A, 20), (N/A)
\t(5150 - 5250 @ 80), (N/A, 23), (N/A), NO-OUTDOOR, AUTO-BW
\t(5250 - 5350 @ 80), (N/A, 20), (0 ms), NO-OUTDOOR, DFS, AUTO-BW
\t(5470 - 5725 @ 160), (N/A, 27), (0 ms), DFS

"""


def _link(interface: _spec.InterfaceSpec) -> str:
    there = interface.association
    if there is None or not interface.up or interface.type == "AP":
        return "Not connected.\n"
    return (
        f"Connected to {there.bssid.lower()} (on {interface.name})\n"
        f"\tSSID: {there.ssid}\n"
        f"\tfreq: {there.frequency_mhz}\n"
        f"\tRX: {there.tx_packets * 210} bytes ({there.tx_packets} packets)\n"
        f"\tTX: {there.tx_packets * 180} bytes ({there.tx_packets} packets)\n"
        f"\tsignal: {there.signal_dbm} dBm\n"
        f"\trx bitrate: {there.rate_mbps:.1f} MBit/s\n"
        f"\ttx bitrate: {there.rate_mbps:.1f} MBit/s\n"
        "\tbss flags:\tshort-slot-time\n"
        "\tdtim period:\t2\n"
        "\tbeacon int:\t100\n"
    )


def _info(interface: _spec.InterfaceSpec) -> str:
    there = interface.association if interface.up else None
    ssid = "" if there is None else f"\tssid {there.ssid}\n"
    return (
        f"Interface {interface.name}\n"
        "\tifindex 3\n"
        "\twdev 0x1\n"
        f"\taddr {(interface.mac or '').lower()}\n"
        f"{ssid}"
        f"\ttype {interface.type}\n"
        "\twiphy 0\n"
        f"{'' if there is None else _channel(there)}"
        "\ttxpower 20.00 dBm\n"
    )


def _channel(there: _spec.AssociationSpec) -> str:
    number = (there.frequency_mhz - 5000) // 5 if there.frequency_mhz > 5000 else (there.frequency_mhz - 2407) // 5  # noqa: PLR2004 - MHz
    return f"\tchannel {number} ({there.frequency_mhz} MHz), width: 20 MHz, center1: {there.frequency_mhz} MHz\n"


def _level(there: _spec.AssociationSpec) -> str:
    chains = f" [{', '.join(map(str, there.chains_dbm))}]" if there.chains_dbm else ""
    return f"{there.signal_dbm}{chains} dBm"


def _stations(interface: _spec.InterfaceSpec) -> str:
    if interface.association is None or not interface.up:
        return ""
    stations = interface.stations if interface.type == "AP" else (interface.association,)
    return "".join(_station(interface.name, station) for station in stations)


def _station(radio: str, there: _spec.AssociationSpec) -> str:
    lines = (
        ("inactive time:", f"{there.inactive_ms} ms"),
        ("rx bytes:", there.tx_packets * 210),
        ("rx packets:", there.tx_packets),
        ("tx bytes:", there.tx_packets * 180),
        ("tx packets:", there.tx_packets),
        ("tx retries:", there.tx_retries),
        ("tx failed:", there.tx_failed),
        ("rx drop misc:", 2),
        ("signal:  ", _level(there)),
        ("signal avg:", _level(there)),
        ("tx bitrate:", f"{there.rate_mbps:.1f} MBit/s"),
        ("rx bitrate:", f"{there.rate_mbps:.1f} MBit/s"),
        ("authorized:", "yes"),
        ("authenticated:", "yes"),
        ("associated:", "yes"),
        ("preamble:", "long"),
        ("WMM/WME:", "yes"),
        ("MFP:\t", "no"),
        ("TDLS peer:", "no"),
        ("DTIM period:", 2),
        ("beacon interval:100", ""),
        ("short slot time:yes", ""),
        ("connected time:", f"{there.connected_s} seconds"),
    )
    text = "".join(f"\t{name}\t{value}\n" if value != "" else f"\t{name}\n" for name, value in lines)
    return f"Station {there.bssid.lower()} (on {radio})\n{text}"
