"""What a host needs of a bundle, made from the declaration by `operations.bundling`."""

from __future__ import annotations

from dataclasses import dataclass
from fnmatch import fnmatchcase

__all__ = ["HostWish", "Key", "Library", "Source", "Wished"]


@dataclass(frozen=True, slots=True)
class Wished:
    """A package."""

    name: str
    version: str | None
    """As apt takes it after `=`, also with a `*`; None: whatever the sources have."""

    @property
    def asked(self) -> str:
        """For a command line of apt."""
        return self.name if self.version is None else f"{self.name}={self.version}"

    def fits(self, version: str | None) -> bool:
        """Whether that version is what is wished; None: there is none."""
        return version is not None and (self.version is None or fnmatchcase(version, self.version))


@dataclass(frozen=True, slots=True)
class Source:
    """A file that tells apt where packages are, as it stands on the board."""

    path: str
    content: str


@dataclass(frozen=True, slots=True)
class Key:
    """A keyring that `Signed-By` of a source names."""

    path: str
    content: bytes


@dataclass(frozen=True, slots=True)
class Library:
    """A git repository at one revision, with all that its submodules name."""

    url: str
    revision: str
    token: str | None = None
    """Reads it; never on a command line, in the bundle or in a message."""

    def __repr__(self) -> str:
        return f"Library({self.url!r}, {self.revision!r})"


@dataclass(frozen=True, slots=True)
class HostWish:
    """Everything that the roles of one host take from elsewhere."""

    host: str
    packages: tuple[Wished, ...]
    sources: tuple[Source, ...] = ()
    keys: tuple[Key, ...] = ()
    pins: tuple[Source, ...] = ()
    libraries: tuple[Library, ...] = ()
    distribution: str | None = None
    codename: str | None = None
    """What the declaration expects of the board; None: nothing."""
