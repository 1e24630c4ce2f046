"""A small bundle whose packages are nothing but bytes, for tests of opening and carrying."""

import hashlib
from pathlib import Path

import pytest

from atlantis_netcfg.computers.bundle.manifest import (
    BundledLibrary,
    BundleFile,
    BundleSigner,
    HostPart,
    Keys,
    Manifest,
    content_id,
)
from atlantis_netcfg.computers.bundle.requirements import HostRequirements, Library, PackageRequirement

HOST = "coastal-gateway"
LIBRARY = Library("https://git.example.org/c4i/library.git", "v1.0")
WISH = HostRequirements(
    HOST,
    (
        PackageRequirement("chrony", None),
        PackageRequirement("ros-foxy-ros-base", "0.9.2-1*"),
        PackageRequirement("locales", None),
    ),
    libraries=(LIBRARY,),
    distribution="ubuntu",
    codename="focal",
)
CONTENT = {
    "pool/chrony_3.5_arm64.deb": b"chrony" * 300,
    "pool/ros-foxy-ros-base_0.9.2-1focal_arm64.deb": b"ros" * 900,
    f"hosts/{HOST}/repository/InRelease": b"index",
    "sources/git/git.example.org/c4i/library.git/HEAD": b"ref: refs/heads/atlantis\n",
}


@pytest.fixture(scope="session")
def keys(tmp_path_factory: pytest.TempPathFactory) -> Keys:
    return Keys.of(tmp_path_factory.mktemp("state-of-bundles"))


@pytest.fixture(scope="session")
def signer(keys: Keys) -> BundleSigner:
    return keys.signer()


@pytest.fixture
def folder(tmp_path: Path, signer: BundleSigner) -> Path:
    made = tmp_path / "bundle"
    for path, data in {**CONTENT, "key.gpg": signer.public}.items():
        (made / path).parent.mkdir(parents=True, exist_ok=True)
        (made / path).write_bytes(data)
    sign(made, manifest(signer), signer)
    return made


def manifest(signer: BundleSigner) -> Manifest:
    contents = {**CONTENT, "key.gpg": signer.public}
    files = tuple(
        BundleFile(path=path, size=len(data), sha256=hashlib.sha256(data).hexdigest())
        for path, data in sorted(contents.items())
    )
    held = {path.removeprefix(f"hosts/{HOST}/") if "hosts" in path else f"repository/{path}": path for path in CONTENT}
    part = HostPart(
        architecture="arm64",
        distribution="ubuntu",
        codename="focal",
        wished={each.name: each.version for each in WISH.packages},
        installed={"locales": "2.31"},
        packages={"chrony": "3.5", "ros-foxy-ros-base": "0.9.2-1focal"},
        libraries=(BundledLibrary(url=LIBRARY.url, revision=LIBRARY.revision, commit="0" * 40),),
        held=held,
    )
    return Manifest(
        id=content_id(files, {HOST: part}),
        site="coastal",
        made="2026-11-22T03:00:00+00:00",
        tool="0",
        revision="0" * 64,
        key=signer.fingerprint,
        files=files,
        hosts={HOST: part},
    )


def sign(folder: Path, told: Manifest, signer: BundleSigner) -> None:
    (folder / "manifest.json").write_bytes(told.encode())
    (folder / "manifest.json.asc").write_bytes(signer.sign_detached(told.encode()))
