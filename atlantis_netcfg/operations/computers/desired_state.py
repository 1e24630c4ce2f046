"""The desired state of each computer of a play for one role, and its sources of packages.

Nothing is contacted. Packages come over the site's link (over a metered one up to a limit) or from a bundle.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from atlantis_netcfg.core.errors import UsageError
from atlantis_netcfg.core.messages import arg, join, msg
from atlantis_netcfg.operations.common.costs import require_consent
from atlantis_netcfg.operations.common.request import open_inventory, open_request, refuse_examples
from atlantis_netcfg.operations.common.site_links import link_of
from atlantis_netcfg.operations.computers import _watch, parts
from atlantis_netcfg.operations.computers._access import is_computer, is_server

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from atlantis_netcfg.inventory import Host, Inventory
    from atlantis_netcfg.operations.common.request import Request

BUNDLES = "/var/lib/atlantis/bundle"
"""Folder on a computer in which the action `carry` stores bundles by their id."""


def package_sources(inventory: Inventory, host: Host, request: Request, bundle: str | None) -> Mapping[str, Any]:
    """Return the parameters of the module `packages` for downloads; empty if they are unrestricted (unmetered).

    Over a metered link nothing is downloaded without a person's consent, and never more than its cap. Only the router
    knows which link a site uses now: the preferred one is assumed.
    """
    if bundle is not None:
        return {"offline": f"{BUNDLES}/{bundle}/repository"}
    links = inventory.sites[host.site].bearers
    if request.rehearsed or not links or not links[0].metered:
        return {}
    link = link_of(inventory, host.site, links[0].name)
    if request.accept_cost and link.cap_bytes is None:
        return {}
    return {
        "limit_bytes": link.cap_bytes if request.accept_cost else 0,
        "limit_words": msg(f"over {arg(link.name)} of {arg(host.site)}, which is metered"),
    }


def narrow(desired_state: Mapping[str, Any], how: Mapping[str, Any], bundle: str | None) -> dict[str, Any]:
    """Return a part with its sources: packages as in `how`, sources to build from the bundle only, if there is one."""
    values = dict(desired_state)
    if values.get("packages") is not None:
        values["packages"] = {**values["packages"], **how}
    if values.get("build") is not None and bundle is not None:
        values["build"] = {**values["build"], "offline": f"{BUNDLES}/{bundle}/sources"}
    return values


def bundle_of(folder: Path | None) -> str | None:
    """Return a bundle's id from its manifest; the bundle was opened and verified before."""
    if folder is None:
        return None
    from atlantis_netcfg.computers.bundle.manifest import MANIFEST, read_manifest  # noqa: PLC0415 - most runs have no bundle

    path = folder / MANIFEST
    return read_manifest(path.read_bytes(), str(path)).id


def perform(
    inventory: Path, hosts: Sequence[str], request: Mapping[str, Any] | None, part: str, *, plan_only: bool
) -> dict[str, Any]:
    """Return `per_host` for the part of that name, and refuse what the run may not do; raise NetcfgError."""
    with open_request(request, plan_only=plan_only) as (run_request, _):
        if part not in parts.PARTS:
            raise UsageError(
                f"`{arg(part)}` is not a part of a computer", hint=f"possible values: {arg(join(', ', parts.PARTS))}"
            )
        pilot_inventory = open_inventory(inventory)
        computers = [pilot_inventory.hosts[name] for name in hosts if is_computer(pilot_inventory.hosts[name])]
        refuse_examples(pilot_inventory, is_rehearsal=run_request.rehearsed)
        require_consent(pilot_inventory, computers, run_request)
        _watch.refuse()
        if part == parts.ACCESS:
            _open_bundle(pilot_inventory, computers, run_request)
            parts.require_authority(computers, run_request)
        bundle = bundle_of(run_request.offline)
        return {
            "per_host": {
                host.name: narrow(
                    parts.PARTS[part](pilot_inventory, host, run_request),
                    package_sources(pilot_inventory, host, run_request, bundle),
                    bundle,
                )
                for host in computers
                if parts.concerns(part, host)
            }
        }


def _open_bundle(inventory: Inventory, computers: Sequence[Host], request: Request) -> None:
    """Check the bundle against the inventory before the start; raise BundleError with all that is missing."""
    if request.offline is None:
        return
    if servers := [host.name for host in computers if is_server(host)]:
        raise UsageError(
            f"{arg(join(', ', servers))}: the VPN server does not use a bundle; bundles are for the other devices",
            hint="select the others with `device=`; run the server without `--offline`",
        )
    from atlantis_netcfg.operations import bundle as bundling  # noqa: PLC0415 - most runs have no bundle

    bundling.open_for_hosts(inventory, computers, request.offline, request)
