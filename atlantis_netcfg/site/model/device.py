"""The boxes of a site, told apart by `kind`. `host_vars/<host>.yml`, key `device`."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from atlantis_netcfg.site.model._base import Address
from atlantis_netcfg.site.model._box import Box
from atlantis_netcfg.site.model.lte import LteRouter
from atlantis_netcfg.site.model.radio import Cpe
from atlantis_netcfg.site.model.router import Router
from atlantis_netcfg.site.model.terminal import SatelliteTerminal

__all__ = ["ControlCentre", "Device", "Gateway", "VpnServer"]


class _LanHost(Box):
    address: Address
    """In the site's LAN."""
    vpn_address: Address | None = None


class Gateway(_LanHost):
    """The data gateway computer."""

    kind: Literal["gateway"]


class VpnServer(_LanHost):
    """Runs the OpenVPN server."""

    kind: Literal["vpn_server"]


class ControlCentre(_LanHost):
    """Runs the control centre's services."""

    kind: Literal["control_centre"]


Device = Annotated[
    Router | Cpe | LteRouter | SatelliteTerminal | Gateway | VpnServer | ControlCentre,
    Field(discriminator="kind"),
]
