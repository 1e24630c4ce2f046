"""Make the bundle of a site, or open one for it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from atlantis_netcfg.bundle import (
    Bundle,
    Keys,
    Manifest,
    Order,
    Purpose,
    Size,
    Target,
    archive,
    make,
    open_bundle,
)
from atlantis_netcfg.bundle.programs import require
from atlantis_netcfg.core.events import Event, Stage
from atlantis_netcfg.operations.bundle._target import from_board, from_file, from_image
from atlantis_netcfg.operations.bundle._wish import wish_of
from atlantis_netcfg.operations.request import refuse_examples

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path

    from atlantis_netcfg.core.events import Subscriber
    from atlantis_netcfg.declaration import Declaration, Host
    from atlantis_netcfg.operations.request import Request

__all__ = ["Asked", "made", "opened"]


@dataclass(frozen=True, slots=True)
class Asked:
    """What a person has asked for; the declaration has its secrets where the library needs a token."""

    declaration: Declaration
    site: str
    hosts: tuple[Host, ...]
    place: Path
    request: Request
    status: Path | None = None
    image: Path | None = None
    """Of these two at most one; neither: each host is asked itself."""
    mirror: str | None = None
    keyring: Path | None = None


def made(requested: Asked, notify: Subscriber, sized: Callable[[Size], None]) -> Manifest:
    """Make the bundle; `sized` hears how much is fetched before it is. Raises UsageError, as BundleRefused mostly."""
    refuse_examples(requested.declaration, rehearsed=False)
    require()
    purposes = tuple(_purpose(requested, host, notify) for host in requested.hosts)
    order = Order(requested.site, requested.declaration.revision, purposes, requested.place, requested.image)

    def tell(words: str, share: float | None) -> None:
        shown = "" if share is None else f" {100 * share:.0f} %"
        for host in requested.hosts:
            notify(Event(host.name, Stage.OBSERVED, f"{words}{shown}"))

    return make(order, Keys.of(requested.request.state).signer(), tell, sized)


def opened(
    declaration: Declaration, hosts: Sequence[Host], place: Path, request: Request, *, accept: str | None = None
) -> Bundle:
    """Open a bundle for these hosts; it holds all that the declaration wants. Raises BundleRefused with all it lacks.

    `accept`: take bundles of another computer's key from now on, which a person has typed.
    """
    wishes = [wish_of(declaration, host, request) for host in hosts]
    return open_bundle(place, Keys.of(request.state), wishes, accept=accept)


def _purpose(requested: Asked, host: Host, notify: Subscriber) -> Purpose:
    request = wish_of(requested.declaration, host, requested.request, tokens=True)
    target = _target(requested, host, notify)
    notify(Event(host.name, Stage.OBSERVED, f"{target.shown}, {len(target.installed)} packages"))
    missing = any(not each.fits(target.installed.get(each.name)) for each in request.packages)
    return Purpose(request, target, archive(target, requested.mirror, requested.keyring) if missing else None)


def _target(requested: Asked, host: Host, notify: Subscriber) -> Target:
    if requested.status is not None:
        return from_file(requested.status)
    if requested.image is not None:
        name = requested.image.name
        notify(Event(host.name, Stage.CONNECTING, f"looking into {name}"))
        return from_image(host, requested.image, lambda _done, _total: None)
    notify(Event(host.name, Stage.CONNECTING, "asking what is installed"))
    return from_board(requested.declaration, host, requested.request)
