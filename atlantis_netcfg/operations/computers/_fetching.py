"""Where a gateway may take packages and sources from, and how much of them: its site's link, or a bundle alone."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from atlantis_netcfg.operations.costs import link_of

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from atlantis_netcfg.declaration import Declaration, Host
    from atlantis_netcfg.operations.request import Request

__all__ = ["BUNDLES", "bundle_of", "fetching", "narrowed"]

BUNDLES = "/var/lib/atlantis/bundle"
"""On a gateway: where the action `carry` puts a bundle, below its id."""


def fetching(declaration: Declaration, host: Host, request: Request, bundle: str | None) -> Mapping[str, Any]:
    """Give the parameters of the module `packages` that say so; none: whatever it needs, over a link that is free.

    Over a link that is paid by the byte nothing is fetched unless a person has agreed, and never more than its cap.
    Which link a site uses at the moment only its router knows: the one that it prefers is taken for it.
    """
    if bundle is not None:
        return {"offline": f"{BUNDLES}/{bundle}/repository"}
    bearers = declaration.sites[host.site].bearers
    if request.rehearsed or not bearers or not bearers[0].metered:
        return {}
    link = link_of(declaration, host.site, bearers[0].name)
    if request.accept_cost and link.cap_bytes is None:
        return {}
    return {
        "limit_bytes": link.cap_bytes if request.accept_cost else 0,
        "limit_words": f"over {link.name} of {host.site}, which is paid by the byte",
    }


def narrowed(desired: Mapping[str, Any], how: Mapping[str, Any], bundle: str | None) -> dict[str, Any]:
    """Give a part its ways: to packages by `how`, to sources that are built in the bundle alone, if there is one."""
    values = dict(desired)
    if values.get("packages") is not None:
        values["packages"] = {**values["packages"], **how}
    if values.get("build") is not None and bundle is not None:
        values["build"] = {**values["build"], "offline": f"{BUNDLES}/{bundle}/sources"}
    return values


def bundle_of(folder: Path | None) -> str | None:
    """The id of a bundle, as its manifest has it; it was opened, and found right, before."""
    if folder is None:
        return None
    from atlantis_netcfg.bundle.manifest import MANIFEST, read_manifest  # noqa: PLC0415 - most runs have no bundle

    path = folder / MANIFEST
    return read_manifest(path.read_bytes(), str(path)).id
