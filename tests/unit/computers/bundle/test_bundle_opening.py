"""A bundle is taken if it is signed by a known key, whole, and holds what is declared; all that is wrong is named."""

import json
import tarfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
from bundle_made import HOST, LIBRARY, WISH, folder, keys, manifest, sign, signer

from atlantis_netcfg.computers.bundle.manifest import BundleSigner, Keys
from atlantis_netcfg.computers.bundle.open import bytes_to_carry, open_bundle
from atlantis_netcfg.computers.bundle.requirements import BundleError, HostRequirements, PackageRequirement
from atlantis_netcfg.core.errors import ExitCode

__all__ = ["folder", "keys", "signer"]
CHRONY = "pool/chrony_3.5_arm64.deb"
AGAIN = "copy the bundle again, or make it anew: `provision gateway bundle site=coastal`"


def refusal(
    folder: Path, keys: Keys, wish: HostRequirements = WISH, accept: str | None = None
) -> list[tuple[str, str | None]]:
    with pytest.raises(BundleError) as caught:
        open_bundle(folder, keys, [wish], accept=accept)
    assert caught.value.exit is ExitCode.USAGE
    return [(str(each), each.hint) for each in caught.value.errors or (caught.value,)]


def test_valid_bundle_is_opened(folder: Path, keys: Keys) -> None:
    opened = open_bundle(folder, keys, [WISH])
    assert opened.manifest.site == "coastal"
    assert opened.manifest.of(HOST)["repository/InRelease"].path == f"hosts/{HOST}/repository/InRelease"


@pytest.mark.parametrize(
    ("tamper", "words"),
    [
        (lambda path: path.unlink(), f"{CHRONY}: it cannot be read: No such file or directory"),
        (lambda path: path.write_bytes(b"x"), f"{CHRONY}: it has 1 bytes, and 1800 were put there"),
        (lambda path: path.write_bytes(b"x" * 1800), f"{CHRONY}: its content is not what was put there"),
    ],
)
def test_damaged_file_is_named(folder: Path, keys: Keys, tamper: Callable[[Path], object], words: str) -> None:
    tamper(folder / CHRONY)
    assert refusal(folder, keys) == [(words, AGAIN)]


def test_all_damage_is_reported_together(folder: Path, keys: Keys) -> None:
    for path in (CHRONY, f"hosts/{HOST}/repository/InRelease"):
        (folder / path).write_bytes(b"")
    assert len(refusal(folder, keys)) == 2


@pytest.mark.parametrize("name", ["manifest.json", "manifest.json.asc", "key.gpg"])
def test_a_manifest_that_was_changed_is_refused(folder: Path, keys: Keys, name: str) -> None:
    data = bytearray((folder / name).read_bytes())
    data[len(data) // 2] ^= 1
    (folder / name).write_bytes(data)
    ((words, _),) = refusal(folder, keys)
    assert words == f"the manifest of {folder} is not what was signed: it was damaged, or changed by somebody"


@pytest.mark.parametrize("name", ["manifest.json", "manifest.json.asc", "key.gpg"])
def test_folder_without_a_bundle_is_refused(folder: Path, keys: Keys, name: str) -> None:
    (folder / name).unlink()
    ((words, _),) = refusal(folder, keys)
    assert words == f"{folder} is no bundle, or not a whole one: {folder / name}: No such file or directory"


def test_foreign_key_is_accepted_once_typed(folder: Path, signer: BundleSigner, tmp_path: Path) -> None:
    other = Keys.of(tmp_path / "other")
    own = f"{folder} was signed on another computer, by key {signer.fingerprint}"
    assert [words for words, _ in refusal(folder, other)] == [own]
    assert [words for words, _ in refusal(folder, other, accept="0" * 40)] == [
        f"{folder} was signed by key {signer.fingerprint}, and not by {'0' * 40}"
    ]
    assert [words for words, _ in refusal(folder, other)] == [own]
    spaced = " ".join(signer.fingerprint[at : at + 4] for at in range(0, 40, 4)).lower()
    assert open_bundle(folder, other, [WISH], accept=spaced).folder == folder
    assert open_bundle(folder, other, [WISH]).folder == folder


def test_everything_missing_is_named(folder: Path, keys: Keys) -> None:
    wish = replace(
        WISH,
        packages=(
            *WISH.packages,
            PackageRequirement("gpsd", None),
            PackageRequirement("chrony", "4.*"),
            PackageRequirement("locales", "2.35"),
        ),
        libraries=(LIBRARY, replace(LIBRARY, revision="v2.0"), replace(LIBRARY, url="https://git.example.org/x.git")),
        distribution="ubuntu",
        codename="jammy",
    )
    hint = "on a computer with internet: `provision gateway bundle site=coastal`"
    assert refusal(folder, keys, wish) == [
        (f"{HOST}: it is for ubuntu focal, and ubuntu jammy is declared", hint),
        (f"{HOST}: package gpsd: it is not in the bundle", hint),
        (f"{HOST}: package chrony=4.*: the bundle has 3.5", hint),
        (f"{HOST}: package locales=2.35: the bundle has 2.31", hint),
        (f"{HOST}: {LIBRARY.url} at v2.0: the bundle has v1.0", hint),
        (f"{HOST}: https://git.example.org/x.git at v1.0: it is not in the bundle", hint),
    ]


def test_host_without_a_bundle_is_named(folder: Path, keys: Keys) -> None:
    ((words, _),) = refusal(folder, keys, replace(WISH, host="te4sea-gateway"))
    assert words == f"te4sea-gateway: the bundle was made for {HOST}"


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"format": 2}, "is of format 2, and this toolkit knows format 1"),
        ({"site": None}, "cannot be understood"),
        ({"more": 1}, "cannot be understood"),
        ({"files": []}, "cannot be understood"),
        ({"files": [{"path": "../x", "size": 1, "sha256": "0" * 64}]}, "cannot be understood"),
        ({"key": "0" * 40}, "names another key than its own"),
    ],
)
def test_signed_manifest_is_still_validated(
    folder: Path, keys: Keys, signer: BundleSigner, change: dict[str, object], words: str
) -> None:
    data = json.dumps(manifest(signer).model_dump(mode="json") | change).encode()
    (folder / "manifest.json").write_bytes(data)
    (folder / "manifest.json.asc").write_bytes(signer.sign_detached(data))
    assert words in refusal(folder, keys)[0][0]


def test_bytes_to_carry_are_computed_beforehand(folder: Path, keys: Keys, tmp_path: Path) -> None:
    opened = open_bundle(folder, keys)
    every = {file.sha256 for file in opened.manifest.of(HOST).values()}
    for wanted in (every, set(sorted(every)[:1])):
        packed = opened.pack(HOST, wanted, tmp_path / "archive.tar")
        assert packed == bytes_to_carry(opened, HOST, every - wanted)
        with tarfile.open(tmp_path / "archive.tar") as archive:
            assert set(archive.getnames()) == wanted
    assert bytes_to_carry(opened, HOST, every) == 0


def test_id_depends_on_content_only(folder: Path, keys: Keys, signer: BundleSigner) -> None:
    later = manifest(signer).model_copy(update={"made": "2027-01-01T00:00:00+00:00", "tool": "9"})
    sign(folder, later, signer)
    assert open_bundle(folder, keys).manifest.id == manifest(signer).id
