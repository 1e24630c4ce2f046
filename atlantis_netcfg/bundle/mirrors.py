"""Where the distributions' own packages come from, one row a distribution."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING

from atlantis_netcfg.bundle._errors import BundleRefused
from atlantis_netcfg.bundle.wish import Key, Source

if TYPE_CHECKING:
    from collections.abc import Mapping

    from atlantis_netcfg.bundle.target import Target

__all__ = ["DISTRIBUTIONS", "Distribution", "archive"]


@dataclass(frozen=True, slots=True)
class Distribution:
    """The archive of a distribution."""

    archive: str
    ports: str
    """Where architectures other than those of PCs are."""
    security: str
    """Appended to the archive's address; empty: security updates lie beside the rest."""
    components: str
    keyring: str
    keyring_package: str


DISTRIBUTIONS: Mapping[str, Distribution] = {
    "debian": Distribution(
        archive="http://deb.debian.org/debian",
        ports="http://deb.debian.org/debian",
        security="-security",
        components="main",
        keyring="/usr/share/keyrings/debian-archive-keyring.gpg",
        keyring_package="debian-archive-keyring",
    ),
    "ubuntu": Distribution(
        archive="http://archive.ubuntu.com/ubuntu",
        ports="http://ports.ubuntu.com/ubuntu-ports",
        security="",
        components="main restricted universe multiverse",
        keyring="/usr/share/keyrings/ubuntu-archive-keyring.gpg",
        keyring_package="ubuntu-keyring",
    ),
}
_OF_PCS = ("amd64", "i386")


def archive(target: Target, mirror: str | None, keyring: Path | None) -> tuple[Source, Key]:
    """The source of a target's own distribution and the key that signs it. Raises BundleRefused.

    `mirror` in place of the archive's address (Debian's security updates then lie at MIRROR-security, as mirrors have
    it); `keyring` in place of the distribution's own.
    """
    row = DISTRIBUTIONS[target.distribution]
    base = (mirror or (row.archive if target.architecture in _OF_PCS else row.ports)).rstrip("/")
    place = PurePosixPath(row.keyring)
    name = target.codename
    suites = f"{name} {name}-updates" + ("" if row.security else f" {name}-security")
    text = _stanza(base, suites, row, place)
    if row.security:
        text += "\n" + _stanza(base + row.security, f"{name}-security", row, place)
    return Source(f"/etc/apt/sources.list.d/{target.distribution}.sources", text), Key(str(place), _key(row, keyring))


def _stanza(base: str, suites: str, row: Distribution, keyring: PurePosixPath) -> str:
    return f"Types: deb\nURIs: {base}\nSuites: {suites}\nComponents: {row.components}\nSigned-By: {keyring}\n"


def _key(row: Distribution, keyring: Path | None) -> bytes:
    path = keyring or Path(row.keyring)
    try:
        return path.read_bytes()
    except OSError as error:
        hint = "`keyring=` names a file" if keyring else f"sudo apt install {row.keyring_package}, or add keyring=FILE"
        raise BundleRefused(
            f"the key of the distribution cannot be read: {path}: {error.strerror or error}", hint=hint
        ) from error
