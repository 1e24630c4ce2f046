"""Bundles for the hosts of a site: from the inventory to each host's needs, and from there to a bundle.

The parts of a computer name the files that they need from outside. A dpkg status lists a host's packages: from a file,
from the vendor's image, or from the board itself.
"""

from __future__ import annotations

import base64
import gzip
import shlex
import zlib
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from atlantis_netcfg import inventory
from atlantis_netcfg.computers.bundle import build, manifest, requirements
from atlantis_netcfg.computers.bundle.open import Bundle, open_bundle
from atlantis_netcfg.computers.bundle.resolve import archive
from atlantis_netcfg.computers.image import ext4
from atlantis_netcfg.computers.image.facts import ImageError
from atlantis_netcfg.computers.image.source import checksum, expand
from atlantis_netcfg.core import events, temporary
from atlantis_netcfg.core.errors import NoMatchError
from atlantis_netcfg.core.messages import arg, join, msg
from atlantis_netcfg.inventory import model
from atlantis_netcfg.operations.common.request import Request, refuse_examples
from atlantis_netcfg.operations.computers._access import key_trouble
from atlantis_netcfg.operations.computers.parts import ACCESS, PARTS, Part, concerns

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping, Sequence
    from pathlib import Path

    from atlantis_netcfg.inventory import Host, Inventory


IMAGES = "images"
"""Inventory folder with the archives of container images."""
_STATUS = "/var/lib/dpkg/status"
_READ_STATUS = f"gzip -9c {_STATUS}"


def from_file(path: Path) -> requirements.BundleTarget:
    """Read a copy of /var/lib/dpkg/status; raise BundleError."""
    try:
        status = path.read_bytes()
    except OSError as error:
        raise requirements.BundleError(
            msg(f"cannot read {arg(path)}: {arg(error.strerror or error)}"),
            hint=msg(f"`status=` takes a copy of the board's {arg(_STATUS)}"),
        ) from error
    return requirements.read_target(status, str(path))


def from_image(host: Host, image: Path, tell: Callable[[int, int], None]) -> requirements.BundleTarget:
    """Read the dpkg status from the vendor's image of the host's card; raise BundleError or ImageError."""
    if not image.is_file():
        raise ImageError(f"{arg(image)} is not a file", hint="`image=` takes the vendor's image, like x.img.xz")
    ext4.require_tools("e2fsck", "debugfs")
    device = host.device
    layout = (
        device.image.layout
        if isinstance(device, model.SiteComputer) and device.image is not None
        else model.ImageLayout.PLAIN
    )
    with temporary.folder("bundle", temporary.large_temp_dir()) as folder:
        copy = folder / "image"
        expand(image, copy, checksum(image), tell)
        root = ext4.Ext4(copy, ext4.find(copy, ext4.LAYOUTS[layout]).root)
        root.recover()
        status = root.read(_STATUS)
    if status is None:
        raise requirements.BundleError(
            msg(f"{arg(image)} does not contain {arg(_STATUS)}"), hint="bundles support only Debian and Ubuntu"
        )
    return requirements.read_target(status, image.name)


def from_board(inventory: Inventory, host: Host, request: Request) -> requirements.BundleTarget:
    """Read the dpkg status from the board by SSH; raise BundleError, always for a metered link."""
    access = PARTS[ACCESS](inventory, host, request)
    others = "give its package list with `status=FILE` (a copy of its /var/lib/dpkg/status) or `image=FILE`"
    if access.get("metered"):
        raise requirements.BundleError(
            msg(f"{arg(host.name)} is reached over metered link {arg(access['metered'])}"), hint=others
        )
    options = ["-o", "BatchMode=yes", "-o", "ConnectTimeout=120", "-p", str(access["port"])]
    words = [*options, *shlex.split(access["ssh_args"]), f"{access['user']}@{access['host']}", _READ_STATUS]
    process = manifest.run(["ssh", *words])
    if process.returncode != 0:
        text = process.stderr.decode(errors="replace").strip()
        why, hint = key_trouble(host.name, text) or (text.splitlines()[-1] if text else "no message", others)
        raise requirements.BundleError(msg(f"cannot read the package list of {arg(host.name)}: {arg(why)}"), hint=hint)
    try:
        status = gzip.decompress(process.stdout)
    except (OSError, EOFError, zlib.error) as error:
        raise requirements.BundleError(
            msg(f"{arg(host.name)}: its response was truncated"), hint="run the same command again"
        ) from error
    return requirements.read_target(status, f"{host.name}:{_STATUS}")


def bundle_hosts(pilot_inventory: Inventory, site: str, only: Sequence[str] = ()) -> tuple[Host, ...]:
    """Return the hosts that a bundle is made for; raise NoMatchError if there are none."""
    hosts = tuple(
        host for host in inventory.choose(pilot_inventory, site, only) if isinstance(host.device, model.SiteComputer)
    )
    if not hosts:
        scope = join(", ", (f"`{name}`" for name in only)) or msg(f"site `{arg(site)}`")
        raise NoMatchError(
            f"{arg(scope)}: no gateway, control centre or operator station is selected, and bundles are only for these",
            hint="see the hosts of groups `gateways`, `control_centres` and `operator_stations`",
        )
    return hosts


def host_requirements(
    inventory: Inventory,
    host: Host,
    request: Request,
    *,
    parts: Mapping[str, Part] = PARTS,
    tokens: bool = False,
) -> requirements.HostRequirements:
    """Return the packages that a host's parts need, and the library that is built there.

    `tokens`: include the tokens that read the library; the inventory must have been loaded with its secrets.
    """
    result = [
        part(inventory, host, request).get("packages") or {} for name, part in parts.items() if concerns(name, host)
    ]
    expected_release: Mapping[str, Any] = next((each["expected"] for each in result if each.get("expected")), {})
    return requirements.HostRequirements(
        host=host.name,
        packages=tuple(
            dict.fromkeys(
                requirements.PackageRequirement(row["name"], row.get("version"))
                for row in _collect_rows(result, "packages")
            )
        ),
        sources=tuple(
            dict.fromkeys(
                requirements.PackageSource(source["path"], source["content"])
                for source in _collect_rows(result, "sources")
            )
        ),
        keys=tuple(
            dict.fromkeys(
                requirements.RequirementKey(item["path"], base64.b64decode(item["content_base64"]))
                for item in _collect_rows(result, "keys")
            )
        ),
        pins=tuple(
            dict.fromkeys(
                requirements.PackageSource(row["path"], row["content"]) for row in _collect_rows(result, "pins")
            )
        ),
        libraries=_libraries(inventory, tokens=tokens) if _has_interop(host) else (),
        archives=_archives(inventory, host),
        distribution=expected_release.get("distribution"),
        codename=expected_release.get("codename"),
    )


def _has_interop(host: Host) -> bool:
    return isinstance(host.device, model.ServerComputer) and host.device.has_interop


def _archives(inventory: Inventory, host: Host) -> tuple[requirements.ContainerArchive, ...]:
    """Return the image archives of a computer's containers, from the inventory's folder `images`."""
    if not isinstance(host.device, model.ServerComputer):
        return ()
    boxes = (*(service.container for service in host.device.services), host.device.ros1_bridge)
    archives = [
        (inventory.root / IMAGES / box.archive, box.sha256.lower())
        for box in boxes
        if box is not None and box.archive is not None and box.sha256 is not None
    ]
    return tuple(requirements.ContainerArchive(*each) for each in dict.fromkeys(archives))


def _collect_rows(result: Iterable[Mapping[str, Any]], name: str) -> Iterable[Mapping[str, Any]]:
    return (row for part in result for row in part.get(name) or ())


def has_tokens(inventory: Inventory) -> bool:
    """Return whether a token reads the library: then the inventory must be loaded with its secrets."""
    return any(repository.token is not None for repository in _repositories(inventory))


def _repositories(inventory: Inventory) -> tuple[model.Repository, ...]:
    interop = inventory.pilot.gateways.interop
    repositories = (interop.library, interop.examples) if interop is not None else ()
    return tuple(repository for repository in repositories if repository is not None)


def _libraries(inventory: Inventory, *, tokens: bool) -> tuple[requirements.Library, ...]:
    return tuple(_library(repository, tokens=tokens) for repository in _repositories(inventory))


def _library(repository: model.Repository, *, tokens: bool) -> requirements.Library:
    secret = repository.token if tokens else None
    return requirements.Library(repository.url, repository.revision, secret.reveal() if secret is not None else None)


@dataclass(frozen=True, slots=True)
class BundleRequest:
    """A person's bundle request; the inventory has its secrets if the library needs a token."""

    inventory: Inventory
    site: str
    hosts: tuple[Host, ...]
    place: Path
    request: Request
    status: Path | None = None
    image: Path | None = None
    """At most one of `status` and `image` is set; if neither is, each host is queried."""
    mirror: str | None = None
    keyring: Path | None = None


def make_bundle(
    bundle_request: BundleRequest, notify: events.Subscriber, on_size: Callable[[build.BundleSize], None]
) -> manifest.Manifest:
    """Make the bundle; `on_size` receives the download size before it starts. Raise UsageError, mostly BundleError."""
    refuse_examples(bundle_request.inventory, is_rehearsal=False)
    manifest.require_programs()
    purposes = tuple(_purpose(bundle_request, host, notify) for host in bundle_request.hosts)
    order = build.BundleOrder(
        bundle_request.site, bundle_request.inventory.revision, purposes, bundle_request.place, bundle_request.image
    )

    def tell(words: str, share: float | None) -> None:
        percentage = "" if share is None else f" {100 * share:.0f} %"
        for host in bundle_request.hosts:
            notify(events.Event(host.name, events.Stage.OBSERVED, f"{words}{percentage}"))

    return build.make(order, manifest.Keys.of(bundle_request.request.state).signer(), tell, on_size)


def open_for_hosts(
    inventory: Inventory,
    hosts: Sequence[Host],
    place: Path,
    request: Request,
    *,
    accept: str | None = None,
) -> Bundle:
    """Open a bundle and check that it has everything for these hosts; raise BundleError with all that is missing.

    `accept`: a key that a person has typed; bundles made with it are accepted from now on.
    """
    wishes = [host_requirements(inventory, host, request) for host in hosts]
    return open_bundle(place, manifest.Keys.of(request.state), wishes, accept=accept)


def _purpose(bundle_request: BundleRequest, host: Host, notify: events.Subscriber) -> build.BundlePurpose:
    request = host_requirements(bundle_request.inventory, host, bundle_request.request, tokens=True)
    target = _target(bundle_request, host, notify)
    notify(
        events.Event(
            host.name,
            events.Stage.OBSERVED,
            msg(f"{arg(target.title)}, {arg(len(target.installed_packages))} packages"),
        )
    )
    missing = any(not each.fits(target.installed_packages.get(each.name)) for each in request.packages)
    return build.BundlePurpose(
        request, target, archive(target, bundle_request.mirror, bundle_request.keyring) if missing else None
    )


def _target(bundle_request: BundleRequest, host: Host, notify: events.Subscriber) -> requirements.BundleTarget:
    if bundle_request.status is not None:
        return from_file(bundle_request.status)
    if bundle_request.image is not None:
        name = bundle_request.image.name
        notify(events.Event(host.name, events.Stage.CONNECTING, msg(f"reading {arg(name)}")))
        return from_image(host, bundle_request.image, lambda _count, _total: None)
    notify(events.Event(host.name, events.Stage.CONNECTING, "reading the package list"))
    return from_board(bundle_request.inventory, host, bundle_request.request)
