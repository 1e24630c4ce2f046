"""From the vendor's file to the working copy: packings, checksums, block maps, and files that are damaged."""

import gzip
import hashlib
import lzma
import subprocess
import sys
from pathlib import Path

import pytest

from atlantis_netcfg.computers.image.facts import ImageError
from atlantis_netcfg.computers.image.source import SourceKind, UnpackedImage, checksum, expand, segments
from atlantis_netcfg.computers.image.writer import Progress, WriteMeter, WriterStep

RAW = b"\x01" * 70000 + bytes(300000) + b"\x02" * 5000 + bytes(200) + b"\x03" * 312
BLOCK = 4096
PACKED = {
    "raw": RAW,
    "xz": lzma.compress(RAW),
    "gz": gzip.compress(RAW),
    "xz in two": lzma.compress(RAW[:9]) + lzma.compress(RAW[9:]),
}


def unpack(folder: Path, data: bytes, sha256: str | None = None) -> UnpackedImage:
    image = folder / "x.img.xz"
    image.write_bytes(data)
    return expand(image, folder / "copy", checksum(image, sha256), lambda _done, _total: None)


@pytest.mark.parametrize("packing", PACKED)
def test_every_compression_gives_the_same_copy(packing: str, tmp_path: Path) -> None:
    expanded = unpack(tmp_path, PACKED[packing])
    assert expanded.path.read_bytes() == RAW + bytes(-len(RAW) % BLOCK)
    assert (expanded.size, expanded.spans, expanded.told_by) == (len(RAW), None, "")
    assert expanded.sha256 == hashlib.sha256(PACKED[packing]).hexdigest()
    assert expanded.path.stat().st_mode & 0o777 == 0o600


def test_zeros_are_stored_as_holes(tmp_path: Path) -> None:
    expanded = unpack(tmp_path, RAW)
    parts = segments(expanded.path, expanded.size)
    assert sum(part.size for part in parts) == len(RAW)
    assert sum(part.size for part in parts if part.kind is SourceKind.ZERO) > 100_000


@pytest.mark.parametrize("name", ["x.img.xz.sha256", "SHA256SUMS", "sha256sums.txt"])
def test_checksum_file_beside_the_image_is_verified(name: str, tmp_path: Path) -> None:
    right, wrong = hashlib.sha256(RAW).hexdigest(), "0" * 64
    (tmp_path / name).write_text(f"{wrong}  other.img\n{right} *x.img.xz\n")
    assert unpack(tmp_path, RAW).told_by == name
    (tmp_path / name).write_text(f"{wrong}  x.img.xz\n")
    (tmp_path / "copy").unlink()
    with pytest.raises(ImageError, match=f"its SHA-256 is {right}, but {name} says {wrong}"):
        unpack(tmp_path, RAW)


def test_given_checksum_is_verified(tmp_path: Path) -> None:
    assert unpack(tmp_path, RAW, hashlib.sha256(RAW).hexdigest().upper()).told_by == "sha256="
    with pytest.raises(ImageError, match="`abc` is not a SHA-256"):
        unpack(tmp_path, RAW, "abc")


@pytest.mark.parametrize(
    ("data", "said"),
    [
        (PACKED["xz"][:-40], "is damaged or was not downloaded completely"),
        (PACKED["gz"][:-20], "is damaged or was not downloaded completely"),
        (PACKED["xz"][:60] + b"?" * 60, "is damaged or was not downloaded completely"),
        (b"\x28\xb5\x2f\xfd" + RAW, "is packed with zstd"),
        (b"PK\x03\x04" + RAW, "is packed with zip"),
    ],
    ids=["xz cut", "gz cut", "xz spoilt", "zstd", "zip"],
)
def test_unusable_file_is_refused(data: bytes, said: str, tmp_path: Path) -> None:
    with pytest.raises(ImageError, match=said):
        unpack(tmp_path, data)


def bmap(image: bytes, ranges: dict[str, str], size: int | None = None) -> str:
    rows = "".join(f'<Range chksum="{digest}">{blocks}</Range>' for blocks, digest in ranges.items())
    text = (
        f'<?xml version="1.0" ?><bmap version="2.0"><ImageSize> {size or len(image)} </ImageSize>'
        f"<BlockSize> {BLOCK} </BlockSize><ChecksumType> sha256 </ChecksumType>"
        f"<BmapFileChecksum> {'0' * 64} </BmapFileChecksum><BlockMap>{rows}</BlockMap></bmap>"
    )
    return text.replace("0" * 64, hashlib.sha256(text.encode()).hexdigest(), 1)


def digest(first: int, last: int) -> str:
    return hashlib.sha256(RAW[first * BLOCK : (last + 1) * BLOCK]).hexdigest()


RANGES = {"0-9": digest(0, 9), "91": digest(91, 91)}


def test_block_map_limits_what_is_copied(tmp_path: Path) -> None:
    (tmp_path / "x.img.bmap").write_text(bmap(RAW, RANGES))
    expanded = unpack(tmp_path, PACKED["xz"])
    assert expanded.spans == ((0, 10 * BLOCK), (91 * BLOCK, len(RAW)))
    copy = expanded.path.read_bytes()
    assert copy[: 10 * BLOCK] == RAW[: 10 * BLOCK]
    assert copy[91 * BLOCK : len(RAW)] == RAW[91 * BLOCK :]
    assert not any(copy[10 * BLOCK : 91 * BLOCK])
    parts = segments(expanded.path, expanded.size, expanded.spans)
    assert [(part.start, part.end) for part in parts] == [(0, 10 * BLOCK), (91 * BLOCK, len(RAW))]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (bmap(RAW, {"0-9": "f" * 64}), "bytes 0 to 40960 of the image do not match its block map"),
        (bmap(RAW, RANGES, len(RAW) + 1), "its block map says"),
        (bmap(RAW, RANGES).replace(">0-9<", ">0-8<"), "its own checksum is wrong"),
        (bmap(RAW, {"9-0": ""}), "the range 9-0 is not in the image"),
        ("<html>not found</html>", "not a block map, or damaged"),
        ('<!DOCTYPE a [<!ENTITY b "c">]><bmap/>', "it contains XML entities"),
        ("", "not a block map, or damaged"),
    ],
)
def test_mismatched_block_map_is_refused(text: str, said: str, tmp_path: Path) -> None:
    (tmp_path / "x.img.xz.bmap").write_text(text)
    with pytest.raises(ImageError, match=said):
        unpack(tmp_path, PACKED["xz"])


MEASURED = """
import re, sys
from pathlib import Path
from atlantis_netcfg.computers.image.source import expand
expand(Path(sys.argv[1]), Path(sys.argv[2]), None, lambda done, total: None)
print(int(re.search(r"VmHWM:\\s+(\\d+)", Path("/proc/self/status").read_text())[1]) // 1024)
"""


@pytest.mark.parametrize("preset", [6, 9])
def test_memory_stays_below_100_mb(preset: int, tmp_path: Path) -> None:
    """Whatever the image was packed with: `xz -9` alone takes 65 MB to unpack (xz(1))."""
    packed = tmp_path / "large.img.xz"
    with lzma.open(packed, "wb", preset=preset) as out:
        for number in range(150):
            out.write(bytes([number]) * 2**20)
    command = [sys.executable, "-c", MEASURED, str(packed), str(tmp_path / "copy")]
    said = subprocess.run(command, cwd=Path(__file__).parents[4], check=True, capture_output=True, text=True).stdout
    assert int(said) < 100
    assert (tmp_path / "copy").stat().st_size == 150 * 2**20


def test_progress_is_reported_periodically_and_at_the_end() -> None:
    told: list[Progress] = []
    moments = iter([0.0, 1.0, 2.0, 3.0, 4.0, 5.0])
    meter = WriteMeter(WriterStep.WRITING, told.append, every_s=2.0, clock=lambda: next(moments))
    for done in (10, 20, 30, 40, 40):
        meter(done * 10**6, 40 * 10**6)
    assert [each.words for each in told] == [
        "writing 50 % of 40 MB, 10.0 MB/s, 2 s left",
        "writing 100 % of 40 MB, 10.0 MB/s, 0 s left",
    ]
    assert Progress(WriterStep.WRITING, 0, 0, 0.0).words == "writing 100 % of 0 MB, 0.0 MB/s"
