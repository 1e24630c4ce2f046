"""Open a bundle: the key is trusted, files are unchanged, and everything the inventory requires is included."""

from __future__ import annotations

import tarfile
from dataclasses import dataclass
from typing import TYPE_CHECKING

from atlantis_netcfg.computers.bundle import requirements
from atlantis_netcfg.computers.bundle.manifest import KEY, MANIFEST, SIGNATURE, Manifest, find_signer, read_manifest
from atlantis_netcfg.computers.bundle.resolve import sha256_of

if TYPE_CHECKING:
    from collections.abc import Collection, Iterator, Sequence
    from pathlib import Path

    from atlantis_netcfg.computers.bundle.manifest import BundleFile, HostPart, Keys

_TAR_RECORD = 10240
"""An archive ends with a whole record (tar(5)); each file has a header of 512 bytes and is padded to 512 bytes."""


@dataclass(frozen=True, slots=True)
class Bundle:
    """A bundle whose signature and files have been verified."""

    folder: Path
    manifest: Manifest

    def pack(self, host: str, digests: Collection[str], archive: Path) -> int:
        """Pack the files with these SHA-256 into a tar archive, named by hash; return its size in bytes."""
        files = {file.sha256: file for file in self.manifest.of(host).values() if file.sha256 in digests}
        with tarfile.open(archive, "w", format=tarfile.USTAR_FORMAT) as tar:
            for sha256, file in sorted(files.items(), key=lambda each: (each[1].size, each[0])):
                member = tarfile.TarInfo(sha256)
                member.size, member.mode = file.size, 0o644
                with (self.folder / file.path).open("rb") as content:
                    tar.addfile(member, content)
        return archive.stat().st_size


def bytes_to_carry(bundle: Bundle, host: str, there: Collection[str] = ()) -> int:
    """Return the bytes to transfer to a host, as one archive; `there`: SHA-256 of files on its board.

    Without `there` it is the maximum. The overhead of SSH (about 1 %) is not included.
    """
    sizes = {file.sha256: file.size for file in bundle.manifest.of(host).values() if file.sha256 not in there}
    if not sizes:
        return 0
    blocks = sum(512 + -(-size // 512) * 512 for size in sizes.values()) + 1024
    return -(-blocks // _TAR_RECORD) * _TAR_RECORD


def open_bundle(
    folder: Path,
    keys: Keys,
    wishes: Sequence[requirements.HostRequirements] | None = None,
    *,
    accept: str | None = None,
) -> Bundle:
    """Open a bundle for these hosts. Raises BundleError with everything that is wrong or missing.

    `wishes` None: accept any contents, without comparing them with requirements. `accept`: the fingerprint of another
    computer's key, as typed by a person.
    """
    bundle = Bundle(folder, _verify_manifest(folder, keys, accept))
    manifest = bundle.manifest
    hint = f"copy the bundle again, or make it anew: `provision gateway bundle site={manifest.site}`"
    problems: list[tuple[str, str | None]] = [(words, hint) for words in _find_damage(folder, manifest)]
    again = f"on a computer with internet: `provision gateway bundle site={manifest.site}`"
    problems += [(words, again) for request in wishes or () for words in _missing_parts(manifest, request)]
    if problems:
        raise requirements.join_errors(problems)
    return bundle


def _verify_manifest(folder: Path, keys: Keys, accept: str | None) -> Manifest:
    try:
        data, signature, public = ((folder / name).read_bytes() for name in (MANIFEST, SIGNATURE, KEY))
    except OSError as error:
        raise requirements.BundleError(
            f"{folder} is no bundle, or not a whole one: {error.filename}: {error.strerror}",
            hint="name the folder itself; `provision gateway bundle site=…` makes one, and tells where it has put it",
        ) from error
    fingerprint = find_signer(data, signature, public)
    if fingerprint is None:
        raise requirements.BundleError(
            f"the manifest of {folder} is not what was signed: it was damaged, or changed by somebody",
            hint="copy the bundle again, or make it anew",
        )
    if accept is not None and accept.replace(" ", "").upper() != fingerprint:
        raise requirements.BundleError(
            f"{folder} was signed by key {fingerprint}, and not by {accept}", hint="ask again who made it, and how"
        )
    if accept is None and not keys.accepts(fingerprint):
        raise requirements.BundleError(
            f"{folder} was signed on another computer, by key {fingerprint}",
            hint="let whoever made it read you the key; if it is this one:"
            f" `provision gateway bundle site=… check={folder} key={fingerprint}`",
        )
    manifest = read_manifest(data, f"{folder}/{MANIFEST}")
    if manifest.key != fingerprint:
        raise requirements.BundleError(
            f"the manifest of {folder} names another key than its own", hint="make the bundle anew"
        )
    if accept is not None:
        keys.accept(fingerprint)
    return manifest


def _find_damage(folder: Path, manifest: Manifest) -> Iterator[str]:
    for file in manifest.files:
        if words := _describe_damage(folder / file.path, file):
            yield f"{file.path}: {words}"


def _describe_damage(path: Path, file: BundleFile) -> str:
    try:
        size = path.stat().st_size
        if size != file.size:
            return f"it has {size} bytes, and {file.size} were put there"
        return "" if sha256_of(path) == file.sha256 else "its content is not what was put there"
    except OSError as error:
        return f"it cannot be read: {error.strerror or error}"


def _missing_parts(manifest: Manifest, request: requirements.HostRequirements) -> Iterator[str]:
    part = manifest.hosts.get(request.host)
    if part is None:
        yield f"{request.host}: the bundle was made for {', '.join(manifest.hosts) or 'no host'}"
        return
    expected_release = (request.distribution or part.distribution, request.codename or part.codename)
    if expected_release != (part.distribution, part.codename):
        yield (
            f"{request.host}: it is for {part.distribution} {part.codename}, "
            f"and {' '.join(expected_release)} is declared"
        )
    for package in request.packages:
        has = part.packages.get(package.name)
        installed_version = part.installed.get(package.name)
        if not package.fits(has) and not package.fits(installed_version):
            yield f"{request.host}: package {package.apt_argument}: {_describe_difference(has or installed_version)}"
    yield from _libraries(part, request)
    for archive in request.archives:
        if archive.bundle_path not in part.held:
            yield f"{request.host}: {archive.path.name} with the SHA-256 {archive.sha256}: {_describe_difference(None)}"


def _libraries(part: HostPart, request: requirements.HostRequirements) -> Iterator[str]:
    for library in request.libraries:
        current = [each.revision for each in part.libraries if each.url == library.url]
        if library.revision not in current:
            yield f"{request.host}: {library.url} at {library.revision}: {_describe_difference(', '.join(current))}"


def _describe_difference(has: str | None) -> str:
    return f"the bundle has {has}" if has else "it is not in the bundle"
