"""What a bundle says of itself: `manifest.json`, signed by `manifest.json.asc`.

Paths of `files` are below the bundle's folder; those of `held` below /var/lib/atlantis/bundle/ID of a host's board.
"""

from __future__ import annotations

import hashlib
import json
import re
from pathlib import PurePosixPath
from typing import Annotated, Literal

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationError

from atlantis_netcfg.bundle.requirements import BundleRefused

FORMAT = 1
MANIFEST = "manifest.json"
SIGNATURE = "manifest.json.asc"
KEY = "key.gpg"
"""The public key by which manifest and repositories are signed."""


def _inside(path: str) -> str:
    parts = PurePosixPath(path).parts
    if not re.fullmatch(r"[A-Za-z0-9._+~@:/-]+", path) or path.startswith("/") or ".." in parts or not parts:
        raise ValueError("not a path below the bundle")
    return path


Inside = Annotated[str, AfterValidator(_inside)]
Sha256 = Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]


class _Data(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class File(_Data):
    """One file of the bundle; `size` in bytes."""

    path: Inside
    size: Annotated[int, Field(ge=0)]
    sha256: Sha256


class BundledLibrary(_Data):
    """A repository at the commit that its revision meant when the bundle was made."""

    url: str
    revision: str
    commit: Annotated[str, Field(pattern=r"^[0-9a-f]{40}([0-9a-f]{24})?$")]


class Image(_Data):
    """The vendor's image that cards are made of, for people; `path` is None where only its checksum is kept."""

    name: str
    sha256: Sha256
    path: Inside | None = None


class HostPart(_Data):
    """What is in it for one host."""

    architecture: str
    distribution: str
    codename: str
    wished: dict[str, str | None]
    """Package -> version as it was asked for; None: any."""
    installed: dict[str, str]
    """Of the wished ones: what the system that the bundle was resolved against already had."""
    packages: dict[str, str]
    """Package -> version in its repository."""
    libraries: tuple[BundledLibrary, ...] = ()
    held: dict[Inside, Inside]
    """Path on the board -> path in the bundle."""


class Manifest(_Data):
    """The whole bundle."""

    format: Literal[1] = 1
    id: Annotated[str, Field(pattern=r"^[0-9a-f]{16}$")]
    """Of its content: two bundles of the same things have the same."""
    site: str
    made: str
    """UTC, ISO 8601."""
    tool: str
    revision: str
    """Of the declaration, as `provision validate` tells it."""
    key: Annotated[str, Field(pattern=r"^[0-9A-F]{40}$")]
    """Fingerprint of the key that signs it."""
    files: tuple[File, ...]
    hosts: dict[str, HostPart]
    image: Image | None = None

    @property
    def size(self) -> int:
        """Bytes of all files."""
        return sum(file.size for file in self.files)

    def of(self, host: str) -> dict[str, File]:
        """Path on the board -> file, of one host."""
        files = {file.path: file for file in self.files}
        return {path: files[inside] for path, inside in sorted(self.hosts[host].held.items())}

    def encoded(self) -> bytes:
        """The text of the file."""
        return f"{json.dumps(self.model_dump(mode='json'), indent=1, ensure_ascii=False)}\n".encode()


def content_id(files: tuple[File, ...], hosts: dict[str, HostPart]) -> str:
    """The `id` of a manifest with that content."""
    data = [[file.model_dump() for file in files], {name: part.model_dump() for name, part in hosts.items()}]
    return hashlib.sha256(json.dumps(data, sort_keys=True).encode()).hexdigest()[:16]


def read_manifest(data: bytes, named: str) -> Manifest:
    """Take a manifest from its file. Raises BundleRefused."""
    try:
        result = json.loads(data)
    except ValueError as error:
        raise _damaged(named) from error
    made = result.get("format") if isinstance(result, dict) else None
    if isinstance(made, int) and made != FORMAT:
        raise BundleRefused(
            f"{named} is of format {made}, and this toolkit knows format {FORMAT}",
            hint="take the toolkit that made it, or make the bundle anew",
        )
    try:
        manifest = Manifest.model_validate(result)
    except ValidationError as error:
        raise _damaged(named) from error
    if not {inside for part in manifest.hosts.values() for inside in part.held.values()} <= {
        file.path for file in manifest.files
    }:
        raise _damaged(named)
    return manifest


def _damaged(named: str) -> BundleRefused:
    return BundleRefused(f"{named} cannot be understood", hint="the bundle is damaged: copy it again")
