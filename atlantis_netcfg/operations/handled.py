"""Which devices a role of this toolkit brings to their declared state; all others are listed as not handled yet."""

from __future__ import annotations

from atlantis_netcfg.operations.kinds import handled

__all__ = ["handled"]
