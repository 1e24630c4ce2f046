"""What a router's rows say of a tunnel: with which server, keys and options its OpenVPN client connects."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from atlantis_netcfg.emulator.routeros import certificates, core, environment
from atlantis_netcfg.emulator.routeros.dataplane import rows

if TYPE_CHECKING:
    from atlantis_netcfg.emulator.routeros.store import StoredItem, Table


@dataclass(frozen=True, slots=True)
class TunnelSettings:
    """A row of `/interface/ovpn-client` that is able to connect, with its keys and certificates as PEM texts."""

    name: str
    """Name of the interface on the router."""
    connect_to: str
    """Name or address of the server, with which its certificate is compared."""
    address: str
    """The same by the router's own DNS entries; the name if there is none."""
    port: int
    protocol: str
    cipher: str
    """In OpenVPN's words, as is `auth`."""
    auth: str
    tls_version: str
    max_mtu: int
    is_server_verified: bool
    has_pulled_routes: bool
    notifies: bool
    """Whether it tells the server when it disconnects."""
    user: str
    password: str = field(repr=False)
    identity: str = field(repr=False)
    """The client's key and certificate."""
    authorities: str
    """Certificates of all trusted authorities on the router."""
    wrap: str | None = field(repr=False)
    """Key of tls-crypt or tls-crypt-v2."""


def tunnel_settings(router: core.Core, interface: str) -> TunnelSettings | None:
    """Return the settings of a VPN client by its name or its Linux device.

    None: its row is disabled, or its certificate is missing, without a key, or expired. Raises LookupError for an
    interface that does not exist.
    """
    table = router.store.table(core.CLIENTS)
    devices = rows.devices_of(router.topology)
    item = next(
        (item for item in table.items if interface in {router.store.text(table, item, "name"), devices.get(item.id)}),
        None,
    )
    if item is None:
        raise LookupError(f"no VPN client is called {interface}")
    values = {name: router.store.text(table, item, name) or "" for name in table.args}
    identity = _identity(router, table, item)
    if values["disabled"] == "yes" or identity is None:
        return None
    return TunnelSettings(
        name=values["name"],
        connect_to=values["connect-to"],
        address=_address(router, values["connect-to"]),
        port=int(values["port"]),
        protocol=values["protocol"],
        cipher=certificates.openvpn_cipher(values["cipher"]),
        auth="none" if values["auth"] == "null" else values["auth"].upper(),
        tls_version=values["tls-version"],
        max_mtu=int(values["max-mtu"]),
        is_server_verified=values.get("verify-server-certificate") == "yes",
        has_pulled_routes=values.get("route-nopull") != "yes",
        notifies=values["protocol"] == "udp" and values.get("disconnect-notify") == "yes",
        user=values["user"],
        password=values["password"],
        identity=identity,
        authorities=_authorities(router),
        wrap=router.wraps.get(item.id),
    )


def _identity(router: core.Core, table: Table, item: StoredItem) -> str | None:
    number = router.store.target(table, item, "certificate")
    row = next((row for row in router.store.table("/certificate").items if row.id == number), None)
    info = None if row is None else environment.certificate_info(router, row)
    if row is None or info is None or not info.private_key:
        return None
    return router.keys[row.id] if router.time() <= info.not_after else None


def _authorities(router: core.Core) -> str:
    table = router.store.table("/certificate")
    authorities = [item for item in table.items if router.store.text(table, item, "trusted") == "yes"]
    pems = [router.keys[item.id] for item in authorities if item.id in router.keys]
    return "".join(certificates.split(pem)[0][0] for pem in pems if certificates.read_certificate(pem).authority)


def _address(router: core.Core, name: str) -> str:
    table = router.store.table("/ip/dns/static")
    for item in table.items:
        entry = {word: router.store.text(table, item, word) or "" for word in ("name", "address", "disabled")}
        if entry["name"] == name and entry["address"] and entry["disabled"] != "yes":
            return entry["address"]
    return name
