"""An authority comes into being as a whole, and is never overwritten."""

import shutil
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from ipaddress import IPv4Address
from pathlib import Path

import pytest
from authority_stand import NAMES, PASSPHRASE, stand
from cryptography import x509
from cryptography.x509.oid import NameOID

from atlantis_netcfg.core.errors import ExitCode, UsageError
from atlantis_netcfg.core.secret import Secret
from atlantis_netcfg.vpn import pki
from atlantis_netcfg.vpn.authority import ledger_session
from atlantis_netcfg.vpn.authority.authority import Authority
from atlantis_netcfg.vpn.authority.model import CorruptAuthorityError, NoAuthority, ServerNames

OTHER = Secret("another six words that a die has chosen")


def tree(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def test_new_authority_has_the_expected_files(tmp_path: Path) -> None:
    made = stand(tmp_path)
    assert set(tree(made.folder)) == {
        *("ca.crt", "ca.key.vault", "crl.pem", "ledger.head", "ledger.jsonl", "lock", "server/server.crt"),
        *("server/server.key", "server/tls-crypt.key", "server/tls-crypt-v2.key"),
    }
    for path in (made.folder, *made.folder.rglob("*")):
        assert path.stat().st_mode & 0o077 == 0
    server = x509.load_pem_x509_certificate((made.folder / "server" / "server.crt").read_bytes())
    assert server.subject.get_attributes_for_oid(NameOID.COMMON_NAME)[0].value == "vpn-server"
    assert pki.issued_by(server, made.ca.certificate)
    assert made.authority.server() == NAMES
    assert made.authority.membership().crl_number == 1
    assert made.authority.check() == []


def test_existing_authority_is_not_replaced(tmp_path: Path) -> None:
    made = stand(tmp_path)
    made.issue("a")
    before = tree(made.folder)
    assert Authority.init(made.folder, OTHER, NAMES, "me").folder == made.folder
    other = ServerNames("vpn-server", ("other.example",), (IPv4Address("192.0.2.1"),))
    with pytest.raises(UsageError, match=r"already has an authority, whose server is vpn.example, 192.0.2.1"):
        Authority.init(made.folder, OTHER, other, "me")
    assert tree(made.folder) == before


def test_a_weak_passphrase_leaves_nothing(tmp_path: Path) -> None:
    with pytest.raises(pki.WeakPassphrase):
        Authority.init(tmp_path / "vpn", Secret("short"), NAMES, "me")
    assert tree(tmp_path / "vpn") == {"lock": b""}
    assert not Authority.exists(tmp_path / "vpn")


def test_missing_authority_is_reported_with_the_init_command(tmp_path: Path) -> None:
    with pytest.raises(NoAuthority, match="there is no authority in") as missing:
        Authority.open(tmp_path)
    assert "provision vpn init" in str(missing.value.hint)
    assert missing.value.exit is ExitCode.USAGE


def test_lost_ledger_is_not_overwritten_by_init(tmp_path: Path) -> None:
    made = stand(tmp_path)
    (made.folder / "ledger.jsonl").unlink()
    before = tree(made.folder)
    with pytest.raises(CorruptAuthorityError, match=r"has ca.crt, crl.pem, ca.key.vault, but no ledger"):
        Authority.open(made.folder)
    with pytest.raises(CorruptAuthorityError, match="but no ledger"):
        Authority.init(made.folder, PASSPHRASE, NAMES, "me", "vault")
    assert tree(made.folder) == before


def test_unusable_folder_is_reported(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(Exception, match="no folder for the authority: File exists"):
        Authority.init(tmp_path / "file", PASSPHRASE, NAMES, "me")


def test_server_certificate_is_renewed_for_new_names_or_before_expiry(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    made = stand(tmp_path)
    other = replace(NAMES, dns=("other.example",))
    with made.signing() as signer:
        assert not signer.serve(NAMES)
        assert signer.serve(other)
        assert not signer.serve(other)
    assert made.authority.server() == other
    server = x509.load_pem_x509_certificate((made.folder / "server" / "server.crt").read_bytes())
    key = pki.load_key(Secret((made.folder / "server" / "server.key").read_text()))
    assert server.public_key() == key.public_key()
    names = server.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    assert names.get_values_for_type(x509.DNSName) == ["other.example"]
    assert made.authority.check() == []
    monkeypatch.setattr(ledger_session, "utc_now", lambda: datetime.now(UTC) + timedelta(days=1826 - 80))
    with made.signing() as signer:
        assert signer.serve(other)


@pytest.mark.parametrize("name", ["server.crt", "server.key"])
def test_server_key_not_matching_its_certificate_replaces_both(name: str, tmp_path: Path) -> None:
    made, other = (stand(tmp_path / side) for side in ("one", "other"))
    with other.signing() as signer:
        signer.serve(replace(NAMES, common_name="vpn-server-2"))
    shutil.copy(other.folder / "server" / name, made.folder / "server" / name)
    with made.signing():
        pass
    server = x509.load_pem_x509_certificate((made.folder / "server" / "server.crt").read_bytes())
    key = pki.load_key(Secret((made.folder / "server" / "server.key").read_text()))
    assert server.public_key() == key.public_key()
    assert made.authority.server() == NAMES
    assert made.authority.check() == []


def test_a_ca_of_another_ledger_signs_nothing(tmp_path: Path) -> None:
    made = stand(tmp_path)
    other = Authority.init(tmp_path / "other", PASSPHRASE, NAMES, "me", "vault")
    for name in ("ca.crt", "ca.key.vault"):
        (made.folder / name).write_bytes((other.folder / name).read_bytes())
    refused = pytest.raises(CorruptAuthorityError, match=r"ca.crt is not the certificate authority of the ledger")
    with refused, made.authority.unlock(lambda: PASSPHRASE, "me"):
        pass
    assert "ca.crt is not the certificate authority of the ledger" in made.authority.check()
