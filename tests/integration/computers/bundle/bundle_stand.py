"""A target of another architecture, archives of stand-ins for it, and bundles made from them."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from atlantis_netcfg.computers.bundle.build import BundleOrder, BundlePurpose, BundleSize, make
from atlantis_netcfg.computers.bundle.manifest import Keys, Manifest
from atlantis_netcfg.computers.bundle.requirements import (
    HostRequirements,
    Library,
    PackageRequirement,
    PackageSource,
    RequirementKey,
    read_target,
)
from atlantis_netcfg.emulator.lab.stubs import StubArchive, StubPackage, publish

HOST = "coastal-gateway"
KEYRING = "/usr/share/keyrings/stand-ins.gpg"
_BASE = {"dpkg": ("1.19.7", "arm64"), "base-files": ("11ubuntu5.8", "arm64"), "libc6": ("2.31", "arm64")}


def status(**more: str) -> bytes:
    """Of a board with Ubuntu 20.04 on arm64, and what else is on it."""
    rows = {**_BASE, **{name.replace("_", "-"): (version, "arm64") for name, version in more.items()}}
    return "\n".join(
        f"Package: {name}\nStatus: install ok installed\nArchitecture: {architecture}\nVersion: {version}\n"
        for name, (version, architecture) in rows.items()
    ).encode()


def arm64(name: str, version: str = "1", *depends: str, padding_kb: int = 1) -> StubPackage:
    return StubPackage(name, version, depends, padding_kb=padding_kb, architecture="arm64")


@dataclass
class Laptop:
    """Where bundles are made."""

    folder: Path
    sizes: list[BundleSize] = field(default_factory=list)

    @property
    def keys(self) -> Keys:
        return Keys.of(self.folder / "state")

    def archive(self, packages: Sequence[StubPackage], name: str = "archive") -> StubArchive:
        return publish(self.folder / name, packages, codename="focal")

    def wish(
        self, archive: StubArchive, *wanted: str, host: str = HOST, libraries: Sequence[Library] = ()
    ) -> HostRequirements:
        """What a host wants; `name=version` as apt writes it."""
        names = [one.partition("=") for one in wanted]
        return HostRequirements(
            host,
            tuple(PackageRequirement(name, version or None) for name, _, version in names),
            (PackageSource("/etc/apt/s.list", f"deb [signed-by={KEYRING}] file:{archive.folder} focal main\n"),),
            (RequirementKey(KEYRING, archive.key),),
            libraries=tuple(libraries),
        )

    def make(self, *wishes: HostRequirements, on: bytes | None = None, image: Path | None = None) -> Manifest:
        target = read_target(status() if on is None else on, "status")
        purposes = tuple(BundlePurpose(wish, target, None) for wish in wishes)
        order = BundleOrder("coastal", "0" * 64, purposes, self.place, image)
        return make(order, self.keys.signer(), lambda _words, _share: None, self.sizes.append)

    @property
    def place(self) -> Path:
        return self.folder / "bundle"
