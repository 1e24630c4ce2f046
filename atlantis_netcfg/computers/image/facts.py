"""Value objects of an image: request, facts read from it, edits, and errors."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from atlantis_netcfg.core.errors import DeviceError, UsageError

if TYPE_CHECKING:
    from collections.abc import Mapping
    from ipaddress import IPv4Address, IPv4Interface


@dataclass(frozen=True, slots=True)
class StaticNetwork:
    """A fixed IP address."""

    address: IPv4Interface
    """Address with the prefix length of the LAN."""
    gateway: IPv4Address
    """The site's router; it also answers DNS."""
    domain: str


@dataclass(frozen=True, slots=True)
class ImageRequest:
    """Desired state of one host's image."""

    host: str
    site: str
    user: str
    """The account that the technicians log in to; it must be in the image."""
    keys: tuple[str, ...]
    """Lines of authorized_keys."""
    static: StaticNetwork | None
    """None: DHCP."""
    interface: str
    """Interface of the LAN; empty: the wired one, whatever its name."""
    time_zone: str
    time_servers: tuple[IPv4Address, ...]
    source: str
    """Name and SHA-256 of the vendor's image, recorded on the card."""


@dataclass(frozen=True, slots=True)
class Account:
    """An account of /etc/passwd."""

    name: str
    owner: tuple[int, int]
    home: str
    shell: str


@dataclass(frozen=True, slots=True)
class ImageFacts:
    """Facts read from an image's root file system."""

    files: Mapping[str, str]
    """Path -> text of the files that the planner reads; missing files have no entry."""
    present: frozenset[str]
    """Existing paths among those that the planner asks about."""
    names_by_folder: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    """Path of a directory -> names in it."""
    boot_words: Mapping[str, str] = field(default_factory=dict)
    """Display name -> text of the files that hold the kernel's command line."""

    def text(self, path: str) -> str:
        """Return a file's text; empty if it does not exist."""
        return self.files.get(path, "")


@dataclass(frozen=True, slots=True)
class ImageFile:
    """Write a regular file, replacing an existing one."""

    path: str
    content: bytes
    mode: int = 0o644
    owner: tuple[int, int] = (0, 0)
    """Numbers of the user and the group."""


@dataclass(frozen=True, slots=True)
class ImageDirectory:
    """Create a directory, or correct its mode and owner."""

    path: str
    mode: int = 0o755
    owner: tuple[int, int] = (0, 0)


@dataclass(frozen=True, slots=True)
class ImageLink:
    """Create a symbolic link, replacing an existing file or link."""

    path: str
    target: str


@dataclass(frozen=True, slots=True)
class Remove:
    """Remove a file or link."""

    path: str


Edit = ImageFile | ImageDirectory | ImageLink | Remove


class ImageError(UsageError):
    """The image cannot be used as it is; no card was touched."""


class BlockDeviceError(UsageError):
    """The device must not be written, or is not the one shown; nothing was written."""


class CardWriteError(DeviceError):
    """Writing failed part-way; the first block is cleared if possible, so that the card does not boot. Try again."""
