"""The index of a repository of Debian packages: what apt reads before it takes a package from it.

A flat repository (sources.list(5): `deb file:/folder ./`), one a host: a board sees exactly what was resolved for it.
"""

from __future__ import annotations

import hashlib
import lzma
from dataclasses import dataclass
from typing import TYPE_CHECKING

from atlantis_netcfg.bundle._errors import BundleRefused
from atlantis_netcfg.bundle.programs import run
from atlantis_netcfg.bundle.target import paragraphs

if TYPE_CHECKING:
    from collections.abc import Iterable
    from pathlib import Path

    from atlantis_netcfg.bundle.signing import Signer
    from atlantis_netcfg.bundle.target import Target

__all__ = ["Package", "index", "read_package"]

_DATE = "Sat, 01 Jan 2000 00:00:00 UTC"
"""apt refuses an index from the future, and a board's clock may stand in the past; see `signing`."""


@dataclass(frozen=True, slots=True)
class Package:
    """One .deb file."""

    name: str
    version: str
    architecture: str
    control: str
    size: int
    sha256: str

    @property
    def file(self) -> str:
        """Its name in a repository; a colon is nothing for the file systems of USB sticks."""
        return f"{self.name}_{self.version.replace(':', '-')}_{self.architecture}.deb"


def read_package(deb: Path, sha256: str) -> Package:
    """Look into a package file. Raises BundleRefused."""
    done = run(["dpkg-deb", "--field", str(deb)])
    control = done.stdout.decode(errors="replace").rstrip()
    fields = next(paragraphs(control), {})
    if done.returncode != 0 or not {"Package", "Version", "Architecture"} <= fields.keys():
        raise BundleRefused(f"{deb.name} is no Debian package", hint="remove it, and type the same again")
    return Package(fields["Package"], fields["Version"], fields["Architecture"], control, deb.stat().st_size, sha256)


def index(packages: Iterable[Package], target: Target, signer: Signer) -> dict[str, bytes]:
    """The files of the index by name; packages are expected in `pool` beside them."""
    ordered = sorted(packages, key=lambda each: (each.name, each.version, each.architecture))
    text = "\n".join(
        f"{each.control}\nFilename: ./pool/{each.file}\nSize: {each.size}\nSHA256: {each.sha256}\n" for each in ordered
    )
    plain = text.encode()
    packed = lzma.compress(plain)
    sums = "".join(
        f" {hashlib.sha256(data).hexdigest()} {len(data)} {name}\n"
        for name, data in (("Packages", plain), ("Packages.xz", packed))
    )
    release = (
        f"Origin: ATLANTIS bundle\nLabel: ATLANTIS bundle\nSuite: {target.codename}\nCodename: {target.codename}\n"
        f"Date: {_DATE}\nArchitectures: {target.architecture} all\nSHA256:\n{sums}"
    )
    return {"InRelease": signer.in_clear(release), "Packages.xz": packed}
