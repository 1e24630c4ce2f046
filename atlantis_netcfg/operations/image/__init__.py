"""Images of gateway computers: what the declaration says of a host, put on a card, and kept on record."""

from __future__ import annotations

from atlantis_netcfg.operations.image._make import Made, Order, made
from atlantis_netcfg.operations.image._wish import layout_of, wish_of

__all__ = ["Made", "Order", "layout_of", "made", "wish_of"]
