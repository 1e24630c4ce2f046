import base64
import itertools
import os
import stat
import subprocess
from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
from cryptography import x509
from cryptography.hazmat.primitives.hashes import SHA256
from cryptography.hazmat.primitives.serialization import Encoding
from cryptography.x509 import CertificateRevocationListBuilder as Builder
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from pki_made import NOW, authority, client, crl

from atlantis_netcfg.vpn import pki

CA = authority()
ABOVE = 4
GOOD = crl(CA, ABOVE + 1)


def check(pem: bytes, *, above: int | None = ABOVE, now: datetime = NOW) -> pki.CrlFacts:
    return pki.check_crl(pem, CA.certificate, above=above, now=now)


def refused(pem: bytes, *, above: int | None = ABOVE, now: datetime = NOW) -> str:
    with pytest.raises(pki.InvalidCrlError) as why:
        check(pem, above=above, now=now)
    assert why.value.hint is not None
    return str(why.value)


def test_list_contents_are_read() -> None:
    facts = check(GOOD)
    assert facts.number == ABOVE + 1
    assert facts.serials == {7, 1 << 158}
    assert facts.this_update == NOW.replace(microsecond=0)
    assert facts.next_update == NOW.replace(microsecond=0) + timedelta(days=90)
    assert len(facts.sha256) == 64
    assert check(GOOD, above=None) == facts
    assert check(pki.new_crl(CA, [], 5, NOW)).next_update == facts.next_update
    assert check(crl(CA, 5, serials=())).serials == frozenset()


def test_list_of_another_ca_is_refused() -> None:
    assert "another certificate authority" in refused(crl(authority("ANOTHER"), 5))
    assert "although it has the same name" in refused(crl(authority(nth=2), 5))


@pytest.mark.parametrize("number", [0, ABOVE - 1, ABOVE])
def test_older_list_is_refused(number: int) -> None:
    assert f"its number is {number}, but number 4 was already published" in refused(crl(CA, number))


def test_list_not_valid_now_is_refused() -> None:
    assert "not valid before 2026-06-01 12:00 UTC" in refused(GOOD, now=NOW - timedelta(seconds=1))
    assert "it expired on 2026-08-30 12:00 UTC" in refused(GOOD, now=NOW + timedelta(days=90))


def test_a_list_is_good_from_its_first_second_to_its_last() -> None:
    facts = check(GOOD, now=NOW.replace(microsecond=0))
    assert check(GOOD, now=facts.next_update - timedelta(seconds=1)) == facts
    assert "it expired" in refused(GOOD, now=facts.next_update)


def test_truncated_list_is_refused() -> None:
    for length in range(len(GOOD)):
        assert "damaged" in refused(GOOD[:length])


def test_no_list_with_a_flipped_bit_passes() -> None:
    for bit in range(8 * len(GOOD)):
        changed = bytearray(GOOD)
        changed[bit // 8] ^= 1 << bit % 8
        refused(bytes(changed))


def test_signature_with_leftover_bits_is_refused(tmp_path: Path) -> None:
    signed = (base64.b64decode(b"".join(crl(CA, 5).splitlines()[1:-1])) for _ in range(1000))
    even = next(der for der in signed if not der[-1] & 1)
    signature = x509.load_der_x509_crl(even).signature
    changed = even[: -len(signature) - 1] + b"\x01" + signature
    parsed = x509.load_der_x509_crl(changed)
    pem = parsed.public_bytes(Encoding.PEM)
    assert parsed.is_signature_valid(CA.key.public_key()), "our library does not mind"
    assert "damaged" in refused(pem)
    (tmp_path / "ca").write_text(pki.cert_pem(CA.certificate))
    command = ["openssl", "crl", "-CAfile", "ca", "-noout"]
    said = subprocess.run(command, cwd=tmp_path, input=pem, capture_output=True, check=False).stderr
    assert b"invalid bit string bits left" in said


@pytest.mark.parametrize("around", [b"\n", b" ", b"# comment\n", GOOD, crl(authority(nth=2), 5)])
def test_file_with_anything_besides_a_list_is_refused(around: bytes) -> None:
    for pem in (around + GOOD, GOOD + around, GOOD.replace(b"\n", b"\r\n")):
        assert "damaged" in refused(pem)


def without_number(builder: Builder) -> Builder:
    return builder.add_extension(x509.AuthorityKeyIdentifier(bytes(20), None, None), critical=False)


def partial(builder: Builder) -> Builder:
    scope = x509.IssuingDistributionPoint(
        full_name=None,
        relative_name=None,
        only_contains_user_certs=False,
        only_contains_ca_certs=True,
        only_some_reasons=None,
        indirect_crl=False,
        only_contains_attribute_certs=False,
    )
    return without_number(builder).add_extension(x509.CRLNumber(5), critical=False).add_extension(scope, critical=True)


def difference(builder: Builder) -> Builder:
    number, base = x509.CRLNumber(5), x509.DeltaCRLIndicator(4)
    return without_number(builder).add_extension(number, critical=False).add_extension(base, critical=True)


@pytest.mark.parametrize("change", [without_number, partial, difference])
def test_list_with_other_extensions_is_refused(change: Callable[[Builder], Builder]) -> None:
    whole = NOW.replace(microsecond=0)
    builder = x509.CertificateRevocationListBuilder(CA.certificate.subject, whole, whole + timedelta(days=1))
    assert "its extensions differ" in refused(change(builder).sign(CA.key, SHA256()).public_bytes(Encoding.PEM))


def put(path: Path, pem: bytes, *, above: int | None = ABOVE, now: datetime = NOW) -> pki.CrlFacts:
    return pki.publish(path, pem, CA.certificate, above=above, now=now)


WRONG = {
    "another authority's": crl(authority("ANOTHER"), 6),
    "an impostor's": crl(authority(nth=2), 6),
    "an older one": crl(CA, ABOVE),
    "an early one": crl(CA, 6, NOW + timedelta(seconds=1)),
    "an expired one": crl(CA, 6, NOW - timedelta(days=90)),
    "two": GOOD + crl(CA, 6),
    "a certificate": pki.cert_pem(CA.certificate).encode(),
    "nothing": b"",
}
CUT = st.integers(0, len(GOOD) - 1).map(lambda length: GOOD[:length])
FLIPPED = st.integers(0, 8 * len(GOOD) - 1).map(
    lambda bit: GOOD[: bit // 8] + bytes([GOOD[bit // 8] ^ 1 << bit % 8]) + GOOD[bit // 8 + 1 :]
)
SPLICED = st.tuples(st.integers(0, 200), st.binary(max_size=20)).map(lambda at: GOOD[: at[0]] + at[1] + GOOD[at[0] :])


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(pem=st.sampled_from(sorted(WRONG.values())) | CUT | FLIPPED | SPLICED.filter(lambda pem: pem != GOOD))
def test_invalid_list_never_replaces_a_valid_one(tmp_path: Path, pem: bytes) -> None:
    path = tmp_path / "crl.pem"
    path.write_bytes(GOOD)
    before = path.stat()
    with pytest.raises(pki.InvalidCrlError):
        put(path, pem)
    after = path.stat()
    assert path.read_bytes() == GOOD
    assert (after.st_ino, after.st_mtime_ns) == (before.st_ino, before.st_mtime_ns)
    assert [*tmp_path.iterdir()] == [path]


@settings(max_examples=30, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(seconds=st.lists(st.integers(-3600, 3600), min_size=2, max_size=6))
def test_new_list_always_has_a_later_modification_time(tmp_path: Path, seconds: list[int]) -> None:
    path = tmp_path / "crl.pem"
    path.unlink(missing_ok=True)
    seen: list[int] = []
    for number, second in enumerate(seconds):
        now = NOW + timedelta(seconds=second)
        put(path, crl(CA, number, now), above=number - 1 if number else None, now=now)
        seen.append(int(path.stat().st_mtime))
        assert seen[-1] >= int(now.timestamp())
    assert all(later > earlier for earlier, later in itertools.pairwise(seen))


def test_list_replaced_within_a_second_gets_the_next_second(tmp_path: Path) -> None:
    path = tmp_path / "crl.pem"
    first = put(path, GOOD)
    assert path.stat().st_mtime == int(NOW.timestamp())
    assert path.stat().st_mode & 0o777 == 0o600
    second = put(path, crl(CA, 6), above=first.number)
    assert path.stat().st_mtime == int(NOW.timestamp()) + 1
    assert second.number == 6


def test_server_list_is_readable_regardless_of_umask(tmp_path: Path) -> None:
    before = os.umask(0o077)
    try:
        pki.publish(tmp_path / "crl.pem", GOOD, CA.certificate, above=ABOVE, now=NOW, mode=0o644)
    finally:
        os.umask(before)
    assert (tmp_path / "crl.pem").stat().st_mode & 0o777 == 0o644


def test_scratch_file_of_a_killed_command_is_removed(tmp_path: Path) -> None:
    (tmp_path / f".crl.pem.{7:016}").write_bytes(GOOD[:100])
    put(tmp_path / "crl.pem", GOOD)
    assert [*tmp_path.iterdir()] == [tmp_path / "crl.pem"]


def test_list_is_synced_before_and_its_folder_after_the_rename(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path, seen = tmp_path / "crl.pem", []

    def sync(descriptor: int) -> None:
        about = os.fstat(descriptor)
        whole = stat.S_ISREG(about.st_mode) and (about.st_size, int(about.st_mtime)) == (
            len(GOOD),
            int(NOW.timestamp()),
        )
        seen.append(("file" if whole else "folder", path.exists()))

    monkeypatch.setattr(os, "fsync", sync)
    put(path, GOOD)
    assert seen == [("file", False), ("folder", True)]


def test_write_error_leaves_the_old_list(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "crl.pem"
    put(path, GOOD)

    def fail(_: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", fail)
    with pytest.raises(OSError, match="No space left"):
        put(path, crl(CA, 6), above=5)
    assert path.read_bytes() == GOOD
    assert [*tmp_path.iterdir()] == [path]


def test_openssl_verifies_against_the_list(tmp_path: Path) -> None:
    today = datetime.now(UTC)
    ca = pki.new_ca("ATLANTIS VPN", today)
    good, bad = client(ca, "good", now=today), client(ca, "bad", now=today)
    for name, made in (("ca", ca.certificate), ("good", good), ("bad", bad)):
        (tmp_path / name).write_text(pki.cert_pem(made))
    (tmp_path / "crl").write_bytes(crl(ca, 1, today, serials=(bad.serial_number,)))
    signed = ["openssl", "crl", "-in", "crl", "-CAfile", "ca", "-noout", "-text"]
    said = subprocess.run(signed, cwd=tmp_path, capture_output=True, text=True, check=True)
    assert "verify OK" in said.stderr
    assert "CRL Number" in said.stdout
    assert "Authority Key Identifier" in said.stdout
    for name in ("good", "bad"):
        command = ["openssl", "verify", "-x509_strict", "-crl_check", "-CRLfile", "crl", "-CAfile", "ca", name]
        done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
        assert (done.returncode == 0) is (name == "good"), done.stderr
    assert "certificate revoked" in done.stderr
