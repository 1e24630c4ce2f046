"""The rows of `/ip/service` as the wire needs them (Manual, Services)."""

from __future__ import annotations

from dataclasses import dataclass
from ipaddress import ip_address, ip_network
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Mapping

    from atlantis_netcfg.emulator.routeros.core import Core


@dataclass(frozen=True, slots=True)
class Service:
    """A row of `/ip/service` as the wire needs it; `certificate` is None where none is set."""

    name: str
    port: int
    enabled: bool
    certificate: str | None
    max_sessions: int
    tls_version: str
    address: str = ""
    """Networks that it talks to, as `/ip/service` has them; empty is everybody."""

    def admits(self, caller: str) -> bool:
        """Does it talk to this address; others learn it from a connection that is closed (Manual, Services)."""
        networks = [ip_network(part) for part in self.address.split(",") if part]
        return not networks or any(ip_address(caller) in network for network in networks)


def services_of(core: Core) -> Mapping[str, Service]:
    """The services by name, as they are configured now."""
    store = core.store
    table = store.table("/ip/service")
    found = {}
    for item in table.items:
        name = store.text(table, item, "name") or ""
        certificate = store.text(table, item, "certificate")
        found[name] = Service(
            name=name,
            port=int(store.text(table, item, "port") or 0),
            enabled=store.text(table, item, "disabled") != "yes",
            certificate=None if certificate in (None, "none") else certificate,
            max_sessions=int(store.text(table, item, "max-sessions") or 20),
            tls_version=store.text(table, item, "tls-version") or "any",
            address=store.text(table, item, "address") or "",
        )
    return found
