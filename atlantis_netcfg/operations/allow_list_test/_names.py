"""The names of an allow-list, and what they resolve to on this computer."""

from __future__ import annotations

import asyncio
import socket
from typing import TYPE_CHECKING

from atlantis_netcfg.bearers.satellite import NamedTarget
from atlantis_netcfg.declaration.satellite_allow_list import VPN_TARGET, allowed

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping

    from atlantis_netcfg.declaration import Declaration
    from atlantis_netcfg.declaration.model import Bearer

__all__ = ["named_targets", "resolve"]

TIMEOUT_S = 10.0
"""For all names together: a resolver that has not answered by then is told as silent."""


def named_targets(declaration: Declaration, site: str, bearer: Bearer) -> tuple[NamedTarget, ...]:
    """The entries of a link's allow-list that have a name, the VPN's among them."""
    return tuple(
        NamedTarget(
            target.name,
            target.dns_name,
            str(target.address),
            "pilot.vpn in group_vars/all/pilot.yml"
            if target.name == VPN_TARGET and target.address == declaration.pilot.vpn.endpoint
            else f"`allow` of `{bearer.name}` in group_vars/{site}.yml",
        )
        for target in allowed(declaration.pilot, bearer)
        if target.dns_name is not None
    )


def _ask(name: str) -> frozenset[str] | None:
    """IPv4 addresses of a name; empty if it does not exist, None if the resolver could not tell."""
    try:
        found = socket.getaddrinfo(name, None, family=socket.AF_INET, type=socket.SOCK_STREAM)
    except socket.gaierror as error:
        gone = (socket.EAI_NONAME, getattr(socket, "EAI_NODATA", socket.EAI_NONAME))
        return frozenset() if error.errno in gone else None
    except OSError:
        return None
    return frozenset(str(address[4][0]) for address in found)


async def resolve(
    names: Iterable[str],
    *,
    timeout_s: float = TIMEOUT_S,
    ask: Callable[[str], frozenset[str] | None] = _ask,
) -> Mapping[str, frozenset[str] | None]:
    """Ask this computer's resolver for all names at once; a name without an answer in time is None.

    A computer without network also says that a name does not exist: what it says is only as good as its resolver.
    """
    wanted = tuple(dict.fromkeys(names))
    work = {name: asyncio.ensure_future(asyncio.to_thread(ask, name)) for name in wanted}
    if work:
        await asyncio.wait(work.values(), timeout=timeout_s)
    found: dict[str, frozenset[str] | None] = {}
    for name, one in work.items():
        done = one.done() and not one.cancelled()
        one.cancel()
        found[name] = one.result() if done else None
    return found
