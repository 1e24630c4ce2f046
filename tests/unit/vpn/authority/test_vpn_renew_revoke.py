"""Successors that overlap, revocations that are on the list, and what the server saw."""

from datetime import UTC, datetime, timedelta
from ipaddress import IPv4Address
from pathlib import Path

import pytest
from authority_stand import Stand, stand
from hypothesis import given
from hypothesis import strategies as st

from atlantis_netcfg.core.errors import UsageError
from atlantis_netcfg.vpn import pki
from atlantis_netcfg.vpn.authority.model import EnrolmentFile, NoSuchMember, RenewalRequest, SessionObservation
from atlantis_netcfg.vpn.identity import CertificateStatus, KeyType, MemberKind, MemberLink, Wrap
from atlantis_netcfg.vpn.ledger import LedgerEntry, LedgerState, records

NOW = datetime.now(UTC)


def standings(made: Stand, name: str) -> dict[str, str]:
    return {one.common_name: one.standing.value for one in made.authority.membership().members[name].certificates}


def on_list(made: Stand) -> set[str]:
    facts = pki.check_crl(made.authority.crl(), made.ca.certificate, above=None, now=datetime.now(UTC))
    return {one.common_name for _, one in made.authority.membership().certificates() if one.serial in facts.serials}


def test_successor_replaces_its_predecessor_once_seen(tmp_path: Path) -> None:
    made = stand(tmp_path)
    made.issue("a")
    assert made.authority.record_sessions({"iqua-a": NOW}) == SessionObservation((), (), ())
    with made.signing() as signer:
        renewed = signer.renew("iqua-a", made.deliver)
    assert renewed.certificate.common_name == "iqua-a.2"
    assert renewed.member.address == made.identities[0].member.address
    assert standings(made, "iqua-a") == {"iqua-a": "seen", "iqua-a.2": "issued"}
    assert made.authority.record_sessions({"iqua-a": NOW, "iqua-a.2": NOW, "nobody": NOW}) == SessionObservation(
        ("iqua-a",), ("nobody",), ()
    )
    assert standings(made, "iqua-a") == {"iqua-a": "superseded", "iqua-a.2": "seen"}
    assert on_list(made) == set()
    with made.signing() as signer:
        signer.publish()
    assert standings(made, "iqua-a") == {"iqua-a": "revoked", "iqua-a.2": "seen"}
    assert on_list(made) == {"iqua-a"}
    assert made.authority.membership().queued_names == ("iqua-a",)
    later = {"iqua-a": datetime.now(UTC) + timedelta(hours=1)}
    assert made.authority.record_sessions(later).withdrawn == ("iqua-a",)


def test_a_successor_that_was_never_seen_is_replaced(tmp_path: Path) -> None:
    made = stand(tmp_path)
    made.issue("a")
    for number in (2, 3, 4):
        with made.signing() as signer:
            renewed = signer.renew("iqua-a", made.deliver)
        assert renewed.replaced_names == (() if number == 2 else (f"iqua-a.{number - 1}",))
        assert [one.common_name for one in renewed.member.good] == ["iqua-a", f"iqua-a.{number}"]
    assert on_list(made) == {"iqua-a.2", "iqua-a.3"}
    assert made.authority.membership().queued_names == ("iqua-a.2", "iqua-a.3")


def test_renewal_applies_the_requested_changes(tmp_path: Path) -> None:
    made = stand(tmp_path)
    made.issue("a")
    change = RenewalRequest(days=10, wrap=Wrap.TLS_CRYPT, key=KeyType.RSA, link=MemberLink.LTE)
    with made.signing() as signer:
        renewed = signer.renew("iqua-a", made.deliver, change)
    assert (renewed.member.link, renewed.certificate.wrap, renewed.certificate.key) == (
        MemberLink.LTE,
        Wrap.TLS_CRYPT,
        KeyType.RSA,
    )
    assert made.identities[1].wrap_key.reveal() == (made.folder / "server" / "tls-crypt.key").read_text()
    with made.signing() as signer:
        assert signer.renew("iqua-a", made.deliver).certificate.wrap is Wrap.TLS_CRYPT


def test_a_renewal_that_failed_changes_nothing(tmp_path: Path) -> None:
    made = stand(tmp_path)
    made.issue("a")

    def fail(_: object) -> EnrolmentFile:
        raise OSError(28, "No space left on device")

    with made.signing() as signer, pytest.raises(Exception, match="No space left"):
        signer.renew("iqua-a", fail, RenewalRequest(link=MemberLink.LTE))
    member = made.authority.membership().members["iqua-a"]
    assert (member.link, [one.common_name for one in member.good]) == (MemberLink.FIBRE, ["iqua-a"])
    assert on_list(made) == {"iqua-a.2"}
    with made.signing() as signer:
        assert signer.renew("iqua-a", made.deliver).certificate.common_name == "iqua-a.3"


def test_revocation_covers_all_certificates_and_can_be_repeated(tmp_path: Path) -> None:
    made = stand(tmp_path)
    made.issue("a", "b", "c")
    with made.signing() as signer:
        signer.renew("iqua-a", made.deliver)
        number = signer.membership.crl_number
        first = signer.revoke(["iqua-a", "iqua-b", "iqua-a"], "lost at sea")
        again = signer.revoke(["iqua-a", "iqua-b"], "once more")
    assert first.common_names == again.common_names == ("iqua-a", "iqua-a.2", "iqua-b")
    assert first.members == again.members == ("iqua-a", "iqua-b")
    assert (first.already, again.already) == ((), ("iqua-a", "iqua-b"))
    assert first.crl == again.crl == made.authority.crl()
    membership = made.authority.membership()
    assert membership.crl_number == number + 1
    assert membership.queued_names == first.common_names
    assert {one.reason for one in membership.members["iqua-a"].certificates} == {"lost at sea"}
    assert on_list(made) == set(first.common_names)
    made.authority.confirm_revocations(["iqua-a", "iqua-a.2", "iqua-c", "nobody"])
    assert made.authority.membership().queued_names == ("iqua-b",)
    assert made.authority.check() == []


def test_a_revoked_member_is_not_renewed(tmp_path: Path) -> None:
    made = stand(tmp_path)
    made.issue("sparus2")
    with made.signing() as signer:
        signer.revoke(["iqua-sparus2"], "")
        with pytest.raises(UsageError, match="`iqua-sparus2` was revoked: it cannot get a new certificate"):
            signer.renew("iqua-sparus2", made.deliver)
        with pytest.raises(NoSuchMember, match="the record has no member `iqua-sparus`") as unknown:
            signer.revoke(["iqua-sparus"], "lost")
        assert unknown.value.hint == "did you mean `iqua-sparus2`?"
        for reason in ("a\nb", "\x1b[2J", "x" * 300):
            with pytest.raises(UsageError, match="the reason must be a short text on one line"):
                signer.revoke(["iqua-sparus2"], reason)
        with pytest.raises(UsageError, match="no member to revoke was given"):
            signer.revoke([], "lost")


def test_sightings_are_recorded_once_a_day(tmp_path: Path) -> None:
    made = stand(tmp_path)
    made.issue("a")
    made.authority.record_sessions({"iqua-a": NOW})
    before = (made.folder / "ledger.jsonl").read_bytes()
    made.authority.record_sessions({"iqua-a": NOW + timedelta(hours=23), "nobody": NOW})
    made.authority.record_sessions({})
    assert (made.folder / "ledger.jsonl").read_bytes() == before
    made.authority.record_sessions({"iqua-a": NOW + timedelta(hours=24)})
    (certificate,) = made.authority.membership().members["iqua-a"].certificates
    assert (certificate.standing, certificate.seen) == (
        CertificateStatus.SEEN,
        NOW.replace(tzinfo=UTC) + timedelta(hours=24),
    )


KNOWN = ("iqua-a", "iqua-b")
AFTER = st.sampled_from(KNOWN).flatmap(
    lambda name: st.sampled_from(
        (
            records.DeliveryRecord(common_name=name, path="x", sha256="00"),
            records.SightingRecord(common_name=name, last=NOW),
            records.SupersedeRecord(common_name=name, by="other"),
            records.RevocationRecord(common_name=name, reason="lost"),
            records.RolledBack(common_names=(name,)),
            records.SettlementRecord(common_name=name),
        )
    )
)


@given(st.lists(AFTER, max_size=12))
def test_revoked_certificate_never_becomes_valid_again(after: list[records.Record]) -> None:
    fold = LedgerState(LedgerEntry(number, NOW, "me", "op", issued(name)) for number, name in enumerate(KNOWN, start=1))
    withdrawn: set[str] = set()
    for record in after:
        fold.apply(LedgerEntry(9, NOW, "me", "op", record))
        if isinstance(record, records.RevocationRecord):
            withdrawn.add(record.common_name)
        if isinstance(record, records.RolledBack):
            withdrawn.update(set(record.common_names) - fold.delivered.keys())
        good = {one.common_name for _, one in fold.membership().certificates() if one.good}
        assert good <= fold.delivered.keys() - withdrawn


def issued(name: str) -> records.IssueRecord:
    return records.IssueRecord(
        name=name,
        device_kind=MemberKind.ROBOT,
        partner="iqua",
        device=name[5:],
        address=IPv4Address("10.8.16.1"),
        link=MemberLink.LTE,
        vehicle=None,
        common_name=name,
        serial=ord(name[-1]),
        sha256=name,
        not_before=NOW,
        not_after=NOW,
        wrap=Wrap.TLS_CRYPT_V2,
        key=KeyType.EC,
        der="",
    )
