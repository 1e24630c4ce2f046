"""Photos as evidence: shown as they are, made smaller, or only named; what is another file is said loudly."""

import io

import checklist_example as made
import pytest
from PIL import Image

from atlantis_netcfg.checklist.report import Evidence, EvidenceType, _photos
from atlantis_netcfg.checklist.report._photos import Attachment, find_attachments


def picture(kind: str, width: int = 40, height: int = 30, **more: object) -> bytes:
    kept = io.BytesIO()
    Image.linear_gradient("L").resize((width, height)).convert("RGB").save(kept, kind, **more)
    return kept.getvalue()


def kept(data: bytes | None, *, sha256: str | None = "as it is", name: str = "a.jpg") -> Attachment:
    digest = made.sha256(data or b"") if sha256 == "as it is" else sha256
    evidence = Evidence(type=EvidenceType.FILE, what="photo", value="1", file=name, sha256=digest)
    document = made.green(items=(made.item("sparus/gps", evidence=(evidence, evidence)),))
    (one,) = find_attachments(document, {} if data is None else {name: data}).values()
    return one


@pytest.mark.parametrize(("kind", "media"), [("PNG", "image/png"), ("JPEG", "image/jpeg")])
def test_small_picture_is_shown_unchanged(kind: str, media: str) -> None:
    data = picture(kind)
    photo = kept(data).photo
    assert photo is not None
    assert (photo.media, photo.data, photo.width, photo.height, photo.is_reduced) == (media, data, 40, 30, False)


@pytest.mark.parametrize("kind", ["PNG", "JPEG", "WEBP"])
def test_large_picture_is_reduced(kind: str) -> None:
    data = picture(kind, 2000, 1000)
    one = kept(data)
    assert one.photo is not None
    assert (one.photo.media, one.photo.width, one.photo.height) == ("image/jpeg", 1400, 700)
    assert one.words == f"SHA-256 {made.sha256(data)}; {len(data)} bytes; shown reduced"
    assert kept(data) == one


def test_rotated_picture_is_set_upright() -> None:
    exif = Image.Exif()
    exif[0x0112] = 6
    photo = kept(picture("JPEG", 40, 30, exif=exif)).photo
    assert photo is not None
    assert (photo.width, photo.height) == (30, 40)
    with Image.open(io.BytesIO(photo.data)) as image:
        assert image.getexif().get(0x0112, 1) == 1


def test_location_is_removed_from_photos_of_earlier_releases() -> None:
    exif = Image.Exif()
    exif[0x010F] = "41 deg 11 N"
    one = kept(picture("JPEG", exif=exif, comment=b"41 deg 11 N"))
    assert one.photo is not None
    assert b"41 deg" not in one.photo.data
    assert (one.photo.width, one.photo.height, one.photo.is_reduced) == (40, 30, False)
    assert "reduced" not in one.words


@pytest.mark.parametrize(
    "data",
    [
        b"",
        b"allow 203.0.113.2\n",
        b'<svg xmlns="http://www.w3.org/2000/svg"><script>alert(1)</script></svg>',
        picture("PNG")[:60],
        picture("JPEG", 900, 900)[:900],
        picture("TIFF"),
        b"GIF89a" + b"\xff" * 40,
    ],
    ids=["empty", "text", "svg", "damaged-png", "damaged-jpeg", "tiff", "nonsense-gif"],
)
def test_file_that_is_no_picture_is_only_named(data: bytes) -> None:
    one = kept(data)
    assert one.photo is None
    assert not one.amiss
    assert one.words == f"SHA-256 {made.sha256(data)}; {len(data)} bytes"


def test_oversized_picture_is_only_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(_photos, "MAX_PIXELS", 1000)
    assert kept(picture("PNG")).photo is None
    monkeypatch.setattr(_photos, "MAX_PIXELS", 1200)
    assert kept(picture("PNG")).photo is not None


def test_excess_pictures_are_only_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(_photos, "ALL_BYTES", 10)
    one = kept(picture("PNG"))
    assert one.photo is None
    assert one.words.endswith("; not shown, too many pictures")


def test_missing_file_is_reported() -> None:
    one = kept(None, sha256="0" * 64)
    assert one.amiss
    assert one.words == f"SHA-256 {'0' * 64}; the file is not in the folder of this document"


def test_replaced_file_is_not_shown() -> None:
    one = kept(picture("PNG"), sha256="0" * 64)
    assert one.amiss
    assert one.photo is None
    assert "the file there is DIFFERENT" in one.words


def test_file_without_a_hash_is_shown_and_marked() -> None:
    one = kept(picture("PNG"), sha256=None)
    assert one.photo is not None
    assert one.words.startswith("without a SHA-256; ")
