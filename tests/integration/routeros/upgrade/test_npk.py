import hashlib
import re
import struct
from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from npk_files import MAGIC, contents, info, part, write

from atlantis_netcfg.core.versions import Version
from atlantis_netcfg.routeros.packages import NotAPackage, read_npk

NAMES = {
    "routeros-7.18.2-arm64.npk": ("routeros", "7.18.2", "arm64"),
    "routeros-arm64-6.49.19.npk": ("routeros", "6.49.19", "arm64"),
    "wifi-qcom-ac-7.18.2-arm.npk": ("wifi-qcom-ac", "7.18.2", "arm"),
    "advanced-tools-6.49-mipsbe.npk": ("advanced-tools", "6.49", "mipsbe"),
    "routeros-7.22rc1-mmips.npk": ("routeros", "7.22rc1", "mmips"),
    "routeros-7.18.2.npk": ("routeros", "7.18.2", "x86"),
    "tr069-client-7.18.2.npk": ("tr069-client", "7.18.2", "x86"),
}


@pytest.mark.parametrize("file", NAMES)
def test_name_version_and_architecture_are_read(tmp_path: Path, file: str) -> None:
    name, version, architecture = NAMES[file]
    data = contents(name, version, "i386" if architecture == "x86" else architecture)
    (tmp_path / file).write_bytes(data)
    found = read_npk(tmp_path / file)
    assert (found.name, str(found.version), found.architecture) == (name, version, architecture)
    assert (found.size, found.sha256) == (len(data), hashlib.sha256(data).hexdigest())


def test_version_6_bundle_is_read_as_routeros(tmp_path: Path) -> None:
    body = (
        info("routeros-mipsbe", Version(6, 49, 19), kind=18) + part(16, b"mipsbe") + info("system", Version(6, 49, 19))
    )
    path = tmp_path / "routeros-mipsbe-6.49.19.npk"
    path.write_bytes(MAGIC + struct.pack("<I", len(body)) + body)
    assert read_npk(path).name == "routeros"


REFUSED: dict[str, tuple[Callable[[bytes], bytes], str]] = {
    "cut short": (lambda data: data[:-1], "but its header says"),
    "longer than it says": (lambda data: data + b"\0", "but its header says"),
    "another file": (lambda _data: b"PK\3\4" + bytes(100), "not a RouterOS package"),
    "empty": (lambda _data: b"", "not a RouterOS package"),
    "a part beyond the end": (
        lambda data: data[:10] + struct.pack("<I", 2**31) + data[14:],
        "the sizes of its parts do not match its size",
    ),
    "no architecture": (lambda data: data.replace(struct.pack("<HI", 16, 5), struct.pack("<HI", 17, 5)), "without"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_damaged_file_is_refused_with_its_path(tmp_path: Path, case: str) -> None:
    damage, words = REFUSED[case]
    path = tmp_path / "routeros-7.18.2-arm64.npk"
    path.write_bytes(damage(contents("routeros", "7.18.2", "arm64")))
    with pytest.raises(NotAPackage, match=words) as refused:
        read_npk(path)
    assert str(path) in str(refused.value)
    assert refused.value.hint


RENAMED = {
    "routeros-7.19-arm64.npk": "the version is 7.19.0, but inside it is 7.18.2",
    "routeros-7.18.2-arm.npk": "the architecture is arm, but inside it is arm64",
    "wireless-7.18.2-arm64.npk": "the package is wireless, but inside it is routeros",
}


@pytest.mark.parametrize("file", RENAMED)
def test_file_name_that_contradicts_its_content_is_refused(tmp_path: Path, file: str) -> None:
    path = tmp_path / file
    path.write_bytes(contents("routeros", "7.18.2", "arm64"))
    with pytest.raises(NotAPackage, match=re.escape(RENAMED[file])):
        read_npk(path)


@pytest.mark.parametrize("file", ["routeros.npk", "routeros-7.18.2-arm64.zip", "ROUTEROS-7.18.2-ARM64.npk", "7.18.npk"])
def test_malformed_package_file_name_is_refused(tmp_path: Path, file: str) -> None:
    path = tmp_path / file
    path.write_bytes(contents("routeros", "7.18.2", "arm64"))
    with pytest.raises(NotAPackage, match="not a valid package name"):
        read_npk(path)


def test_missing_file_is_reported_with_its_path(tmp_path: Path) -> None:
    with pytest.raises(NotAPackage, match=r"routeros-7\.18\.2-arm64\.npk: No such file"):
        read_npk(tmp_path / "routeros-7.18.2-arm64.npk")


@given(flips=st.lists(st.tuples(st.integers(0, 400), st.integers(0, 255)), max_size=8), cut=st.integers(0, 500))
def test_reader_survives_corrupt_bytes(
    tmp_path_factory: pytest.TempPathFactory, flips: list[tuple[int, int]], cut: int
) -> None:
    data = bytearray(contents("routeros", "7.18.2", "arm64", payload=300))
    for place, value in flips:
        data[place % len(data)] = value
    path = write(tmp_path_factory.mktemp("npk"), "routeros", "7.18.2", "arm64")
    path.write_bytes(bytes(data[: len(data) - cut % len(data)]) if cut % 2 else bytes(data))
    try:
        found = read_npk(path)
    except NotAPackage:
        return
    assert (found.name, found.architecture) == ("routeros", "arm64")
