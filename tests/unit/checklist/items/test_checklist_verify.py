"""Whatever of a signed checklist is changed afterwards, it is found, and the file is named."""

import json
import os
import shutil
from collections.abc import Callable
from hashlib import sha256
from pathlib import Path
from typing import Any

import pytest
from checklist_bench import DHCP, FAILSAFE, NAME, WIFI, Desk, answer, found, pages

from atlantis_netcfg.checklist import Confirmation, SigningKeyError, books, verify, verify_report
from atlantis_netcfg.checklist._signing import SigningKey, canonical, digest, parse_json, render_json, sign_data
from atlantis_netcfg.checklist.report import Document
from atlantis_netcfg.core.events import Verdict
from atlantis_netcfg.runs import write_atomically


@pytest.fixture
def desk(tmp_path: Path) -> Desk:
    return Desk(tmp_path / "state")


@pytest.fixture
def signed(desk: Desk, tmp_path: Path) -> Path:
    """A small signed checklist with everything in it: evidence, a result that was replaced, an override."""
    photo = tmp_path / "photo.jpg"
    photo.write_bytes(bytes(range(64)))
    with desk.open([WIFI, FAILSAFE]) as book:
        book.settle(found(WIFI, Verdict.FAIL))
        book.confirm(FAILSAFE, Confirmation(Verdict.PASS, "Ä. Technician", files=(photo,)))
        book.settle(found(WIFI, Verdict.INCONCLUSIVE))
        book.override(WIFI, "known", NAME)
        book.sign(NAME, pages)
        return book.folder


def _files(folder: Path) -> list[Path]:
    return sorted(path for path in folder.rglob("*") if path.is_file())


def test_untouched_checklist_verifies(signed: Path) -> None:
    assert verify(signed) == ()
    assert len(_files(signed)) == 6


def _flips(signed: Path, step: int) -> None:
    for number, path in enumerate(_files(signed)):
        name = path.relative_to(signed).as_posix()
        whole = path.read_bytes()
        for place in range(number % step, len(whole), step):
            for bit in (0x01, 0x20):
                path.write_bytes(whole[:place] + bytes([whole[place] ^ bit]) + whole[place + 1 :])
                troubles = verify(signed)
                assert name in {one.file for one in troubles}, f"{name}: byte {place}"
                assert all(one.what and one.hint for one in troubles)
        path.write_bytes(whole)
    assert verify(signed) == ()


def test_sampled_flipped_bytes_are_detected(signed: Path) -> None:
    _flips(signed, 53)  # the campaign flips every one


@pytest.mark.campaign
def test_every_flipped_byte_is_detected(signed: Path) -> None:
    _flips(signed, 1)


@pytest.mark.parametrize("change", [b"", b"\n", b" "], ids=["cut", "line", "blank"])
def test_longer_or_shorter_file_is_detected(signed: Path, change: bytes) -> None:
    for path in _files(signed):
        whole = path.read_bytes()
        path.write_bytes(whole + change if change else whole[:-1])
        assert path.relative_to(signed).as_posix() in {one.file for one in verify(signed)}
        path.write_bytes(whole)


def test_missing_file_is_detected(signed: Path) -> None:
    for path in _files(signed):
        whole = path.read_bytes()
        path.unlink()
        assert any(one.file == path.relative_to(signed).as_posix() for one in verify(signed)), path
        path.write_bytes(whole)


@pytest.mark.parametrize("name", ["files/photo.jpg", "more.html", ".hidden", "other/x", "empty/"])
def test_added_file_is_detected(signed: Path, name: str) -> None:
    path = signed / name.rstrip("/")
    if name.endswith("/"):
        path.mkdir()
    else:
        path.parent.mkdir(exist_ok=True)
        path.touch()
    (trouble,) = verify(signed)
    assert (trouble.file, trouble.what) == (name.rstrip("/"), "was added after the checklist was signed")


def test_symlink_in_place_of_a_file_is_detected(signed: Path, tmp_path: Path) -> None:
    shutil.copy(signed / "report.html", tmp_path / "report.html")
    (signed / "report.html").unlink()
    (signed / "report.html").symlink_to(tmp_path / "report.html")
    assert [one.file for one in verify(signed)] == ["report.html"]


def test_pipe_or_folder_in_place_of_a_file_is_detected(signed: Path) -> None:
    for path in _files(signed):
        whole, name = path.read_bytes(), path.relative_to(signed).as_posix()
        for make, unmake in ((os.mkfifo, Path.unlink), (Path.mkdir, Path.rmdir)):
            path.unlink()
            make(path)
            assert name in {one.file for one in verify(signed)}
            books(signed.parent)
            unmake(path)
            path.write_bytes(whole)


def test_symlink_in_place_of_a_folder_is_detected(signed: Path, tmp_path: Path) -> None:
    (signed / "files").rename(tmp_path / "files")
    (signed / "files").symlink_to(tmp_path / "files")
    assert "files" in {one.file for one in verify(signed)}


def _edit(path: Path, change: Callable[[dict[str, Any]], None]) -> None:
    data = parse_json(path.read_bytes())
    change(data)
    path.write_bytes(render_json(data))


def _whats(signed: Path, name: str) -> list[str]:
    return [one.what for one in verify(signed) if one.file == name]


def test_changed_verdict_is_detected(signed: Path) -> None:
    def polish(report: dict[str, Any]) -> None:
        report["items"][0]["verdict"] = "PASS"

    _edit(signed / "report.json", polish)
    assert _whats(signed, "report.json") == [
        "was changed after the checklist was signed",
        "was changed after it was signed",
        "has other results than the records of the checklist",
    ]


@pytest.mark.parametrize(
    ("field", "value"), [("by", "Somebody Else"), ("at", "2026-11-23T10:00:00Z"), ("key", "SHA256:x")]
)
def test_signature_with_another_name_time_or_key_is_detected(signed: Path, field: str, value: str) -> None:
    def change(report: dict[str, Any]) -> None:
        report["signed"][field] = value

    _edit(signed / "report.json", change)
    assert "the signature does not match the content" in _whats(signed, "report.json")


def test_removed_signature_is_detected(signed: Path) -> None:
    _edit(signed / "report.json", lambda report: report.update(signed=None))
    assert "is not signed" in _whats(signed, "report.json")


def _forge(signed: Path, key: SigningKey) -> None:
    """Polish everything, and sign it anew with another key, as one would who has the tool but not the key."""
    report = parse_json((signed / "report.json").read_bytes())
    report["items"][0]["verdict"] = "PASS"
    block = report["signed"] | {"digest": digest(report), "key": key.fingerprint, "public": key.public}
    report["signed"] = sign_data(block, key)
    (signed / "report.json").write_bytes(render_json(report))
    manifest = parse_json((signed / "manifest.json").read_bytes())
    data = (signed / "report.json").read_bytes()
    manifest["files"]["report.json"] = {"sha256": sha256(data).hexdigest(), "bytes": len(data)}
    (signed / "manifest.json").write_bytes(render_json(sign_data(manifest, key)))


def test_signature_by_an_unknown_key_is_detected(signed: Path, tmp_path: Path) -> None:
    key = SigningKey.load_or_create(tmp_path / "other.key")
    _forge(signed, key)
    unknown = f"it is signed with key {key.fingerprint}, which is unknown on this computer"
    assert _whats(signed, "report.json") == [unknown, "has other results than the records of the checklist"]
    assert _whats(signed, "manifest.json") == [unknown]


def test_checklist_of_another_computer_needs_its_key(signed: Path, desk: Desk, tmp_path: Path) -> None:
    copy = shutil.copytree(signed, tmp_path / "copy")
    here = tmp_path / "here.key"
    whose = SigningKey.load_or_create(desk.key).fingerprint
    for key in (None, SigningKey.load_or_create(here)):
        assert [one.what for one in verify(copy, key=here if key else tmp_path / "none.key")] == [
            f"it is signed with key {whose}, which is unknown on this computer"
        ] * 2
    assert verify(copy, key=here, required_keys=[whose]) == ()
    for own in (desk.key, here):
        assert [one.what for one in verify(copy, key=own, required_keys=["SHA256:other"])] == [
            f"it is signed with key {whose}, but another key was requested"
        ] * 2, "who asks for a key gets no other, not this computer's own either"
    assert verify(copy, key=desk.key) == ()


def test_unsigned_book_does_not_verify(desk: Desk) -> None:
    with desk.open() as book:
        answer(book)
    (trouble,) = verify(book.folder)
    assert (trouble.file, trouble.what) == ("manifest.json", "is missing: nobody vouches for these files")


def test_report_alone_can_be_verified(signed: Path, desk: Desk, tmp_path: Path) -> None:
    data = (signed / "report.json").read_bytes()
    assert verify_report(data, key=desk.key) == ()
    (stranger,) = verify_report(data, key=tmp_path / "none.key")
    assert stranger.what.startswith("it is signed with key SHA256:")
    assert "by telephone or on paper" in stranger.hint
    for place in range(0, len(data), 35):
        changed = data[:place] + bytes([data[place] ^ 1]) + data[place + 1 :]
        assert verify_report(changed, key=desk.key), place


@pytest.mark.parametrize(
    "data",
    [b"", b"{}", b"[]", b"null", b"\xff", b"{" * 100_000, b'{"signed": 7}', b'{"a": NaN}'],
    ids=["nothing", "no keys", "list", "null", "no text", "deep", "shape", "nan"],
)
def test_invalid_report_is_refused(desk: Desk, data: bytes) -> None:
    (trouble,) = verify_report(data, key=desk.key)
    assert trouble.what == "is not a checklist report, or is damaged"


def test_reformatted_report_is_refused(signed: Path, desk: Desk) -> None:
    data = parse_json((signed / "report.json").read_bytes())
    (trouble,) = verify_report(json.dumps(data).encode(), key=desk.key)
    assert trouble.what == "has the signed content, but is not byte for byte as it was written"
    twice = (signed / "report.json").read_bytes().replace(b'"site":', b'"run": "other",\n "site":', 1)
    (trouble,) = verify_report(twice, key=desk.key)
    assert trouble.what == "is not a checklist report, or is damaged"


def test_malformed_manifest_is_detected(signed: Path) -> None:
    whole = (signed / "manifest.json").read_bytes()
    for data in (b"[]", b'{"files": []}', b'{"files": {"x": 1}}', whole.replace(b"\n", b"\r\n")):
        (signed / "manifest.json").write_bytes(data)
        assert [one.what for one in verify(signed)] == ["is damaged"]


def test_signing_key_is_created_once_and_private(desk: Desk) -> None:
    desk.signed(names=[WIFI])
    first = desk.key.read_bytes()
    assert desk.key.stat().st_mode & 0o777 == 0o600
    desk.signed(names=[DHCP])
    assert desk.key.read_bytes() == first
    assert [path.name for path in desk.state.iterdir() if path.is_file()] == ["checklist.key"]


def test_first_of_two_concurrently_created_keys_wins(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    other, path = SigningKey.load_or_create(tmp_path / "other"), tmp_path / "checklist.key"

    def outrun(own: Path, data: bytes, *, replace: bool) -> None:
        write_atomically(path, (tmp_path / "other").read_bytes())
        write_atomically(own, data, replace=replace)

    monkeypatch.setattr("atlantis_netcfg.runs.write_atomically", outrun)
    assert SigningKey.load_or_create(path).fingerprint == other.fingerprint
    assert sorted(one.name for one in tmp_path.iterdir()) == ["checklist.key", "other"]


def test_key_readable_by_others_is_refused(signed: Path, desk: Desk) -> None:
    desk.key.chmod(0o644)
    with pytest.raises(SigningKeyError, match="other users of this computer can read the signing key") as error:
        verify(signed)
    assert (error.value.hint or "").startswith("chmod 600 ")


def test_invalid_key_is_refused(desk: Desk) -> None:
    desk.key.parent.mkdir(parents=True)
    desk.key.write_bytes(b"no key")
    desk.key.chmod(0o600)
    with desk.open([WIFI]) as book:
        answer(book)
        with pytest.raises(SigningKeyError, match="the signing key cannot be read"):
            book.sign(NAME, pages)
        assert not (book.folder / "manifest.json").exists()


def test_canonical_form() -> None:
    assert canonical({"b": [1, 1.5, None], "a": "ä"}) == '{"a":"ä","b":[1,1.5,null]}'.encode()


def test_report_signed_without_a_time_zone_still_verifies(signed: Path) -> None:
    """It was signed without the field, which has a value of its own once it is read."""
    path, secret = signed / "report.json", signed.parents[3] / "checklist.key"
    key = SigningKey.load(secret)
    assert key is not None
    data = parse_json(path.read_bytes())
    del data["time_zone"]
    data["signed"] = sign_data(data["signed"] | {"digest": digest(data)}, key)
    old = render_json(data)
    assert verify_report(old, key=secret) == ()
    assert Document.model_validate_json(old).time_zone == ""
    data["title"] = "another"
    assert verify_report(render_json(data), key=secret) != ()
