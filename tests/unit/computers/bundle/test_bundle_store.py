"""The board's end of carrying: what arrived whole counts, what is damaged does not, and older bundles give theirs."""

import hashlib
import io
import os
import shutil
import tarfile
from pathlib import Path

import pytest

from atlantis_netcfg.ansible_collections.atlantis.netcfg.plugins.module_utils.errors import ModuleError
from atlantis_netcfg.ansible_collections.atlantis.netcfg.plugins.modules.bundle import BundleStore, StoredFile

ONE, TWO = "1" * 16, "2" * 16
CONTENT = {f"repository/pool/{name}.deb": name.encode() * 5000 for name in ("a", "b", "c")}


def held(content: dict[str, bytes]) -> tuple[StoredFile, ...]:
    return tuple(StoredFile(path, len(data), hashlib.sha256(data).hexdigest()) for path, data in content.items())


def archive(content: dict[str, bytes]) -> bytes:
    out = io.BytesIO()
    with tarfile.open(fileobj=out, mode="w", format=tarfile.USTAR_FORMAT) as tar:
        for data in content.values():
            member = tarfile.TarInfo(hashlib.sha256(data).hexdigest())
            member.size = len(data)
            tar.addfile(member, io.BytesIO(data))
    return out.getvalue()


@pytest.fixture
def store(tmp_path: Path) -> BundleStore:
    return BundleStore(str(tmp_path / "lib" / "bundle"))


def bring(store: BundleStore, name: str, data: bytes, content: dict[str, bytes]) -> tuple[bool, int]:
    """Upload something, and let the board look; whether the bundle is whole, and how many files are missing."""
    store.settle(name, held(content), check=False)
    with open(store.upload(name), "wb") as file:  # noqa: PTH123 - the store speaks of paths as text
        file.write(data)
    settled = store.settle(name, held(content), check=False)
    return settled.ready, len(settled.missing)


def test_bundle_is_assembled_once(store: BundleStore, tmp_path: Path) -> None:
    assert store.settle(ONE, None, check=False).is_known is False
    assert len(store.settle(ONE, held(CONTENT), check=False).missing) == 3
    assert bring(store, ONE, archive(CONTENT), CONTENT) == (True, 0)
    for path, data in CONTENT.items():
        assert (tmp_path / "lib" / "bundle" / ONE / path).read_bytes() == data
    again = store.settle(ONE, None, check=False)
    assert (again.ready, again.is_known, again.changes) == (True, True, ())


@pytest.mark.parametrize("cut", [0, 100, 512, 6000, 12000, -1])
def test_complete_files_of_an_interrupted_upload_count(store: BundleStore, cut: int) -> None:
    whole = archive(CONTENT)
    arrived = whole[: cut if cut >= 0 else len(whole) - 3000]
    ready, missing = bring(store, ONE, arrived, CONTENT)
    files = min(len(arrived) // (512 + 5120), 3)
    assert (ready, missing) == (files == 3, 3 - files)
    rest = {path: data for path, data in CONTENT.items() if held({path: data})[0].sha256 in _missing(store)}
    assert bring(store, ONE, archive(rest), CONTENT) == (True, 0)


def _missing(store: BundleStore) -> tuple[str, ...]:
    return store.settle(ONE, held(CONTENT), check=False).missing


def test_damaged_or_unrequested_files_are_discarded(store: BundleStore, tmp_path: Path) -> None:
    data = bytearray(archive({**CONTENT, "x": b"unasked"}))
    data[600] ^= 1
    assert bring(store, ONE, bytes(data), CONTENT) == (False, 1)
    assert len(os.listdir(tmp_path / "lib" / "bundle" / ".store")) == 2  # noqa: PTH208


def test_later_bundle_reuses_files_and_replaces_the_older(store: BundleStore, tmp_path: Path) -> None:
    bring(store, ONE, archive(CONTENT), CONTENT)
    later = {**CONTENT, "repository/pool/a.deb": b"newer"}
    assert len(store.settle(TWO, held(later), check=True).missing) == 1
    assert bring(store, TWO, archive({"a": b"newer"}), later) == (True, 0)
    names = {path.name for path in (tmp_path / "lib" / "bundle").iterdir()}
    assert names == {TWO, ".store", ".incoming"}
    assert len(list((tmp_path / "lib" / "bundle" / ".store").iterdir())) == 3


def test_what_is_damaged_later_is_missing_again(store: BundleStore, tmp_path: Path) -> None:
    bring(store, ONE, archive(CONTENT), CONTENT)
    (tmp_path / "lib" / "bundle" / ONE / "repository/pool/b.deb").write_bytes(b"short")
    assert store.settle(ONE, None, check=True).ready is False
    assert store.settle(ONE, None, check=False).missing == (held({"b": b"b" * 5000})[0].sha256,)
    assert bring(store, ONE, archive({"b": b"b" * 5000}), CONTENT) == (True, 0)


def test_interrupted_assembly_is_completed(store: BundleStore, tmp_path: Path) -> None:
    bring(store, ONE, archive(CONTENT), CONTENT)
    place = tmp_path / "lib" / "bundle"
    (place / ONE).rename(place / f".{ONE}.new")
    (place / ".store" / ".new").write_bytes(b"half")
    assert store.settle(ONE, held(CONTENT), check=False).ready
    assert {path.name for path in place.iterdir()} == {ONE, ".store", ".incoming"}
    assert len(list((place / ".store").iterdir())) == 3


def test_check_mode_changes_nothing(store: BundleStore, tmp_path: Path) -> None:
    assert len(store.settle(ONE, held(CONTENT), check=True).missing) == 3
    assert list(tmp_path.iterdir()) == []


def test_sources_are_readable_by_their_owner_only(store: BundleStore, tmp_path: Path) -> None:
    content = {**CONTENT, "sources/git/git.example.org/x.git/HEAD": b"ref"}
    bring(store, ONE, archive(content), content)
    place = tmp_path / "lib" / "bundle" / ONE
    assert [(place / name).stat().st_mode & 0o777 for name in ("sources", "repository")] == [0o700, 0o755]


def test_full_disk_is_reported_before_sending(store: BundleStore, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(shutil, "disk_usage", lambda _path: shutil._ntuple_diskusage(10**9, 10**9 - 10**6, 10**6))
    with pytest.raises(ModuleError) as caught:
        store.settle(ONE, held(CONTENT), check=False)
    assert str(caught.value) == "the bundle needs 16 MB on the computer, but 1 MB are free"
