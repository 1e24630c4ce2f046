"""The link that carries the session to a device, and the timeouts that follow from it."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Final

from atlantis_netcfg.core.errors import UsageError
from atlantis_netcfg.operations.common.kinds import get_managed_device, is_supported
from atlantis_netcfg.operations.common.site_links import CABLE
from atlantis_netcfg.routeros.estimate import BearerProfile

if TYPE_CHECKING:
    from atlantis_netcfg.inventory import Declaration, Host
    from atlantis_netcfg.inventory.model import Bearer as Declared
    from atlantis_netcfg.routeros.api import Endpoint

FAST_S: Final = 0.2
"""Round trip below which a link has no gaps of minutes, as a satellite has."""
PATIENCE_S: Final = 15.0
"""For a connection and its login over a fast link: a device that is there answers at once."""
_REPLY_S: Final = 60.0
"""For an answer over such a link: a small board works for some seconds on a script, or waits for its flash."""

LAN = BearerProfile(name=CABLE, rtt_s=0.001, rate_up_bps=100e6, rate_down_bps=100e6, is_metered=False)
"""The technician's cable: an ordinary 100 Mbit/s port."""


def bearer_of(declaration: Declaration, host: Host, via: str | None = None) -> BearerProfile:
    """Return the link to a device; `via` overrides the inventory. Raise UsageError if the site has no such link."""
    name = via or (get_managed_device(declaration, host).access.via if is_supported(host) else LAN.name)
    if name == LAN.name:
        return LAN
    bearers = {bearer.name: bearer for bearer in declaration.sites[host.site].bearers}
    if name not in bearers:
        choices = ", ".join([LAN.name, *bearers])
        raise UsageError(f"`via={name}`: {host.site} has no such bearer", hint=f"it has: {choices}")
    return as_bearer(bearers[name])


def patient(endpoint: Endpoint, bearer: BearerProfile) -> Endpoint:
    """Return the endpoint with the timeouts that its link needs.

    A cable or a bridge on land has no gaps: a dead device there is given up in seconds. Everything else keeps the
    defaults, which outlast the gaps of 70 s of a satellite; so does a metered link, since a modem that searches for its
    network is silent for as long.
    """
    if bearer.is_metered or bearer.rtt_s >= FAST_S:
        return endpoint
    return replace(endpoint, connect_timeout_s=PATIENCE_S, reply_timeout_s=_REPLY_S)


def as_bearer(bearer: Declared) -> BearerProfile:
    """Convert a link of the inventory to the units of estimates."""
    return BearerProfile(
        name=bearer.name,
        rtt_s=bearer.rate.rtt_ms / 1000,
        rate_up_bps=bearer.rate.up_kbps * 1000,
        rate_down_bps=bearer.rate.down_kbps * 1000,
        is_metered=bearer.metered,
    )
