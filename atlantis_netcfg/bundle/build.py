"""Making a bundle. One that was interrupted goes on where it was, and none is ever half.

What lies where in it:

- `manifest.json`, `manifest.json.asc`, `key.gpg`: what it is, signed
- `pool/*.deb`: packages, of all hosts together
- `hosts/HOST/repository/`: the index of those that this host gets
- `sources/git/SERVER/PATH/`: repositories of the libraries
- `images/`: the vendor's image, where one was given
"""

from __future__ import annotations

import shutil
from collections.abc import Callable
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from typing import TYPE_CHECKING

from atlantis_netcfg import __version__
from atlantis_netcfg.bundle._errors import BundleRefused
from atlantis_netcfg.bundle.index import index, read_package
from atlantis_netcfg.bundle.library import gather
from atlantis_netcfg.bundle.manifest import (
    KEY,
    MANIFEST,
    SIGNATURE,
    HeldLibrary,
    HostPart,
    Image,
    Manifest,
    content_id,
)
from atlantis_netcfg.bundle.resolve import Fetched, Root, sha256_of
from atlantis_netcfg.bundle.staging import Workshop, same, workshop

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from atlantis_netcfg.bundle.library import Gathered
    from atlantis_netcfg.bundle.signing import Signer
    from atlantis_netcfg.bundle.target import Target
    from atlantis_netcfg.bundle.wish import HostWish, Key, Source, Wished

__all__ = ["Order", "Purpose", "Size", "Tell", "make"]

Tell = Callable[[str, float | None], None]
"""Hears what is being done, and the share of it from 0 to 1 where that is known."""


@dataclass(frozen=True, slots=True)
class Purpose:
    """One host, the system on it, and where that system's own packages come from."""

    wish: HostWish
    target: Target
    archive: tuple[Source, Key] | None
    """None: all packages come from the sources of the wish."""


@dataclass(frozen=True, slots=True)
class Order:
    """What bundle is made, and where."""

    site: str
    revision: str
    """Of the declaration."""
    purposes: tuple[Purpose, ...]
    place: Path
    image: Path | None = None
    """The vendor's image; it is copied into the bundle."""


@dataclass(frozen=True, slots=True)
class Size:
    """What is going to be fetched, in bytes; told before it is."""

    packages: int
    whole: int
    to_fetch: int
    """Without what an interrupted or earlier bundle has left."""


def make(order: Order, signer: Signer, tell: Tell, sized: Callable[[Size], None]) -> Manifest:
    """Make the bundle; `sized` hears how much is fetched before it is, and may refuse. Raises BundleRefused."""
    with workshop(order.place) as work:
        tell("asking what there is", None)
        roots = {each.wish.host: _root(work, each) for each in order.purposes}
        lacking = {each.wish.host: roots[each.wish.host].lacking(_wanted(each)) for each in order.purposes}
        _reuse(work, lacking)
        sized(_size(roots, lacking))
        libraries = gather((library for each in order.purposes for library in each.wish.libraries), work.work / "git")
        for each in order.purposes:
            _fetch(roots[each.wish.host], each, lacking[each.wish.host], tell)
        work.add(KEY, signer.public)
        hosts = {}
        for each in order.purposes:
            part = _packages(work, signer, each, lacking[each.wish.host])
            hosts[each.wish.host] = _libraries(work, part, each, libraries)
        manifest = _signed(work, order, signer, hosts)
        work.finish()
    return manifest


def _fetch(root: Root, purpose: Purpose, files: Sequence[Fetched], tell: Tell) -> None:
    words = f"fetching packages for {purpose.wish.host}"
    root.fetch(_wanted(purpose), files, lambda share: tell(words, share))


def _wanted(purpose: Purpose) -> list[Wished]:
    """What the target does not have already, in one order."""
    has = purpose.target.installed
    return sorted(
        {each for each in purpose.wish.packages if not each.fits(has.get(each.name))}, key=lambda package: package.asked
    )


def _root(work: Workshop, purpose: Purpose) -> Root:
    request, target = purpose.wish, purpose.target
    expected = (request.distribution or target.distribution, request.codename or target.codename)
    if expected != (target.distribution, target.codename):
        raise BundleRefused(
            f"{request.host}: what is declared needs {' '.join(expected)}, and its system is {target.shown}",
            hint="take the image of that release, or declare the `distribution` of ROS 2 that this one has",
        )
    if purpose.archive is not None:
        source, key = purpose.archive
        request = replace(request, sources=(*request.sources, source), keys=(*request.keys, key))
    root = Root.make(work.work / "hosts" / request.host, work.work, target, request)
    if _wanted(purpose):
        root.update()
    return root


def _size(roots: dict[str, Root], lacking: dict[str, tuple[Fetched, ...]]) -> Size:
    files = {file.name: (root, file) for name, root in roots.items() for file in lacking[name]}
    missing = [file.size for root, file in files.values() if not root.has(file)]
    return Size(len(files), sum(file.size for _, file in files.values()), sum(missing))


def _packages(work: Workshop, signer: Signer, purpose: Purpose, fetched: Sequence[Fetched]) -> HostPart:
    """Put a host's packages and their index into the bundle."""
    request, target = purpose.wish, purpose.target
    packages = [read_package(_archived(work, file), file.sha256) for file in fetched]
    current = {}
    for package, file in zip(packages, fetched, strict=True):
        path = f"pool/{package.file}"
        if path not in work.files:
            work.add(path, _archived(work, file))
        if work.files[path].sha256 != file.sha256:
            raise BundleRefused(
                f"two sources have different packages of the same name and version: {package.file}",
                hint="leave one of the sources out",
            )
        current[f"repository/{path}"] = path
    for name, data in index(packages, target, signer).items():
        path = f"hosts/{request.host}/repository/{name}"
        work.add(path, data)
        current[f"repository/{name}"] = path
    current["repository/atlantis.gpg"] = KEY
    return HostPart(
        architecture=target.architecture,
        distribution=target.distribution,
        codename=target.codename,
        wished={each.name: each.version for each in request.packages},
        installed={
            each.name: target.installed[each.name] for each in request.packages if each.name in target.installed
        },
        packages={package.name: package.version for package in packages},
        held=current,
    )


def _archived(work: Workshop, file: Fetched) -> Path:
    """Where a package file is: in apt's folder, or in the bundle already."""
    inside = f"pool/{_pooled(file)}"
    return work.folder / inside if inside in work.files else work.work / "archives" / file.name


def _pooled(file: Fetched) -> str:
    """A package file's name in the bundle; apt writes the colon of an epoch as %3a."""
    return file.name.replace("%3a", "-")


def _reuse(work: Workshop, lacking: dict[str, tuple[Fetched, ...]]) -> None:
    """Take what an earlier bundle in this place has, or one that was interrupted; what it is worth its hash says."""
    for file in {file.name: file for files in lacking.values() for file in files}.values():
        target = work.work / "archives" / file.name
        for place in (work.folder, work.place):
            earlier = place / "pool" / _pooled(file)
            if not target.exists() and earlier.is_file() and earlier.stat().st_size == file.size:
                same(earlier, target)


def _libraries(work: Workshop, part: HostPart, purpose: Purpose, gathered: Gathered) -> HostPart:
    """Put a host's libraries into the bundle."""
    current, libraries = dict(part.held), []
    for library in purpose.wish.libraries:
        for path, source in gathered.files(library):
            inside = f"sources/{path.replace(':', '-')}"
            if inside not in work.files:
                work.add(inside, source.read_bytes())
            current[f"sources/{path}"] = inside
        commit = gathered.commits[library.url, library.revision]
        libraries.append(HeldLibrary(url=library.url, revision=library.revision, commit=commit))
    return part.model_copy(update={"held": current, "libraries": tuple(libraries)})


def _image(work: Workshop, image: Path | None) -> Image | None:
    if image is None:
        return None
    path = f"images/{image.name}"
    place = work.folder / path
    if not (place.is_file() and place.stat().st_size == image.stat().st_size and sha256_of(place) == sha256_of(image)):
        place.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(image, place)
    work.add(path, place)
    return Image(name=image.name, sha256=work.files[path].sha256, path=path)


def _signed(work: Workshop, order: Order, signer: Signer, hosts: dict[str, HostPart]) -> Manifest:
    """Write the manifest and its signature: from then on the folder is a bundle."""
    image = _image(work, order.image)
    files = tuple(work.files[path] for path in sorted(work.files))
    manifest = Manifest(
        id=content_id(files, hosts),
        site=order.site,
        made=datetime.now(UTC).isoformat(timespec="seconds"),
        tool=__version__,
        revision=order.revision,
        key=signer.fingerprint,
        files=files,
        hosts=hosts,
        image=image,
    )
    data = manifest.encoded()
    (work.folder / MANIFEST).write_bytes(data)
    (work.folder / SIGNATURE).write_bytes(signer.beside(data))
    return manifest
