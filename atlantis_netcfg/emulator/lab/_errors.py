"""What goes wrong with machines, in words for the person at the computer that should run them."""

from __future__ import annotations

from atlantis_netcfg.core.errors import NetcfgError


class MachineFailed(NetcfgError):
    """A machine could not be built, started, or asked; nothing beyond this computer was touched."""
