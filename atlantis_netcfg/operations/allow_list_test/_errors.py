"""When there is nothing to prove."""

from __future__ import annotations

from atlantis_netcfg.core.errors import NothingMatched

__all__ = ["NothingToProve"]


class NothingToProve(NothingMatched):
    """The site has no such satellite link, or no router that could try it."""
