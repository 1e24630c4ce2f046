"""The kinds of devices that the RouterOS engine handles: one entry a kind, and everything else asks this table.

A new kind is a subclass of `Managed` in a module of its own and its name in `_KINDS`; its group stands in
`playbooks/site.yml` (a test holds the two together).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.core.errors import NothingMatched
from atlantis_netcfg.operations.kinds._cpe import ManagedCpe
from atlantis_netcfg.operations.kinds._lte import ManagedLte
from atlantis_netcfg.operations.kinds._managed import Hardware, Managed, Place, Text
from atlantis_netcfg.operations.kinds._router import ManagedRouter

if TYPE_CHECKING:
    from atlantis_netcfg.declaration import Declaration, Host

__all__ = ["Hardware", "Managed", "Place", "Text", "handled", "managed"]

_KINDS: tuple[type[Managed], ...] = (ManagedRouter, ManagedCpe, ManagedLte)


def handled(host: Host) -> bool:
    """Tell whether the RouterOS engine handles a host."""
    return any(kind.takes(host) for kind in _KINDS)


def managed(declaration: Declaration, host: Host) -> Managed:
    """Return what is known of a host's kind. Raises NothingMatched if the engine does not handle it."""
    for kind in _KINDS:
        if kind.takes(host):
            return kind(declaration, host)
    raise NothingMatched(f"{host.name} is a {host.device.kind.replace('_', ' ')}: no role handles it yet")
