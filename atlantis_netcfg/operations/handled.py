"""Which devices a role of this toolkit brings to their declared state; all others are listed as not handled yet."""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.site.model import Router

if TYPE_CHECKING:
    from atlantis_netcfg.site import Host

__all__ = ["handled"]


def handled(host: Host) -> bool:
    """True for what `playbooks/site.yml` has a role for; a test holds the two together."""
    return isinstance(host.device, Router)
