"""How single faults strike the joined pilot, and how they end; each act is given its `PilotStand`."""

from __future__ import annotations

import base64
import re
import subprocess
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from typing import TYPE_CHECKING

from cryptography import x509
from cryptography.hazmat.primitives import serialization
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
from cryptography.x509.oid import NameOID

from atlantis_netcfg.emulator.routeros.dataplane.namespace import plug_of
from atlantis_netcfg.routeros.render import view
from atlantis_netcfg.vpn import client

if TYPE_CHECKING:
    from collections.abc import Callable

    from campaign.pilot_stand import PilotStand

    Act = Callable[[PilotStand], object]
    Pair = tuple[Act, Act]
    """What causes a fault, and what mends it."""

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


def time_servers(verb: str) -> Act:
    def act(stand: PilotStand) -> None:
        for each in stand.inventory.pilot.time_servers:
            stand.pilot.network.run(
                stand.pilot.network.namespace("net"), "ip", "address", verb, f"{each.address}/32", "dev", "lo"
            )

    return act


# --- pairs -----------------------------------------------------------------------------------------------------------


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
