"""Bundles for the hosts of a site: from the declaration to what each needs, and from there to a bundle."""

from __future__ import annotations

from atlantis_netcfg.operations.bundle._make import Asked, made, opened
from atlantis_netcfg.operations.bundle._wish import gateways_of, has_tokens, wish_of

__all__ = ["Asked", "gateways_of", "has_tokens", "made", "opened", "wish_of"]
