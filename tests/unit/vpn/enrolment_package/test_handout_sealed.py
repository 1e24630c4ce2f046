"""The sealed file: the same inside for the same wish, opened by nobody else, and never unpacked into a surprise."""

import hashlib
import io
import os
import re
import subprocess
import tarfile
from collections.abc import Callable
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pyrage
import pytest
from handout_mint import Wanted, identity

from atlantis_netcfg.core.errors import UsageError
from atlantis_netcfg.core.secret import Secret
from atlantis_netcfg.inventory import Inventory, load
from atlantis_netcfg.vpn import enrolment_package as handouts
from atlantis_netcfg.vpn import pki
from atlantis_netcfg.vpn.enrolment_package import (
    InvalidPackage,
    OneTimePassphrase,
    Recipient,
    WrongKey,
    _as_made,
    accept,
    build_package,
    open_package,
    pack,
    unpack,
)
from atlantis_netcfg.vpn.enrolment_package.profile import NotAnIdentity, read_identity
from atlantis_netcfg.vpn.identity import MemberKind, MemberLink, Wrap

NOW = datetime(2026, 11, 22, tzinfo=UTC)
CONTACT = "Example Person"
GATEWAY = Wanted("coastal-gateway", MemberKind.HOST, None, "10.80.0.21", MemberLink.SATELLITE)


@pytest.fixture(scope="module")
def declaration() -> Inventory:
    return load(Path(__file__).parents[4] / "inventory")


@pytest.fixture(scope="module")
def key() -> pyrage.x25519.Identity:
    return pyrage.x25519.Identity.generate()


def sealed(declaration: Inventory, wanted: Wanted, key: pyrage.x25519.Identity) -> bytes:
    return build_package(declaration, identity(wanted), Recipient(str(key.to_public())), contact=CONTACT).data


class TestSealing:
    def test_package_opens_with_its_one_time_passphrase(self, declaration: Inventory) -> None:
        told = identity()
        made = build_package(declaration, told, OneTimePassphrase(), contact=CONTACT)
        assert made.passphrase is not None
        digits = made.passphrase.reveal()
        assert re.fullmatch(r"\d{5}(-\d{5}){4}", digits)
        assert (made.file_name, made.sha256) == ("inesc-laptop1.tar.age", hashlib.sha256(made.data).hexdigest())
        assert digits not in repr(made)
        assert read_identity(open_package(made.data, Secret(digits.replace("-", " ")))["inesc-laptop1.ovpn"]) == told
        with pytest.raises(WrongKey, match="this passphrase does not open the enrolment package"):
            open_package(made.data, Secret("00000-00000-00000-00000-00000"))

    @pytest.mark.parametrize(
        ("typed", "read"),
        [
            (" 12345-67890-12345-67890-12345\n", "12345-67890-12345-67890-12345"),
            ("1234567890123456789012345", "12345-67890-12345-67890-12345"),
            ("12345 67890", "12345 67890"),
            ("correct horse battery", "correct horse battery"),
        ],
    )
    def test_typed_passphrase_digits_are_normalised(self, typed: str, read: str) -> None:
        assert _as_made(Secret(typed)).reveal() == read

    def test_package_opens_with_the_recipient_key(self, declaration: Inventory, key: pyrage.x25519.Identity) -> None:
        made = build_package(
            declaration, identity(Wanted(generation=3)), Recipient(str(key.to_public())), contact=CONTACT
        )
        assert (made.passphrase, made.file_name) == (None, "inesc-laptop1.3.tar.age")
        assert "inesc-laptop1.ovpn" in open_package(made.data, Secret(str(key)))
        with pytest.raises(WrongKey, match="this key does not open the enrolment package"):
            open_package(made.data, Secret(str(pyrage.x25519.Identity.generate())))

    def test_invalid_recipient_key_is_refused(self, declaration: Inventory) -> None:
        with pytest.raises(pki.InvalidRecipientError):
            build_package(declaration, identity(), Recipient("age1nonsense"), contact=CONTACT)

    @pytest.mark.parametrize(
        "spoil",
        [lambda data: data[:-60], lambda _: b"", lambda data: b"client\n" + data, lambda data: data.lower()],
        ids=["cut", "empty", "another text", "changed"],
    )
    def test_damaged_package_is_refused(
        self, spoil: Callable[[bytes], bytes], declaration: Inventory, key: pyrage.x25519.Identity
    ) -> None:
        with pytest.raises(InvalidPackage, match="it is not sealed, or was damaged on the way"):
            open_package(spoil(sealed(declaration, Wanted(), key)), Secret(str(key)))

    def test_age_and_tar_open_the_package_with_private_files(
        self, declaration: Inventory, key: pyrage.x25519.Identity, tmp_path: Path
    ) -> None:
        """As docs/partners.md says it, for a key of age and for one of SSH."""
        ssh = tmp_path / "id_ed25519"
        subprocess.run(["ssh-keygen", "-q", "-t", "ed25519", "-N", "", "-f", str(ssh)], check=True)
        own = tmp_path / "key.txt"
        own.write_text(str(key))
        publics = {own: str(key.to_public()), ssh: ssh.with_suffix(".pub").read_text().strip()}
        for secret, public in publics.items():
            made = build_package(declaration, identity(), Recipient(public), contact=CONTACT)
            place = tmp_path / f"of-{secret.stem}"
            place.mkdir()
            command = 'umask 022; age --decrypt --identity "$0" | tar -xf -'
            subprocess.run(["sh", "-c", command, str(secret)], input=made.data, cwd=place, check=True)
            files = list((place / "inesc-laptop1").iterdir())
            assert {one.name for one in files} >= {"inesc-laptop1.ovpn", "README.txt", "self-test.py"}
            assert {one.stat().st_mode & 0o777 for one in files} == {0o600}


class TestArchive:
    def test_package_is_reproducible(self, declaration: Inventory) -> None:
        told = identity()
        first, second = (handouts.contents(declaration, told, contact=CONTACT) for _ in range(2))
        packed = pack("inesc-laptop1", first, 1793491200)
        assert packed == pack("inesc-laptop1", second, 1793491200)
        with tarfile.open(fileobj=io.BytesIO(packed)) as archive:
            entries = archive.getmembers()
        assert {(one.mode, one.mtime, one.uid, one.gid, one.uname, one.gname) for one in entries} == {
            (0o600, 1793491200, 0, 0, "", "")
        }
        assert {one.name.partition("/")[0] for one in entries} == {"inesc-laptop1"}

    @pytest.mark.parametrize(
        "name", ["../x", "/etc/passwd", "a/../../x", "a", "a/b/c", ".ssh/id", "a/.bashrc", "a/b\n", "a/", "A/b", "a/-x"]
    )
    def test_archive_names_outside_the_folder_are_refused(self, name: str) -> None:
        packed = io.BytesIO()
        with tarfile.open(fileobj=packed, mode="w") as archive:
            archive.addfile(tarfile.TarInfo(name))
        with pytest.raises(InvalidPackage, match="it contains"):
            unpack(packed.getvalue())

    @pytest.mark.parametrize(
        "kind", [tarfile.SYMTYPE, tarfile.LNKTYPE, tarfile.DIRTYPE, tarfile.FIFOTYPE, tarfile.CHRTYPE]
    )
    def test_archive_entry_that_is_no_regular_file_is_refused(self, kind: bytes) -> None:
        packed, entry = io.BytesIO(), tarfile.TarInfo("a/b")
        entry.type, entry.linkname = kind, "/etc/passwd"
        with tarfile.open(fileobj=packed, mode="w") as archive:
            archive.addfile(entry)
        with pytest.raises(InvalidPackage, match="it contains 'a/b'"):
            unpack(packed.getvalue())

    @pytest.mark.parametrize(
        ("packed", "why"),
        [
            (pack("a", {}, 0), "it is empty"),
            (pack("a", {"b": "1"}, 0)[:700], "its content cannot be read"),
            (os.urandom(4096), "its content cannot be read"),
            (bytes(1024 * 1024 + 1), "it is larger than 1048576 bytes"),
            (pack("a", {f"b{number}": "" for number in range(21)}, 0), "it contains 'a/b20'"),
        ],
        ids=["empty", "cut", "noise", "large", "many"],
    )
    def test_invalid_archive_is_refused(self, packed: bytes, why: str) -> None:
        with pytest.raises(InvalidPackage, match=f"^this is not an enrolment package of the VPN: {re.escape(why)}$"):
            unpack(packed)

    def test_archive_with_two_folders_or_a_duplicate_name_is_refused(self) -> None:
        first, second = pack("a", {"b": "1"}, 0)[:1024], pack("c", {"d": "2"}, 0)
        with pytest.raises(InvalidPackage, match="it contains more than one folder"):
            unpack(first + second)
        with pytest.raises(InvalidPackage, match="it contains 'a/b'"):
            unpack(first + pack("a", {"b": "2"}, 0))


class TestAccept:
    def test_accepted_identity_is_private(
        self, declaration: Inventory, key: pyrage.x25519.Identity, tmp_path: Path
    ) -> None:
        data, folder = sealed(declaration, GATEWAY, key), tmp_path / "vpn"
        first, again = (accept(declaration, data, Secret(str(key)), folder, now=NOW) for _ in range(2))
        assert (first.already, again.already) == (False, True)
        assert first.path == folder / "hosts" / "coastal-gateway.identity"
        assert [one.stat().st_mode & 0o777 for one in (folder, first.path.parent, first.path)] == [0o700, 0o700, 0o600]
        assert read_identity(first.path.read_text()) == first.identity
        assert [one.name for one in first.path.parent.iterdir()] == ["coastal-gateway.identity"]

    def test_newer_identity_replaces_an_older_one_but_not_vice_versa(
        self, declaration: Inventory, key: pyrage.x25519.Identity, tmp_path: Path
    ) -> None:
        old = sealed(declaration, GATEWAY, key)
        later = GATEWAY.not_before + timedelta(days=300)
        new = sealed(declaration, replace(GATEWAY, generation=2, not_before=later), key)
        for data in (old, new):
            kept = accept(declaration, data, Secret(str(key)), tmp_path, now=NOW)
        with pytest.raises(UsageError, match="a newer identity of coastal-gateway already exists"):
            accept(declaration, old, Secret(str(key)), tmp_path, now=NOW)
        assert read_identity(kept.path.read_text()).certificate.common_name == "coastal-gateway.2"
        kept.path.write_text("client\n")
        assert not accept(declaration, old, Secret(str(key)), tmp_path, now=NOW).already

    @pytest.mark.parametrize(
        ("wanted", "why"),
        [
            (Wanted(), "it is for a partner's device, not for a computer of the inventory"),
            (replace(GATEWAY, name="coastal-gatway"), "coastal-gatway, which is not a host of this inventory"),
            (replace(GATEWAY, address="10.80.0.99"), "the address 10.80.0.99, but the inventory has 10.80.0.21"),
            (replace(GATEWAY, not_after=NOW - timedelta(days=1)), "expired on 2026-11-21"),
        ],
        ids=["a partner's", "another inventory's", "another address", "expired"],
    )
    def test_unsuitable_identity_is_refused(
        self, wanted: Wanted, why: str, declaration: Inventory, key: pyrage.x25519.Identity, tmp_path: Path
    ) -> None:
        with pytest.raises((UsageError, NotAnIdentity), match=why):
            accept(declaration, sealed(declaration, wanted, key), Secret(str(key)), tmp_path / "vpn", now=NOW)
        assert not (tmp_path / "vpn").exists()

    def test_identity_of_our_router_can_be_accepted(
        self, declaration: Inventory, key: pyrage.x25519.Identity, tmp_path: Path
    ) -> None:
        """Its identity takes the same way; the toolkit itself brings it to the device."""
        wanted = Wanted("coastal-router", MemberKind.ROUTER, None, "10.80.0.11", wrap=Wrap.TLS_CRYPT)
        device = declaration.hosts["coastal-router"].device
        assert str(getattr(getattr(device, "vpn_client", None), "address", "")) == wanted.address
        kept = accept(declaration, sealed(declaration, wanted, key), Secret(str(key)), tmp_path, now=NOW)
        assert kept.path.name == "coastal-router.identity"
