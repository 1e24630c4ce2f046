"""What a host needs from a bundle, the target system of a bundle, and the error class.

The system is described by its own dpkg(1): /var/lib/dpkg/status of a card or a board. `operations.bundle` builds the
requirements from the inventory.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from fnmatch import fnmatchcase
from typing import TYPE_CHECKING

from atlantis_netcfg.core.errors import UsageError

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence
    from pathlib import Path


@dataclass(frozen=True, slots=True)
class PackageRequirement:
    """A Debian package that a host needs; `version` may be a pattern."""

    name: str
    version: str | None
    """Version as apt takes it after `=`, also with a `*`; None: whatever the sources have."""

    @property
    def apt_argument(self) -> str:
        """Package argument for an apt command line."""
        return self.name if self.version is None else f"{self.name}={self.version}"

    def fits(self, version: str | None) -> bool:
        """Return whether an installed version meets the requirement; None: not installed."""
        return version is not None and (self.version is None or fnmatchcase(version, self.version))


@dataclass(frozen=True, slots=True)
class PackageSource:
    """An apt sources file, as on the board."""

    path: str
    content: str


@dataclass(frozen=True, slots=True)
class RequirementKey:
    """A keyring that a source names in `Signed-By`."""

    path: str
    content: bytes


@dataclass(frozen=True, slots=True)
class Library:
    """A git repository at one revision, with its submodules."""

    url: str
    revision: str
    token: str | None = None
    """Access token to read it; never on a command line, in the bundle or in a message."""

    def __repr__(self) -> str:
        return f"Library({self.url!r}, {self.revision!r})"


@dataclass(frozen=True, slots=True)
class ContainerArchive:
    """An archive with a container image, identified by the SHA-256 in the inventory."""

    path: Path
    sha256: str

    @property
    def bundle_path(self) -> str:
        """Path in the bundle, the same on the board."""
        return f"images/{self.sha256}.tar"


@dataclass(frozen=True, slots=True)
class HostRequirements:
    """Everything that the roles of one host install from elsewhere."""

    host: str
    packages: tuple[PackageRequirement, ...]
    sources: tuple[PackageSource, ...] = ()
    keys: tuple[RequirementKey, ...] = ()
    pins: tuple[PackageSource, ...] = ()
    libraries: tuple[Library, ...] = ()
    archives: tuple[ContainerArchive, ...] = ()
    distribution: str | None = None
    codename: str | None = None
    """Codename that the inventory expects on the board; None: nothing is expected."""


class BundleError(UsageError):
    """A bundle cannot be made, or must not be used; nothing was contacted. `errors` lists each problem."""

    def __init__(self, message: str, *, hint: str | None = None, errors: Sequence[BundleError] = ()) -> None:
        super().__init__(message, hint=hint)
        self.errors = tuple(errors)


def join_errors(problems: Sequence[tuple[str, str | None]]) -> BundleError:
    """Combine all problems (message and hint) into one error."""
    rows = [BundleError(message, hint=hint) for message, hint in problems]
    return BundleError("\n".join(str(row) for row in rows), hint=rows[-1].hint, errors=rows)


_RELEASES = {
    ("debian", "11"): "bullseye",
    ("debian", "12"): "bookworm",
    ("debian", "13"): "trixie",
    ("ubuntu", "11"): "focal",
    ("ubuntu", "12"): "jammy",
    ("ubuntu", "13"): "noble",
}
"""Distribution and major version of `base-files`, which is Debian's in both distributions -> codename."""


@dataclass(frozen=True, slots=True)
class BundleTarget:
    """The system against which packages are resolved."""

    status: bytes = field(repr=False)
    architecture: str
    """Debian's name for it, like arm64."""
    distribution: str
    """`debian` or `ubuntu`."""
    codename: str
    installed_packages: Mapping[str, str]
    """Version of each package that is installed for that architecture."""

    @property
    def title(self) -> str:
        """Short description for people."""
        return f"{self.distribution} {self.codename} {self.architecture}"


def read_target(status: bytes, label: str) -> BundleTarget:
    """Parse a dpkg status file; `label` names it in messages. Raises BundleError."""
    packages = list(paragraphs(status.decode(errors="replace")))
    local = next((each for each in packages if each.get("Package") == "dpkg"), None)
    base = next((each for each in packages if each.get("Package") == "base-files"), None)
    if local is None or base is None:
        missing = "dpkg" if local is None else "base-files"
        raise BundleError(
            f"{label} does not describe a system: `{missing}` is not in it",
            hint="/var/lib/dpkg/status of the board, or of the image that its card was made of",
        )
    version, architecture = base["Version"], local["Architecture"]
    distribution = "ubuntu" if "ubuntu" in version else "debian"
    codename = _RELEASES.get((distribution, re.split(r"\D", version, maxsplit=1)[0]))
    if codename is None:
        codenames = ", ".join(sorted(set(_RELEASES.values())))
        raise BundleError(
            f"{label}: `base-files {version}` is of no release that bundles are made for",
            hint=f"there are: {codenames}",
        )
    installed_packages = {
        each["Package"]: each["Version"]
        for each in packages
        if each.get("Status", "").endswith(" ok installed") and each.get("Architecture") in {architecture, "all"}
    }
    return BundleTarget(status, architecture, distribution, codename, installed_packages)


def paragraphs(text: str) -> Iterator[dict[str, str]]:
    """Yield the paragraphs of a deb822(5) file; continuation lines stay with their field."""
    for block in re.split(r"\n\s*\n", text):
        fields: dict[str, str] = {}
        name = ""
        for line in block.splitlines():
            if line[:1] in {" ", "\t"} and name:
                fields[name] += f"\n{line}"
            elif ":" in line and not line.startswith("#"):
                name, _, value = line.partition(":")
                fields[name] = value.strip()
        if fields:
            yield fields
