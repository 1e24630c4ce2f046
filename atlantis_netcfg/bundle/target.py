"""The system that a bundle is made for, as its own dpkg(1) describes it: /var/lib/dpkg/status of a card or a board."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from atlantis_netcfg.bundle._errors import BundleRefused

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

__all__ = ["Target", "paragraphs", "read_target"]

_RELEASES = {
    ("debian", "11"): "bullseye",
    ("debian", "12"): "bookworm",
    ("debian", "13"): "trixie",
    ("ubuntu", "11"): "focal",
    ("ubuntu", "12"): "jammy",
    ("ubuntu", "13"): "noble",
}
"""By the version of `base-files`, which begins with Debian's major number in both distributions."""


@dataclass(frozen=True, slots=True)
class Target:
    """What packages are resolved against."""

    status: bytes = field(repr=False)
    architecture: str
    """Debian's name for it, like arm64."""
    distribution: str
    """`debian` or `ubuntu`."""
    codename: str
    installed: Mapping[str, str]
    """Version of each package that is installed for that architecture."""

    @property
    def shown(self) -> str:
        """For people."""
        return f"{self.distribution} {self.codename} {self.architecture}"


def read_target(status: bytes, named: str) -> Target:
    """Read a status file; `named` is what people call it. Raises BundleRefused."""
    packages = list(paragraphs(status.decode(errors="replace")))
    local = next((each for each in packages if each.get("Package") == "dpkg"), None)
    base = next((each for each in packages if each.get("Package") == "base-files"), None)
    if local is None or base is None:
        missing = "dpkg" if local is None else "base-files"
        raise BundleRefused(
            f"{named} does not describe a system: `{missing}` is not in it",
            hint="/var/lib/dpkg/status of the board, or of the image that its card was made of",
        )
    version, architecture = base["Version"], local["Architecture"]
    distribution = "ubuntu" if "ubuntu" in version else "debian"
    codename = _RELEASES.get((distribution, re.split(r"\D", version, maxsplit=1)[0]))
    if codename is None:
        known = ", ".join(sorted(set(_RELEASES.values())))
        raise BundleRefused(
            f"{named}: `base-files {version}` is of no release that bundles are made for", hint=f"there are: {known}"
        )
    installed = {
        each["Package"]: each["Version"]
        for each in packages
        if each.get("Status", "").endswith(" ok installed") and each.get("Architecture") in {architecture, "all"}
    }
    return Target(status, architecture, distribution, codename, installed)


def paragraphs(text: str) -> Iterator[dict[str, str]]:
    """The paragraphs of a file in the format of deb822(5); continuation lines are kept with their field."""
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
