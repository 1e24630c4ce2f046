"""The boxes of a site, told apart by `kind`. `host_vars/<host>.yml`, key `device`."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from atlantis_netcfg.declaration.model._box import LanBox
from atlantis_netcfg.declaration.model.gateway import Gateway, Ssh
from atlantis_netcfg.declaration.model.lte import LteRouter
from atlantis_netcfg.declaration.model.radio import Cpe
from atlantis_netcfg.declaration.model.router import Router
from atlantis_netcfg.declaration.model.terminal import SatelliteTerminal

__all__ = ["ControlCentre", "Device", "VpnServer"]


class VpnServer(LanBox):
    """Runs the OpenVPN server."""

    kind: Literal["vpn_server"]
    ssh: Ssh = Ssh()

    @property
    def account(self) -> str:
        """The account by which the toolkit logs in."""
        return self.ssh.user or "root"


class ControlCentre(LanBox):
    """Runs the control centre's services."""

    kind: Literal["control_centre"]


Device = Annotated[
    Router | Cpe | LteRouter | SatelliteTerminal | Gateway | VpnServer | ControlCentre,
    Field(discriminator="kind"),
]
