"""What a session to a device runs over: the declared bearer, or the cable on the management port."""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.errors import UsageError
from atlantis_netcfg.operations.kinds import handled, managed
from atlantis_netcfg.routeros.estimate import Bearer

if TYPE_CHECKING:
    from atlantis_netcfg.site import Declaration, Host
    from atlantis_netcfg.site.model import Bearer as Declared

__all__ = ["LAN", "as_bearer", "bearer_of"]

LAN = Bearer(name="lan", rtt_s=0.001, rate_up_bps=100e6, rate_down_bps=100e6, metered=False)
"""The technician's cable: an ordinary 100 Mbit/s port."""


def bearer_of(declaration: Declaration, host: Host, via: str | None = None) -> Bearer:
    """The bearer to a device; `via` overrides the declared one. Raises UsageError if the site has no such bearer."""
    name = via or (managed(declaration, host).access.via if handled(host) else LAN.name)
    if name == LAN.name:
        return LAN
    bearers = {bearer.name: bearer for bearer in declaration.sites[host.site].bearers}
    if name not in bearers:
        known = ", ".join([LAN.name, *bearers])
        raise UsageError(f"`via={name}`: {host.site} has no such bearer", hint=f"it has: {known}")
    return as_bearer(bearers[name])


def as_bearer(bearer: Declared) -> Bearer:
    """A declared bearer in the units of estimates."""
    return Bearer(
        name=bearer.name,
        rtt_s=bearer.rate.rtt_ms / 1000,
        rate_up_bps=bearer.rate.up_kbps * 1000,
        rate_down_bps=bearer.rate.down_kbps * 1000,
        metered=bearer.metered,
    )
