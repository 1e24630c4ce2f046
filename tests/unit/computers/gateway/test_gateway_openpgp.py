"""The reader of public keys, held to what gpg says of the same files."""

import base64
import subprocess
from collections.abc import Iterable
from contextlib import suppress
from itertools import pairwise
from pathlib import Path

import pytest
from row_subtests import for_each_row

from atlantis_netcfg.ansible_collections.atlantis.netcfg.plugins.module_utils.openpgp import (
    NotAKey,
    PublicKey,
    binary,
    public_keys,
)
from atlantis_netcfg.emulator.lab.stubs import publish

KEYRINGS = sorted(Path("/usr/share/keyrings").glob("debian-archive-*.gpg"))


def as_gpg_says(path: Path, home: Path) -> list[tuple[str, int, int | None]]:
    words = ["gpg", "--homedir", str(home), "--batch", "--quiet", "--show-keys", "--with-colons", str(path)]
    told = subprocess.run(words, capture_output=True, text=True, check=True).stdout
    found: list[tuple[str, int, int | None]] = []
    lines = [line.split(":") for line in told.splitlines() if not line.startswith("rvk:")]
    for line, after in pairwise(lines):
        if line[0] == "pub":
            assert after[0] == "fpr"
            found.append((after[9], int(line[5]), int(line[6]) if line[6] else None))
    return found


def as_we_say(keys: Iterable[PublicKey]) -> list[tuple[str, int, int | None]]:
    return [(key.fingerprint, key.created_at, key.expires) for key in keys]


@pytest.mark.parametrize("path", KEYRINGS, ids=[path.stem for path in KEYRINGS])
def test_debian_keys_are_read_as_by_gpg(path: Path, tmp_path: Path) -> None:
    assert as_we_say(public_keys(path.read_bytes())) == as_gpg_says(path, tmp_path)


@pytest.fixture(scope="module")
def key(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    return publish(tmp_path_factory.mktemp("archive") / "archive", [], codename="focal").key


def armoured(key: bytes, head: str = "Comment: made for a test\n", end: str = "\n") -> bytes:
    lines = f"-----BEGIN PGP PUBLIC KEY BLOCK-----\n{head}\n{base64.encodebytes(key).decode()}=AbCd\n"
    return f"{lines}-----END PGP PUBLIC KEY BLOCK-----\n".replace("\n", end).encode()


@pytest.mark.parametrize("head", ["", "Comment: a\nVersion: b\n"])
@pytest.mark.parametrize("end", ["\n", "\r\n"])
def test_armour_is_removed(key: bytes, head: str, end: str) -> None:
    assert binary(armoured(key, head, end)) == key
    assert binary(key) == key
    assert public_keys(armoured(key, head, end)) == public_keys(key)


def test_truncated_key_is_refused_or_the_same_key(key: bytes) -> None:
    whole = public_keys(key)[0].fingerprint
    for end in range(len(key)):
        try:
            cut = public_keys(key[:end])
        except NotAKey:
            continue
        assert [one.fingerprint for one in cut] == [whole]


@for_each_row("place", range(0, 220, 3))
def test_damaged_key_raises_no_unexpected_error(key: bytes, place: int) -> None:
    damaged = bytearray(key)
    damaged[place % len(key)] ^= 0xFF
    with suppress(NotAKey):
        assert public_keys(bytes(damaged))


@pytest.mark.parametrize(
    ("content", "why"),
    [
        (b"", "neither an armoured nor a binary"),
        (b"<html>404</html>", "neither an armoured nor a binary"),
        (b"-----BEGIN PGP PUBLIC KEY BLOCK-----\n\n!!\n-----END PGP PUBLIC KEY BLOCK-----\n", "armour is damaged"),
        (bytes([0x99, 0x00, 0x02, 0x03, 0x00]), "a key of version 3"),
        (bytes([0xB4, 0x01, 0x41]), "it contains no public key"),
    ],
)
def test_invalid_key_is_refused_with_a_reason(content: bytes, why: str) -> None:
    with pytest.raises(NotAKey, match=why):
        public_keys(content)
