"""Answers a role: what should each gateway of this play hold. Contacts nothing."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from atlantis_netcfg.errors import UsageError
from atlantis_netcfg.operations.asking import asked_for
from atlantis_netcfg.operations.costs import gate
from atlantis_netcfg.operations.examples import refuse_examples
from atlantis_netcfg.operations.gateways import _watch
from atlantis_netcfg.operations.gateways._access import is_gateway
from atlantis_netcfg.operations.gateways.parts import PARTS
from atlantis_netcfg.site import load

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

__all__ = ["perform"]


def perform(
    inventory: Path, hosts: Sequence[str], request: Mapping[str, Any] | None, part: str, *, plan_only: bool
) -> dict[str, Any]:
    """Give `per_host` for the part of that name, and refuse what the run may not do. Raises NetcfgError."""
    with asked_for(request, plan_only=plan_only) as (asked, _):
        if part not in PARTS:
            raise UsageError(f"`{part}` is no part of a gateway", hint=f"there are: {', '.join(PARTS)}")
        declaration = load(inventory)
        gateways = [declaration.hosts[name] for name in hosts if is_gateway(declaration.hosts[name])]
        refuse_examples(declaration, rehearsed=asked.rehearsed)
        gate(declaration, gateways, asked)
        _watch.refuse()
        return {"per_host": {host.name: PARTS[part](declaration, host, asked) for host in gateways}}
