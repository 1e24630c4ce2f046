"""Bundles made by the real apt, for a board of another architecture, from a signed archive of stand-ins."""

import lzma
import os
import shutil
import subprocess
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import pytest
from bundle_stand import HOST, KEYRING, Laptop, arm64, status

from atlantis_netcfg.computers.bundle.manifest import find_signer
from atlantis_netcfg.computers.bundle.open import bytes_to_carry, open_bundle
from atlantis_netcfg.computers.bundle.requirements import BundleError, RequirementKey
from atlantis_netcfg.emulator.lab.stubs import publish

pytestmark = pytest.mark.slow

PACKAGES = (
    arm64("ros-foxy-ros-base", "0.9.2-1focal", "ros-foxy-core (>= 0.9)", "libc6 (>= 2.31)"),
    arm64("ros-foxy-core", "1:0.9.2-1focal", padding_kb=200),
    arm64("chrony", "3.5"),
    arm64("unasked", "1"),
)


@pytest.fixture
def laptop(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Laptop:
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "1")  # the same package is the same file each time that it is made
    return Laptop(tmp_path)


def refusal(laptop: Laptop, *wishes: object, **how: object) -> list[str]:
    with pytest.raises(BundleError) as caught:
        laptop.make(*wishes, **how)  # type: ignore[arg-type]
    return [str(each) for each in caught.value.errors or (caught.value,)]


@pytest.mark.smoke
def test_a_bundle_for_another_architecture_holds_what_the_board_lacks(laptop: Laptop) -> None:
    wish = laptop.wish(laptop.archive(PACKAGES), "ros-foxy-ros-base=0.9.2-1*", "chrony")
    manifest = laptop.make(wish, on=status(chrony="3.5"))
    part = manifest.hosts[HOST]
    assert (part.architecture, part.distribution, part.codename) == ("arm64", "ubuntu", "focal")
    assert part.packages == {"ros-foxy-core": "1:0.9.2-1focal", "ros-foxy-ros-base": "0.9.2-1focal"}
    assert part.installed == {"chrony": "3.5"}
    assert sorted(part.held) == [
        "repository/InRelease",
        "repository/Packages.xz",
        "repository/atlantis.gpg",
        "repository/pool/ros-foxy-core_1-0.9.2-1focal_arm64.deb",
        "repository/pool/ros-foxy-ros-base_0.9.2-1focal_arm64.deb",
    ]
    assert open_bundle(laptop.place, laptop.keys, [wish]).manifest == manifest
    names = {path.relative_to(laptop.place).as_posix() for path in laptop.place.rglob("*") if path.is_file()}
    assert names == {*(file.path for file in manifest.files), "manifest.json", "manifest.json.asc"}
    assert [path.name for path in laptop.folder.iterdir() if path.name.startswith(".bundle")] == []


@pytest.mark.smoke
def test_its_repository_is_signed_by_the_key_of_the_manifest(laptop: Laptop) -> None:
    manifest = laptop.make(laptop.wish(laptop.archive(PACKAGES), "chrony"))
    repository = laptop.place / "hosts" / HOST / "repository"
    public = (laptop.place / "key.gpg").read_bytes()
    (laptop.folder / "key.gpg").write_bytes(public)
    checked = subprocess.run(
        ["gpgv", "--keyring", str(laptop.folder / "key.gpg"), "--status-fd", "1", str(repository / "InRelease")],
        capture_output=True,
        text=True,
        check=True,
    )
    assert f"VALIDSIG {manifest.key} 2000-01-02" in checked.stdout
    home = laptop.folder / "home"
    home.mkdir(mode=0o700)
    gpg = ["gpg", "--homedir", str(home), "--batch", "--no-autostart", "--faked-system-time", "20120101T000000"]
    subprocess.run([*gpg, "--import", str(laptop.folder / "key.gpg")], check=True, capture_output=True)
    past = subprocess.run(
        [*gpg, "--verify", str(repository / "InRelease")], check=False, capture_output=True, text=True
    )
    assert (past.returncode, "Good signature" in past.stderr) == (0, True), past.stderr
    listed = lzma.decompress((repository / "Packages.xz").read_bytes()).decode()
    assert "Filename: ./pool/chrony_3.5_arm64.deb\n" in listed
    assert "trusted" not in (repository / "InRelease").read_text()
    signature = (laptop.place / "manifest.json.asc").read_bytes()
    assert find_signer((laptop.place / "manifest.json").read_bytes(), signature, public) == manifest.key


def test_signature_does_not_depend_on_signing_speed(laptop: Laptop, monkeypatch: pytest.MonkeyPatch) -> None:
    signer = laptop.keys.signer()
    quick = signer.sign_inline("text\n")
    slow = laptop.folder / "slow"
    slow.mkdir()
    gpg = slow / "gpg"
    gpg.write_text(f'#!/bin/sh\n(sleep 1.1; cat) | {shutil.which("gpg")} "$@"\n')
    gpg.chmod(0o755)
    monkeypatch.setenv("PATH", f"{slow}:{os.environ['PATH']}")
    assert signer.sign_inline("text\n") == quick


def test_size_is_reported_and_existing_files_are_not_fetched_again(laptop: Laptop) -> None:
    wish = laptop.wish(laptop.archive(PACKAGES), "ros-foxy-ros-base", "chrony")
    first = laptop.make(wish)
    second = laptop.make(wish)
    (told, again) = laptop.sizes
    assert (told.packages, told.to_fetch == told.whole, told.whole > 200_000) == (3, True, True)
    assert (again.whole, again.to_fetch) == (told.whole, 0)
    assert (second.id, second.files) == (first.id, first.files)


def test_interrupted_bundle_continues_and_refetches_damaged_files(
    laptop: Laptop, monkeypatch: pytest.MonkeyPatch
) -> None:
    wish = laptop.wish(laptop.archive(PACKAGES), "ros-foxy-ros-base", "chrony")
    monkeypatch.setattr("atlantis_netcfg.computers.bundle.build._write_manifest", _killed)
    with pytest.raises(KeyboardInterrupt):
        laptop.make(wish)
    monkeypatch.undo()
    assert not laptop.place.exists()
    pool = laptop.folder / ".bundle.part" / "pool"
    assert len(list(pool.iterdir())) == 3
    damaged = pool / "chrony_3.5_arm64.deb"
    size = damaged.stat().st_size
    damaged.write_bytes(b"x" * size)
    manifest = laptop.make(wish)
    assert laptop.sizes[1].to_fetch == size
    assert open_bundle(laptop.place, laptop.keys, [wish]).manifest == manifest


def test_interrupted_replacement_of_a_bundle_loses_nothing(laptop: Laptop) -> None:
    wish = laptop.wish(laptop.archive(PACKAGES), "chrony")
    laptop.make(wish)
    laptop.place.rename(laptop.folder / ".bundle.old")
    laptop.make(wish)
    assert laptop.sizes[1].to_fetch == 0
    assert not (laptop.folder / ".bundle.old").exists()


def test_bundle_works_on_a_stick_without_hard_links(laptop: Laptop, monkeypatch: pytest.MonkeyPatch) -> None:
    wish = laptop.wish(laptop.archive(PACKAGES), "chrony")
    laptop.make(wish)
    monkeypatch.setattr("os.link", _refused)
    laptop.make(wish)
    assert laptop.sizes[1].to_fetch == 0
    assert open_bundle(laptop.place, laptop.keys, [wish]).folder == laptop.place


def _refused(*_arguments: object) -> None:
    raise PermissionError(1, "Operation not permitted")


def _killed(*_arguments: object) -> None:
    raise KeyboardInterrupt


def test_all_unavailable_packages_are_listed(laptop: Laptop) -> None:
    wish = laptop.wish(laptop.archive(PACKAGES), "ros-foxy-nav", "gpsd", "chrony=4*")
    assert refusal(laptop, wish) == [
        "the packages cannot be resolved: Version '4*' for 'chrony' was not found",
        "the packages cannot be resolved: Unable to locate package gpsd",
        "the packages cannot be resolved: Unable to locate package ros-foxy-nav",
    ]
    assert not laptop.place.exists()


def test_unavailable_dependency_is_reported(laptop: Laptop) -> None:
    archive = laptop.archive((arm64("needy", "1", "nowhere (>= 2)"),))
    assert refusal(laptop, laptop.wish(archive, "needy")) == [
        "the packages cannot be resolved: needy : Depends: nowhere (>= 2) but it is not installable"
    ]


def test_two_hosts_share_packages_and_each_sees_its_own(laptop: Laptop) -> None:
    archive = laptop.archive(PACKAGES)
    manifest = laptop.make(
        laptop.wish(archive, "chrony"), laptop.wish(archive, "chrony", "ros-foxy-core", host="second")
    )
    assert [set(part.packages) for part in manifest.hosts.values()] == [{"chrony"}, {"chrony", "ros-foxy-core"}]
    assert len([file for file in manifest.files if file.path.startswith("pool/")]) == 2
    bundle = open_bundle(laptop.place, laptop.keys)
    assert bytes_to_carry(bundle, HOST) < bytes_to_carry(bundle, "second")


@pytest.mark.smoke("None-None-NO_PUBKEY")
@pytest.mark.parametrize(
    ("signed", "expires", "words"),
    [(datetime(2020, 1, 1, tzinfo=UTC), datetime(2021, 1, 1, tzinfo=UTC), "EXPKEYSIG"), (None, None, "NO_PUBKEY")],
)
def test_source_with_an_invalid_key_is_refused(
    laptop: Laptop, signed: datetime | None, expires: datetime | None, words: str
) -> None:
    archive = publish(laptop.folder / "archive", PACKAGES, codename="focal", signed_at=signed, expires=expires)
    wish = laptop.wish(archive, "chrony")
    if words == "NO_PUBKEY":
        other = publish(laptop.folder / "other", (), codename="focal")
        wish = replace(wish, keys=(RequirementKey(KEYRING, other.key),))
    found = refusal(laptop, wish)
    assert any(words in line for line in found), found


def test_another_release_than_the_declared_one_is_refused(laptop: Laptop) -> None:
    wish = replace(laptop.wish(laptop.archive(PACKAGES), "chrony"), distribution="ubuntu", codename="jammy")
    assert refusal(laptop, wish) == [
        f"{HOST}: what is declared needs ubuntu jammy, and its system is ubuntu focal arm64"
    ]


def test_nothing_but_an_earlier_bundle_is_overwritten(laptop: Laptop) -> None:
    wish = laptop.wish(laptop.archive(PACKAGES), "chrony")
    laptop.place.mkdir()
    (laptop.place / "thesis.odt").write_text("years")
    assert refusal(laptop, wish) == [f"{laptop.place} is there, and is no bundle"]
    assert (laptop.place / "thesis.odt").read_text() == "years"


def test_the_vendors_image_is_packed_too(laptop: Laptop) -> None:
    image = laptop.folder / "vendor.img.xz"
    image.write_bytes(b"image")
    manifest = laptop.make(laptop.wish(laptop.archive(PACKAGES), "chrony"), image=image)
    assert manifest.image is not None
    assert (laptop.place / str(manifest.image.path)).read_bytes() == b"image"
    assert "image" not in str(manifest.hosts[HOST].held)
