"""Answers a role: what should each computer of this play hold. Contacts nothing."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from atlantis_netcfg.core.errors import UsageError
from atlantis_netcfg.operations.computers import _watch
from atlantis_netcfg.operations.computers._access import is_computer, is_server
from atlantis_netcfg.operations.computers._fetching import bundle_of, fetching, narrowed
from atlantis_netcfg.operations.computers.parts import ACCESS, PARTS, concerns, refuse_unfounded
from atlantis_netcfg.operations.costs import gate
from atlantis_netcfg.operations.request import declaration_of, open_request, refuse_examples

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from atlantis_netcfg.declaration import Declaration, Host
    from atlantis_netcfg.operations.request import Request

__all__ = ["perform"]


def perform(
    inventory: Path, hosts: Sequence[str], request: Mapping[str, Any] | None, part: str, *, plan_only: bool
) -> dict[str, Any]:
    """Give `per_host` for the part of that name, and refuse what the run may not do. Raises NetcfgError."""
    with open_request(request, plan_only=plan_only) as (requested, _):
        if part not in PARTS:
            raise UsageError(f"`{part}` is no part of a computer", hint=f"there are: {', '.join(PARTS)}")
        declaration = declaration_of(inventory)
        computers = [declaration.hosts[name] for name in hosts if is_computer(declaration.hosts[name])]
        refuse_examples(declaration, rehearsed=requested.rehearsed)
        gate(declaration, computers, requested)
        _watch.refuse()
        if part == ACCESS:
            _open_bundle(declaration, computers, requested)
            refuse_unfounded(computers, requested)
        bundle = bundle_of(requested.offline)
        return {
            "per_host": {
                host.name: narrowed(
                    PARTS[part](declaration, host, requested), fetching(declaration, host, requested, bundle), bundle
                )
                for host in computers
                if concerns(part, host)
            }
        }


def _open_bundle(declaration: Declaration, computers: Sequence[Host], request: Request) -> None:
    """Hold the bundle against the declaration, before anything starts. Raises BundleRefused with all that it lacks."""
    if request.offline is None:
        return
    if servers := [host.name for host in computers if is_server(host)]:
        raise UsageError(
            f"{', '.join(servers)}: the server of the VPN takes nothing from a bundle, which is made for gateways",
            hint="name the gateways with `only=`; run the server without `--offline`",
        )
    from atlantis_netcfg.operations import bundle as bundling  # noqa: PLC0415 - most runs have no bundle

    bundling.opened(declaration, computers, request.offline, request)
