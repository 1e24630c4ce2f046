"""What an image shall become, and what was found in it: the two inputs of the planner."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Mapping
    from ipaddress import IPv4Address, IPv4Interface

__all__ = ["Account", "Seen", "Static", "Wish"]


@dataclass(frozen=True, slots=True)
class Static:
    """A fixed address."""

    address: IPv4Interface
    """With the prefix length of the LAN."""
    gateway: IPv4Address
    """The site's router; it also answers DNS."""
    domain: str


@dataclass(frozen=True, slots=True)
class Wish:
    """One host's image."""

    host: str
    site: str
    user: str
    """The account that the technicians log in to; it must be in the image."""
    keys: tuple[str, ...]
    """Lines of authorized_keys."""
    static: Static | None
    """None: DHCP."""
    interface: str
    """Name of the LAN's interface; empty: the wired one, whatever its name."""
    time_zone: str
    time_servers: tuple[IPv4Address, ...]
    source: str
    """Name and SHA-256 of the vendor's image, for the card's own record."""


@dataclass(frozen=True, slots=True)
class Account:
    """A line of /etc/passwd."""

    name: str
    owner: tuple[int, int]
    home: str
    shell: str


@dataclass(frozen=True, slots=True)
class Seen:
    """What was found in an image's root file system."""

    files: Mapping[str, str]
    """Texts of the files that the planner reads, by path; those that are missing are not there."""
    present: frozenset[str]
    """Which of the paths that the planner asks about exist."""
    listed: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    """Names in directories, by path."""
    boot_words: Mapping[str, str] = field(default_factory=dict)
    """Texts of the files that hold the kernel's command line, by what a person calls them."""

    def text(self, path: str) -> str:
        """A file's text; empty where there is none."""
        return self.files.get(path, "")
