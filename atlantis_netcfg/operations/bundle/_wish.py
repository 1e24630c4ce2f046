"""From the declaration to what the roles of a host take from elsewhere: the parts of a gateway say it themselves."""

from __future__ import annotations

import base64
from typing import TYPE_CHECKING, Any

from atlantis_netcfg.bundle import HostWish, Key, Library, Source, Wished
from atlantis_netcfg.core.errors import NothingMatched
from atlantis_netcfg.declaration import choose
from atlantis_netcfg.operations.computers import is_gateway
from atlantis_netcfg.operations.computers.parts import PARTS, concerns

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from atlantis_netcfg.declaration import Declaration, Host
    from atlantis_netcfg.declaration.model import Repository
    from atlantis_netcfg.operations.computers.parts import Part
    from atlantis_netcfg.operations.request import Request

__all__ = ["gateways_of", "has_tokens", "wish_of"]


def gateways_of(declaration: Declaration, site: str, only: Sequence[str] = ()) -> tuple[Host, ...]:
    """The hosts that a bundle is made for. Raises NothingMatched where there is none."""
    hosts = tuple(host for host in choose(declaration, site, only) if is_gateway(host))
    if not hosts:
        named = ", ".join(f"`{name}`" for name in only) or f"site `{site}`"
        raise NothingMatched(
            f"{named}: no gateway computer is among these hosts, and others take nothing from a bundle",
            hint="gateway computers are the hosts of group `gateways`",
        )
    return hosts


def wish_of(
    declaration: Declaration,
    host: Host,
    request: Request,
    *,
    parts: Mapping[str, Part] = PARTS,
    tokens: bool = False,
) -> HostWish:
    """What a host's parts need of packages, and the library that is built there.

    `tokens`: with those that read the library, for which the declaration must have been loaded with its secrets.
    """
    result = [
        part(declaration, host, request).get("packages") or {} for name, part in parts.items() if concerns(name, host)
    ]
    expected: Mapping[str, Any] = next((each["expected"] for each in result if each.get("expected")), {})
    return HostWish(
        host=host.name,
        packages=tuple(dict.fromkeys(Wished(one["name"], one.get("version")) for one in _all(result, "packages"))),
        sources=tuple(dict.fromkeys(Source(one["path"], one["content"]) for one in _all(result, "sources"))),
        keys=tuple(
            dict.fromkeys(Key(item["path"], base64.b64decode(item["content_base64"])) for item in _all(result, "keys"))
        ),
        pins=tuple(dict.fromkeys(Source(row["path"], row["content"]) for row in _all(result, "pins"))),
        libraries=_libraries(declaration, tokens=tokens),
        distribution=expected.get("distribution"),
        codename=expected.get("codename"),
    )


def _all(result: Iterable[Mapping[str, Any]], name: str) -> Iterable[Mapping[str, Any]]:
    return (row for part in result for row in part.get(name) or ())


def has_tokens(declaration: Declaration) -> bool:
    """Whether the library is read by a token, for which the declaration has to be loaded with its secrets."""
    return any(repository.token is not None for repository in _repositories(declaration))


def _repositories(declaration: Declaration) -> tuple[Repository, ...]:
    interop = declaration.pilot.gateways.interop
    declared = (interop.library, interop.examples) if interop is not None else ()
    return tuple(repository for repository in declared if repository is not None)


def _libraries(declaration: Declaration, *, tokens: bool) -> tuple[Library, ...]:
    return tuple(_library(repository, tokens=tokens) for repository in _repositories(declaration))


def _library(repository: Repository, *, tokens: bool) -> Library:
    secret = repository.token if tokens else None
    return Library(repository.url, repository.revision, secret.reveal() if secret is not None else None)
