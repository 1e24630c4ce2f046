"""Single faults of the joined pilot: how each strikes, how it ends, and which checklist items turn meanwhile."""

from __future__ import annotations

import base64
import re
import subprocess
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime, timedelta
from typing import TYPE_CHECKING

from cryptography import x509
from cryptography.hazmat.primitives import serialization
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
from cryptography.x509.oid import NameOID

from atlantis_netcfg.computers import reflector
from atlantis_netcfg.emulator.lab import hosts
from atlantis_netcfg.emulator.routeros.dataplane.namespace import plug_of
from atlantis_netcfg.routeros.render import view
from atlantis_netcfg.vpn import client, identity, server

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping

    from campaign.pilot_stand import PilotStand

    Act = Callable[[PilotStand], object]
    Pair = tuple[Act, Act]
    """What causes a fault, and what mends it."""

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
    pair: Pair
    turns: Mapping[str, str] = field(default_factory=dict)
    """Item to a pattern of its verdict and codes; all others stay as they are."""
    over: tuple[str, str] | None = None
    """Site, and the link that has to carry its traffic within the declared time."""
    within_s: float | None = None
    """Seconds after mending within which data flow again; None: the time in which a site comes back to a link."""


# --- links and cables ------------------------------------------------------------------------------------------------


def carry(site: str, link: str, *, is_up: bool) -> Act:
    def act(stand: PilotStand) -> None:
        stand.pilot.network.links[site, link].is_up = is_up

    return act


def shape(site: str, link: str, *, delay_s: float = 0.0, loss: float = 0.0) -> Act:
    """Add delay and loss to both directions."""

    def act(stand: PilotStand) -> None:
        for model in (stand.pilot.network.links[site, link].up, stand.pilot.network.links[site, link].down):
            now = model.shape
            model.shape = replace(now, delay_s=max(0.0, now.delay_s + delay_s), loss=max(0.0, now.loss + loss))

    return act


def cable(site: str, link: str, state: str) -> Act:
    """Set the far end of the cable in a router's port: that of its unit, or of its bridge."""

    def act(stand: PilotStand) -> None:
        router = stand.router(site)
        port = next(port.name for port in view.router_of(router).ports if port.link == link)
        unit = stand.unit(site, link)
        namespace, device = (
            (stand.pilot.network.routers[router.name], plug_of(port)) if unit is None else (unit, "near")
        )
        stand.pilot.network.run(namespace, "ip", "link", "set", device, state)

    return act


# --- computers -------------------------------------------------------------------------------------------------------


def run(name: str, command: str) -> Act:
    return lambda stand: stand.machine(name).run(command)


def computer_cable(name: str, state: str) -> Act:
    """Set the switch's end of a computer's cable."""

    def act(stand: PilotStand) -> None:
        port = f"{stand.machine(name).namespace.rpartition('-')[2]}-0"
        stand.in_router(stand.inventory.hosts[name].site, "ip", "link", "set", port, state)

    return act


def power(name: str, *, is_on: bool) -> Act:
    """Cut a computer's power, or let it boot."""
    return lambda stand: stand.machine(name).power_on() if is_on else stand.machine(name).power_cut()


def fill_disk(name: str) -> Act:
    return lambda stand: stand.machine(name).fill_disk()


def free_disk(name: str) -> Act:
    return lambda stand: stand.machine(name).free_disk()


def expire_identity(name: str) -> Act:
    """Put another certificate, which has expired, in the place of a computer's own; its tunnel stays for now."""

    def act(stand: PilotStand) -> None:
        machine, key, now = stand.machine(name), Ed25519PrivateKey.generate(), datetime.now(UTC)
        subject = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, name)])
        builder = x509.CertificateBuilder(subject, subject, key.public_key(), x509.random_serial_number())
        builder = builder.not_valid_before(now - timedelta(days=90)).not_valid_after(now - timedelta(days=1))
        text = builder.sign(key, None).public_bytes(serialization.Encoding.PEM).decode()
        before = machine.run(f"cp -p {client.IDENTITY} {client.IDENTITY}.kept && cat {client.IDENTITY}").stdout
        after = re.sub(
            r"-----BEGIN CERTIFICATE-----.*?-----END CERTIFICATE-----\n", text, before, count=1, flags=re.DOTALL
        )
        machine.run(f"base64 -d > {client.IDENTITY}", input=base64.b64encode(after.encode()).decode())

    return act


def restore_identity(name: str) -> Act:
    return run(name, f"mv {client.IDENTITY}.kept {client.IDENTITY}")


# --- routers ---------------------------------------------------------------------------------------------------------


def switch_row(site: str, menu: str, verb: str, **values: str) -> Act:
    """Disable or enable the row of a menu that has these values; connections begin anew, except by a side chain."""

    def act(stand: PilotStand) -> None:
        wanted = {name.rstrip("_").replace("_", "-"): value for name, value in values.items()}
        (row,) = [row for row in stand.rows(site, menu) if wanted.items() <= row.items()]
        stand.console(site, f"{menu}/{verb}", f"=numbers={row['.id']}")
        if menu.startswith("/ip/firewall") and "chain" not in values:
            stand.pilot.rehearsal.emulators.do(stand.router(site).name, "wait", seconds=1)
            stand.in_router(site, "conntrack", "-F")
        if menu == "/interface/ovpn-client":
            stand.pilot.tunnels[stand.router(site).name].refresh()

    return act


def in_turn(*acts: Act) -> Act:
    return lambda stand: [act(stand) for act in acts]


def wait_for_data(name: str) -> Act:
    def act(stand: PilotStand) -> None:
        hosts.wait(lambda: stand.has_data(name), 30, lambda: f"no data from {name}")

    return act


# --- strangers -------------------------------------------------------------------------------------------------------


def advertise(site: str) -> Act:
    """Let a computer in the LAN announce itself as an IPv6 router."""

    def act(stand: PilotStand) -> None:
        namespace = stand.stranger(site)
        stand.pilot.network.run(
            namespace, "sysctl", "-qw", "net.ipv6.conf.all.disable_ipv6=0", "net.ipv6.conf.eth0.disable_ipv6=0"
        )
        stand.pilot.network.run(namespace, "ip", "address", "replace", "2001:db8:9::1/64", "dev", "eth0", "nodad")
        words = ("dnsmasq", "--keep-in-foreground", "--conf-file=/dev/null", "--port=0", "--user=root", "--pid-file=")
        stand.processes[site] = subprocess.Popen(
            (
                "ip",
                "netns",
                "exec",
                namespace,
                *words,
                "--interface=eth0",
                "--enable-ra",
                "--dhcp-range=2001:db8:9::,ra-only,64,2h",
            ),
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )

    return act


def stop_advertising(site: str) -> Act:
    def act(stand: PilotStand) -> None:
        process = stand.processes.pop(site)
        process.kill()
        process.wait()

    return act


def _time_servers(verb: str) -> Act:
    def act(stand: PilotStand) -> None:
        for each in stand.inventory.pilot.time_servers:
            stand.pilot.network.run(
                stand.pilot.network.namespace("net"), "ip", "address", verb, f"{each.address}/32", "dev", "lo"
            )

    return act


# --- the table -------------------------------------------------------------------------------------------------------


def cut(site: str, link: str) -> Pair:
    return carry(site, link, is_up=False), carry(site, link, is_up=True)


def unplug(site: str, link: str) -> Pair:
    return cable(site, link, "down"), cable(site, link, "up")


def delay(site: str, link: str, seconds: float) -> Pair:
    return shape(site, link, delay_s=seconds), shape(site, link, delay_s=-seconds)


def stop(name: str, unit: str) -> Pair:
    return run(name, f"systemctl stop {unit}"), run(name, f"systemctl start {unit}")


def add(name: str, kind: str, what: str) -> Pair:
    """Add a route or an address with `ip`."""
    return run(name, f"ip {kind} add {what}"), run(name, f"ip {kind} del {what}")


def disable(site: str, menu: str, **values: str) -> Pair:
    """Disable the only row of a router's menu that has these values."""
    return switch_row(site, menu, "disable", **values), switch_row(site, menu, "enable", **values)


def _links() -> Iterator[Fault]:
    moves = {
        "coastal/wifi-ptp": ("4g", r"PASS traffic leaves by 4g, because wifi-ptp is not up"),
        "te4sea/4g": ("satellite", r"PASS traffic leaves by satellite, because 4g is not up"),
    }
    for way, what in (("cut", cut), ("cable-out", unplug)):
        yield Fault(f"scc-uplink-{way}", what("scc", "uplink"), alone("te4sea"))
        for site, link in LINKS:
            after, words = moves.get(f"{site}/{link}", ("", ""))
            turns = {f"{site}/site/default-route": words} if after else {}
            yield Fault(f"{site}-{link}-{way}", what(site, link), turns, (site, after) if after else None)
    yield Fault(
        "scc-bridge-cable-out",
        unplug("scc", "wifi-ptp"),
        {"coastal/site/default-route": moves["coastal/wifi-ptp"][1]},
        ("coastal", "4g"),
    )
    for site, link in (("coastal", "wifi-ptp"), ("te4sea", "4g")):
        after, words = moves[f"{site}/{link}"]
        yield Fault(f"{site}-{link}-late", delay(site, link, 2), {f"{site}/site/default-route": words}, (site, after))
    yield Fault(
        "scc-uplink-lossy",
        (shape("scc", "uplink", loss=0.8), shape("scc", "uplink", loss=-0.8)),
        {
            "te4sea/site/vpn": "WARN server-lossy|FAIL server-silent",
            "te4sea/site/data-reaches-scc": "WARN data-lost|FAIL far-end-silent",
            "scc/site/data-reaches-scc": "WARN data-lost|INCONCLUSIVE gateway-silent",
        },
    )


def _computers() -> Iterator[Fault]:
    yield Fault("server-stopped", stop(SERVER, server.SERVICE), NO_SERVER)
    yield Fault("scc-client-stopped", stop(CENTRE, client.SERVICE), {**CENTRE_SILENT, **no_tunnel("scc")})
    yield Fault(
        "scc-reflector-stopped",
        stop(CENTRE, reflector.SERVICE),
        dict.fromkeys((f"{site}/site/data-reaches-scc" for site in GATEWAYS), "FAIL nobody-answers-data"),
    )
    for site, name in GATEWAYS.items():
        yield Fault(f"{site}-client-stopped", stop(name, client.SERVICE), {**GATEWAY_SILENT, **no_tunnel(site)})
        yield Fault(
            f"{site}-reflector-stopped",
            stop(name, reflector.SERVICE),
            {"scc/site/data-reaches-scc": "FAIL nobody-answers-data"},
        )
        yield Fault(
            f"{site}-data-outside",
            add(name, "route", f"10.80.0.2/32 via {LAN[site]}1"),
            {f"{site}/site/data-reaches-scc": "FAIL way-outside-vpn", **GATEWAY_SILENT},
        )
    yield Fault(
        "scc-data-outside",
        add(CENTRE, "route", f"10.80.0.21/32 via {LAN['scc']}1"),
        {"scc/site/data-reaches-scc": "FAIL way-outside-vpn", "coastal/site/data-reaches-scc": "FAIL far-end-silent"},
    )
    for site, name in COMPUTER.items():
        yield Fault(
            f"{site}-identity-expired",
            (expire_identity(name), restore_identity(name)),
            {f"{site}/site/certificates": "FAIL expired"},
        )
        yield Fault(
            f"{site}-spare-default",
            add(name, "route", f"default via {LAN[site]}99 metric 500"),
            {f"{site}/site/default-route": "WARN gateway-spare-route"},
        )
        yield Fault(
            f"{site}-broad-route",
            add(name, "route", f"0.0.0.0/1 via {LAN[site]}1"),
            {f"{site}/site/default-route": "FAIL gateway-broader-route"},
        )
        yield Fault(
            f"{site}-second-address",
            add(name, "address", f"{LAN[site]}77/24 dev eth0"),
            {f"{site}/site/one-subnet-twice": "FAIL subnet-twice"},
        )
        yield Fault(f"{site}-disk-full", (fill_disk(name), free_disk(name)))
        yield Fault(
            f"{site}-rogue-router",
            (advertise(site), stop_advertising(site)),
            {f"{site}/site/rogue-router": "FAIL rogue-router"},
        )


def _routers() -> Iterator[Fault]:
    nat, rules = "/ip/firewall/nat", "/ip/firewall/filter"
    for site in GATEWAYS:
        yield Fault(
            f"{site}-tunnel-disabled",
            disable(site, "/interface/ovpn-client", comment="atlantis: VPN"),
            {f"{site}/site/vpn": "FAIL router-tunnel-off"},
        )
        yield Fault(
            f"{site}-allow-list-disabled",
            disable(site, rules, comment="atlantis: VPN server", chain="to-satellite"),
            {f"{site}/site/satellite-filter": "FAIL too-narrow"},
        )
        yield Fault(f"{site}-translation-disabled", disable(site, nat, comment="atlantis: uplinks"), alone(site))
        yield Fault(f"{site}-lan-disabled", disable(site, rules, comment="atlantis: LAN by the best link"), alone(site))
    # What the server sends to a known member beyond the uplink opens the way back: only the bridge's side is cut off.
    for name, menu, comment in (
        ("forward", nat, "scc-vpn at uplink"),
        ("forwarded-row", rules, "forwarded to scc-vpn"),
    ):
        strike, mend = disable("scc", menu, comment=f"atlantis: {comment}")
        yield Fault(f"{name}-disabled", (in_turn(strike, wait_for_data("te4sea-gateway")), mend), alone("coastal"))


def _power_and_cables() -> Iterator[Fault]:
    """Last, because they take longest: a computer boots, and an OpenVPN server that is gone is missed late."""
    for site, name in COMPUTER.items():
        turns = {**(CENTRE_SILENT if name == CENTRE else GATEWAY_SILENT), **unreachable(site)}
        yield Fault(f"{site}-computer-cable-out", (computer_cable(name, "down"), computer_cable(name, "up")), turns)
        yield Fault(f"{site}-computer-off", (power(name, is_on=False), power(name, is_on=True)), turns)
    yield Fault("server-cable-out", (computer_cable(SERVER, "down"), computer_cable(SERVER, "up")), NO_SERVER)
    yield Fault("server-off", (power(SERVER, is_on=False), power(SERVER, is_on=True)), NO_SERVER, within_s=MISSED_S)
    yield Fault("time-servers-dead", (_time_servers("del"), _time_servers("add")))


FAULTS: tuple[Fault, ...] = (*_links(), *_computers(), *_routers(), *_power_and_cables())
