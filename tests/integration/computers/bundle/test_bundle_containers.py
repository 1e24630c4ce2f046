"""Images of containers in a bundle: the archive of the inventory, by its declared SHA-256, and nothing else."""

import hashlib
from dataclasses import replace
from pathlib import Path

import pytest
from bundle_stand import HOST, Laptop, arm64

from atlantis_netcfg.computers.bundle.open import open_bundle
from atlantis_netcfg.computers.bundle.requirements import BundleError, ContainerArchive, HostRequirements
from atlantis_netcfg.inventory import load
from atlantis_netcfg.inventory.model import HostedService, Ros1Bridge, ServerComputer
from atlantis_netcfg.operations.bundle import host_requirements
from atlantis_netcfg.operations.common.request import Request


@pytest.fixture
def laptop(tmp_path: Path) -> Laptop:
    return Laptop(tmp_path)


@pytest.fixture
def plain(laptop: Laptop) -> HostRequirements:
    """What the host wants besides."""
    return laptop.wish(laptop.archive((arm64("chrony", "3.5"),)), "chrony")


def with_archive(plain: HostRequirements, folder: Path, data: bytes, sha256: str | None = None) -> HostRequirements:
    """The same, and an archive whose file holds `data`."""
    (folder / "backend.tar").write_bytes(data)
    declared = ContainerArchive(folder / "backend.tar", sha256 or hashlib.sha256(data).hexdigest())
    return replace(plain, archives=(declared,))


def test_container_archive_is_stored_under_its_hash(laptop: Laptop, plain: HostRequirements) -> None:
    wish = with_archive(plain, laptop.folder, b"image")
    manifest = laptop.make(wish)
    path = f"images/{wish.archives[0].sha256}.tar"
    assert manifest.hosts[HOST].held[path] == path
    assert manifest.of(HOST)[path].sha256 == wish.archives[0].sha256
    assert (laptop.place / path).read_bytes() == b"image"
    assert open_bundle(laptop.place, laptop.keys, [wish]).manifest == manifest


def test_wrong_or_missing_container_archive_is_refused(laptop: Laptop, plain: HostRequirements) -> None:
    with pytest.raises(BundleError, match=r"has the SHA-256 .*, and b{64} is declared"):
        laptop.make(with_archive(plain, laptop.folder, b"image", "b" * 64))
    wish = with_archive(plain, laptop.folder, b"image")
    wish.archives[0].path.unlink()
    with pytest.raises(BundleError, match=r"there is no .*backend\.tar"):
        laptop.make(wish)
    assert not laptop.place.exists()


def test_bundle_with_an_older_container_image_is_refused(laptop: Laptop, plain: HostRequirements) -> None:
    laptop.make(with_archive(plain, laptop.folder, b"image"))
    newer = with_archive(plain, laptop.folder, b"newer image")
    with pytest.raises(BundleError, match=r"backend\.tar with the SHA-256 .*: it is not in the bundle"):
        open_bundle(laptop.place, laptop.keys, [newer])


def test_declared_containers_are_requested(request: pytest.FixtureRequest) -> None:
    shipped = load(request.config.rootpath / "inventory")
    host = shipped.hosts["scc-control"]
    assert isinstance(host.device, ServerComputer)
    image = {"archive": "backend.tar", "sha256": "A" * 64}
    service = HostedService.model_validate({"name": "backend", "container": {**image, "budget_mb": 5}})
    bridge = Ros1Bridge.model_validate({**image, "archive": "bridge.tar", "master_uri": "http://192.0.2.1:11311"})
    device = host.device.model_copy(update={"services": (service,), "ros1_bridge": bridge})
    wish = host_requirements(shipped, replace(host, device=device), Request())
    assert wish.archives == tuple(
        ContainerArchive(shipped.root / "images" / name, "a" * 64) for name in ("backend.tar", "bridge.tar")
    )
    assert {"podman", "crun"} <= {package.name for package in wish.packages}
