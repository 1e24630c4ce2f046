"""What `check` finds, what the next command mends, and what the clock forbids."""

import shutil
from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
from authority_stand import Stand, stand, wish

from atlantis_netcfg.core.errors import ExitCode
from atlantis_netcfg.vpn import pki
from atlantis_netcfg.vpn.authority import ledger_session
from atlantis_netcfg.vpn.authority.model import ClockBehind, CorruptAuthorityError
from atlantis_netcfg.vpn.identity import KeyType
from atlantis_netcfg.vpn.ledger import CorruptLedgerError, Ledger, records

NOW = datetime.now(UTC)


def remove_copy(folder: Path) -> None:
    (folder / "certs" / "iqua-a.pem").unlink()


def change_copy(folder: Path) -> None:
    shutil.copy(folder / "certs" / "iqua-b.pem", folder / "certs" / "iqua-a.pem")


def remove_list(folder: Path) -> None:
    (folder / "crl.pem").unlink()


def empty_list(folder: Path) -> None:
    (folder / "crl.pem").write_bytes(b"")


MENDED: list[tuple[Callable[[Path], None], str]] = [
    (remove_copy, "certs/iqua-a.pem is missing; the next command that signs writes it again"),
    (change_copy, "certs/iqua-a.pem is not the certificate that was recorded"),
    (remove_list, "crl.pem cannot be read: No such file or directory"),
    (empty_list, "crl.pem would lock everybody out, or admit revoked members"),
]


@pytest.mark.parametrize(("harm", "said"), MENDED, ids=lambda value: getattr(value, "__name__", ""))
def test_reproducible_files_are_regenerated(harm: Callable[[Path], None], said: str, tmp_path: Path) -> None:
    made = stand(tmp_path)
    made.issue("a", "b")
    harm(made.folder)
    (problem,) = made.authority.check()
    assert problem.startswith(said)
    with made.signing():
        pass
    assert made.authority.check() == []


def test_older_revocation_list_is_replaced_with_a_higher_number(tmp_path: Path) -> None:
    made = stand(tmp_path)
    made.issue("a")
    older = (made.folder / "crl.pem").read_bytes()
    with made.signing() as signer:
        signer.revoke(["iqua-a"], "lost")
        number = signer.membership.crl_number
    (made.folder / "crl.pem").write_bytes(older)
    serial = made.identities[0].certificate.serial
    assert made.authority.check() == [
        f"crl.pem (number {number - 1}) is not the revocation list that was recorded last (number {number})",
        f"crl.pem lacks serial {serial:x}, which is revoked: provision vpn sync --sign",
    ]
    with pytest.raises(CorruptAuthorityError, match="is not the revocation list that was recorded last"):
        made.authority.crl()
    with made.signing() as signer:
        assert signer.membership.crl_number == number + 1
    facts = pki.check_crl(made.authority.crl(), made.ca.certificate, above=number, now=datetime.now(UTC))
    assert serial in facts.serials
    assert made.authority.check() == []


@pytest.mark.parametrize("is_revoked", [True, False])
def test_killed_command_counts_only_if_it_was_complete(*, is_revoked: bool, tmp_path: Path) -> None:
    made = stand(tmp_path)
    made.issue("a")
    done = [records.RevocationRecord(common_name="iqua-a", reason="lost")] if is_revoked else []
    with Ledger(made.folder / "ledger.jsonl") as ledger:
        ledger.write([records.BeginRecord(command="revoke", names=("iqua-a",)), *done], "me", "op", datetime.now(UTC))
    with made.signing():
        pass
    end = records.CommitRecord() if is_revoked else records.RolledBack(common_names=())
    assert [entry.record for entry in made.authority.history() if entry.operation == "op"][-1] == end


def test_certificate_missing_from_the_ledger_is_reported(tmp_path: Path) -> None:
    made = stand(tmp_path)
    key = pki.new_key(KeyType.EC)
    stray = pki.new_client(made.ca, key.public_key(), "stray", pki.new_serial(), 10, NOW)
    (made.folder / "certs").mkdir(exist_ok=True)
    (made.folder / "certs" / "stray.pem").write_text(pki.cert_pem(stray))
    assert made.authority.check() == [
        "certs/stray.pem is not in the record: it was not issued here, or the ledger is an old copy"
    ]


def test_damaged_ledger_blocks_signing(tmp_path: Path) -> None:
    made = stand(tmp_path)
    made.issue("a")
    path = made.folder / "ledger.jsonl"
    data = path.read_bytes()
    path.write_bytes(data.replace(b"10.8.16.1", b"10.8.16.9"))
    before = (made.folder / "crl.pem").read_bytes()
    refused = pytest.raises(CorruptLedgerError, match=r"line 5 of the ledger is damaged: its checksum is wrong")
    with refused as damaged, made.signing():
        pass
    assert damaged.value.exit is ExitCode.FAILED
    assert (made.folder / "crl.pem").read_bytes() == before
    problems = made.authority.check()
    assert problems[0].startswith("line 5 of the ledger is damaged: its checksum is wrong")


def test_expiry_warnings_are_given_in_time(tmp_path: Path) -> None:
    made = stand(tmp_path)
    made.issue("a")
    days = {days: " | ".join(made.authority.check(NOW + timedelta(days=days))) for days in (59, 61, 100, 370, 400)}
    assert days[59] == ""
    assert days[61].startswith("crl.pem expires on ")
    assert "crl.pem would lock everybody out, or admit revoked members" in days[100]
    assert "it expired on" in days[100]
    assert "iqua-a ends on" in days[370]
    assert "iqua-a ended on" in days[400]
    late = " | ".join(made.authority.check(NOW + timedelta(days=3651)))
    assert "the certificate authority expires on" in late
    assert "the server's certificate expires on" in late


def test_file_readable_by_others_is_reported(tmp_path: Path) -> None:
    made = stand(tmp_path)
    (made.folder / "server" / "server.key").chmod(0o644)
    (problem,) = made.authority.check()
    assert problem.endswith(f"server.key can be read by others: chmod go= {made.folder}/server/server.key")


def test_ageing_revocation_list_is_re_signed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    made = stand(tmp_path)
    for days, number in ((29, 1), (31, 2), (32, 2)):
        at(monkeypatch, NOW + timedelta(days=days))
        with made.signing() as signer:
            assert signer.membership.crl_number == number


def at(monkeypatch: pytest.MonkeyPatch, moment: datetime) -> None:
    monkeypatch.setattr(ledger_session, "utc_now", lambda: moment)


def signed(made: Stand) -> datetime:
    with made.signing() as signer:
        facts = pki.check_crl(signer.publish(), made.ca.certificate, above=None, now=signer._session.ledger.now())
    return facts.this_update


def test_clock_behind_the_ledger_blocks_signing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    made = stand(tmp_path)
    made.issue("a")
    before = (made.folder / "ledger.jsonl").read_bytes()
    for moment in (datetime(2000, 1, 1, tzinfo=UTC), NOW - timedelta(hours=13), NOW - timedelta(minutes=5)):
        at(monkeypatch, moment)
        with pytest.raises(ClockBehind, match=f"the clock of this computer says {moment:%Y-%m-%d %H:%M} UTC") as behind:
            signed(made)
        assert "set the clock" in str(behind.value.hint)
        assert behind.value.exit is ExitCode.FAILED
    assert (made.folder / "ledger.jsonl").read_bytes() == before
    assert made.authority.check() == []


def test_small_clock_step_back_is_tolerated(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    made = stand(tmp_path)
    made.issue("a")
    last = made.authority.history()[-1].at
    at(monkeypatch, last - timedelta(seconds=90))
    signed(made)
    assert made.authority.history()[-1].at == last
    assert made.authority.check() == []


def test_confirmation_resets_a_clock_that_was_ahead(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    made = stand(tmp_path)
    with monkeypatch.context() as patch:
        at(patch, NOW + timedelta(days=300))
        ahead = signed(made)
    with pytest.raises(ClockBehind):
        signed(made)
    with made.signing(trust_clock=True) as signer:
        # The list of the wrong clock is not valid yet, and would lock everybody out: there is a new one already.
        assert signer.membership.crl_number == 4
        signer.issue([wish("a")], made.deliver)
    with made.signing():
        pass
    assert signed(made) < ahead
    assert made.authority.check() == []
    assert any("the clock was confirmed as right" in entry.words for entry in made.authority.history())
