"""Members are made: recorded first, handed out once, all checked before the first."""

import json
import os
from dataclasses import replace
from ipaddress import IPv4Address, IPv4Network
from pathlib import Path
from typing import Any

import pytest
from authority_stand import POOL, Stand, stand, wish
from cryptography import x509

from atlantis_netcfg.core.errors import NetcfgError, UsageError
from atlantis_netcfg.vpn.authority.model import (
    AddressTaken,
    AuthorityError,
    EnrolmentFile,
    EnrolmentRequest,
    OtherMember,
    PoolFull,
)
from atlantis_netcfg.vpn.identity import CertificateStatus, Identity, KeyType, MemberKind, MemberLink, Wrap
from atlantis_netcfg.vpn.ledger import NEVER_HANDED_OUT
from atlantis_netcfg.vpn.names import NameTaken


def test_issued_member_and_certificate_have_the_requested_values(tmp_path: Path) -> None:
    made = stand(tmp_path)
    asked = wish("sparus2", link=MemberLink.SATELLITE, vehicle="sparus", days=60, request_id="r1")
    with made.signing() as signer:
        (issued,) = signer.issue([asked], made.deliver)
    (identity,) = made.identities
    certificate = x509.load_pem_x509_certificate(identity.cert.encode())
    assert certificate.subject.rfc4514_string() == "CN=iqua-sparus2"
    assert certificate.serial_number == issued.certificate.serial
    assert (certificate.not_valid_after_utc - certificate.not_valid_before_utc).days == 61
    assert identity.ca == (made.folder / "ca.crt").read_text()
    assert identity.cert == (made.folder / "certs" / "iqua-sparus2.pem").read_text()
    assert identity.member == issued.member == made.authority.membership().members["iqua-sparus2"]
    assert (issued.member.kind, issued.member.link, issued.member.vehicle) == (
        MemberKind.ROBOT,
        MemberLink.SATELLITE,
        "sparus",
    )
    assert issued.certificate.standing is CertificateStatus.ISSUED
    assert not issued.already
    assert made.authority.check() == []


def test_certificate_is_recorded_before_delivery(tmp_path: Path) -> None:
    made = stand(tmp_path)

    def deliver(identity: Identity) -> EnrolmentFile:
        lines = [json.loads(line) for line in (made.folder / "ledger.jsonl").read_text().splitlines()]
        mine = next(line for line in lines if line.get("common_name") == identity.certificate.common_name)
        assert int(mine["serial"], 16) == identity.certificate.serial
        assert mine["sha256"] == identity.certificate.sha256
        seen_by_others = made.authority.membership().members[identity.member.name]
        assert [one.reason for one in seen_by_others.certificates] == [NEVER_HANDED_OUT]
        assert seen_by_others.good == ()
        return made.deliver(identity)

    with made.signing() as signer:
        signer.issue([wish("a"), wish("b")], deliver)
    assert len(made.identities) == 2


def test_repeated_request_issues_nothing(tmp_path: Path) -> None:
    made = stand(tmp_path)
    made.issue("a")
    before = (made.folder / "ledger.jsonl").read_bytes()
    with made.signing() as signer:
        again, new = signer.issue([wish("a"), wish("b")], made.deliver)
    assert (again.already, new.already) == (True, False)
    assert again.file.path.endswith("iqua-a/member.txt")
    assert [one.member.name for one in made.identities] == ["iqua-a", "iqua-b"]
    after = (made.folder / "ledger.jsonl").read_bytes()
    assert after.startswith(before)
    with made.signing() as signer:
        assert all(one.already for one in signer.issue([wish("a"), wish("b")], made.deliver))
    assert (made.folder / "ledger.jsonl").read_bytes() == after


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"kind": MemberKind.LAPTOP}, "kind is robot, not laptop"),
        ({"link": MemberLink.LTE}, "link is fibre, not 4g"),
        ({"vehicle": "sparus"}, "vehicle is none, not sparus"),
        ({"wrap": Wrap.TLS_CRYPT}, "wrap is tls-crypt-v2, not tls-crypt"),
        ({"key": KeyType.RSA}, "key is ec, not rsa"),
        ({"address": POOL[9]}, r"address is 10.8.16.1, not 10.8.16.9"),
    ],
)
def test_different_request_for_the_same_name_reports_the_difference(
    change: dict[str, Any], said: str, tmp_path: Path
) -> None:
    made = stand(tmp_path)
    made.issue("a")
    with made.signing() as signer, pytest.raises(OtherMember, match=said) as other:
        signer.issue([wish("a", **change)], made.deliver)
    assert "provision vpn renew name=iqua-a" in str(other.value.hint)


def test_batch_with_one_invalid_request_issues_nothing(tmp_path: Path) -> None:
    made = stand(tmp_path)
    before = (made.folder / "ledger.jsonl").read_bytes()
    with made.signing() as signer:
        for wrong in (
            [wish("a"), wish("a")],
            [wish("a"), replace(wish("b"), device="c")],
            [wish("a"), EnrolmentRequest("iqua-b", MemberKind.ROBOT, "iqua", "b")],
            [wish("a"), wish("b", vehicle="a\x1bb")],
            [wish("a"), wish("b", request_id="x" * 500)],
        ):
            with pytest.raises(UsageError):
                signer.issue(wrong, made.deliver)
    assert (made.folder / "ledger.jsonl").read_bytes() == before
    assert made.identities == []


def test_revoked_names_are_never_reused(tmp_path: Path) -> None:
    made = stand(tmp_path)
    made.issue("a")
    with made.signing() as signer:
        signer.revoke(["iqua-a"], "sold")
        with pytest.raises(NameTaken, match=r"`iqua-a` was revoked: sold. Names cannot be used again") as taken:
            signer.issue([wish("a")], made.deliver)
    assert taken.value.hint == "for example device=a-2"


def failing(made: Stand, name: str, error: Exception) -> None:
    def deliver(identity: Identity) -> EnrolmentFile:
        delivered = made.deliver(identity)
        if identity.member.name == name:
            raise error
        return delivered

    with made.signing() as signer:
        signer.issue([wish("a"), wish("b"), wish("c")], deliver)


def test_undelivered_certificate_is_revoked_and_reissued(tmp_path: Path) -> None:
    made = stand(tmp_path)
    with pytest.raises(AuthorityError, match="the enrolment package of `iqua-b` cannot be written: disk on fire"):
        failing(made, "iqua-b", OSError(5, "disk on fire"))
    membership = made.authority.membership()
    assert [len(membership.members[f"iqua-{name}"].good) for name in "abc"] == [1, 0, 0]
    assert made.authority.check() == []
    assert membership.queued_names == ()
    made.issue("a", "b", "c")
    membership = made.authority.membership()
    assert [one.good[0].common_name for one in membership.members.values()] == ["iqua-a", "iqua-b.2", "iqua-c.2"]
    assert [str(one.address) for one in membership.members.values()] == ["10.8.16.1", "10.8.16.2", "10.8.16.3"]
    told = [entry.words for entry in made.authority.history()]
    assert any("iqua-b, iqua-c was never handed out and is revoked" in words for words in told)


def test_delivery_error_is_passed_through(tmp_path: Path) -> None:
    made = stand(tmp_path)
    with pytest.raises(NetcfgError, match="no such recipient"):
        failing(made, "iqua-a", NetcfgError("no such recipient"))
    assert made.authority.check() == []


def test_undelivered_member_may_be_requested_differently(tmp_path: Path) -> None:
    made = stand(tmp_path)
    with pytest.raises(ZeroDivisionError):
        failing(made, "iqua-a", ZeroDivisionError())
    with made.signing() as signer:
        asked = wish("a", kind=MemberKind.LAPTOP, address=POOL[9])
        (issued,) = signer.issue([asked], made.deliver)
        assert (issued.member.kind, str(issued.member.address)) == (MemberKind.LAPTOP, "10.8.16.9")
        signer.revoke(["iqua-b"], "not needed after all")
        with pytest.raises(NameTaken, match="not needed after all"):
            signer.issue([wish("b")], made.deliver)


def test_large_batch_syncs_the_ledger_rarely(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    made = stand(tmp_path)
    synced: list[str] = []
    sync = os.fsync

    def counted(descriptor: int) -> None:
        synced.append(Path(f"/proc/self/fd/{descriptor}").readlink().name)
        sync(descriptor)

    with made.signing() as signer, monkeypatch.context() as patch:
        patch.setattr(os, "fsync", counted)
        issued = signer.issue([wish(f"d{number}") for number in range(220)], made.deliver)
    assert len({one.member.address for one in issued}) == 220
    assert synced.count("ledger.jsonl") == 9, "two for each hundred, and begin, list, end"
    assert made.authority.check() == []


def test_interrupted_batch_keeps_what_was_delivered(tmp_path: Path) -> None:
    made = stand(tmp_path)
    wishes = [wish(f"d{number}") for number in range(120)]

    def deliver(identity: Identity) -> EnrolmentFile:
        if identity.member.device == "d110":
            raise OSError(28, "No space left on device")
        return made.deliver(identity)

    with (
        made.signing() as signer,
        pytest.raises(AuthorityError, match="the enrolment package of `iqua-d110` cannot be written"),
    ):
        signer.issue(wishes, deliver)
    assert sum(1 for one in made.authority.membership().members.values() if one.good) == 110
    assert made.authority.check() == []
    with made.signing() as signer:
        issued = signer.issue(wishes, made.deliver)
    assert [one.already for one in issued] == [True] * 110 + [False] * 10
    assert len({one.member.address for one in issued}) == 120
    assert len(made.identities) == 120


# Which address a member gets.


FOUR = IPv4Network("10.8.16.0/29")


def test_first_and_last_pool_addresses_are_not_assigned(tmp_path: Path) -> None:
    made = stand(tmp_path)
    with made.signing() as signer:
        issued = signer.issue([wish(f"d{number}", pool=FOUR) for number in range(6)], made.deliver)
        assert [str(one.member.address) for one in issued] == [f"10.8.16.{number}" for number in range(1, 7)]
        with pytest.raises(PoolFull, match=r"no address is left for `iqua-d6` in 10.8.16.0/29"):
            signer.issue([wish("d6", pool=FOUR)], made.deliver)
        for end in ("10.8.16.0", "10.8.16.7", "10.8.16.8"):
            with pytest.raises(AddressTaken, match="` is not a device address in"):
                signer.issue([wish("d6", pool=FOUR, address=IPv4Address(end))], made.deliver)


def test_reserved_and_declared_addresses_are_not_given_away(tmp_path: Path) -> None:
    made = stand(tmp_path)
    declared = wish("c", pool=FOUR, address=IPv4Address("10.8.16.2"))
    with made.signing() as signer:
        issued = signer.issue(
            [wish("a", pool=FOUR), wish("b", pool=FOUR), declared],
            made.deliver,
            reserved_addresses=[IPv4Address("10.8.16.1")],
        )
        assert [str(one.member.address) for one in issued] == ["10.8.16.3", "10.8.16.4", "10.8.16.2"]
        with pytest.raises(AddressTaken, match=r"10.8.16.3 of `iqua-d` is in use by `iqua-a`"):
            signer.issue([wish("d", address=IPv4Address("10.8.16.3"))], made.deliver)
        twice = [wish(name, address=IPv4Address("10.8.16.6")) for name in ("d", "e")]
        with pytest.raises(AddressTaken, match=r"10.8.16.6 of `iqua-e` is in use by `iqua-d`"):
            signer.issue(twice, made.deliver)
    assert len(made.identities) == 3


def test_address_is_reused_only_if_pool_is_full_and_revocation_confirmed(tmp_path: Path) -> None:
    made = stand(tmp_path)
    pool = IPv4Network("10.8.16.0/30")
    with made.signing() as signer:
        signer.issue([wish("a", pool=pool)], made.deliver)
        signer.revoke(["iqua-a"], "lost")
        assert str(signer.issue([wish("b", pool=pool)], made.deliver)[0].member.address) == "10.8.16.2"
        with pytest.raises(PoolFull):
            signer.issue([wish("c", pool=pool)], made.deliver)
        with pytest.raises(AddressTaken, match="in use by `iqua-a`"):
            signer.issue([wish("c", address=IPv4Address("10.8.16.1"))], made.deliver)
    made.authority.confirm_revocations(["iqua-a"])
    with made.signing() as signer:
        assert str(signer.issue([wish("c", pool=pool)], made.deliver)[0].member.address) == "10.8.16.1"
        with pytest.raises(PoolFull):
            signer.issue([wish("d", pool=pool)], made.deliver)


@pytest.mark.parametrize(("pool", "count"), [("10.8.16.4/31", 2), ("10.8.16.4/32", 1)])
def test_pools_without_end_addresses_are_used_fully(pool: str, count: int, tmp_path: Path) -> None:
    made = stand(tmp_path)
    with made.signing() as signer:
        wishes = [wish(f"d{number}", pool=IPv4Network(pool)) for number in range(count)]
        issued = signer.issue(wishes, made.deliver)
        assert str(issued[0].member.address) == "10.8.16.4"
        with pytest.raises(PoolFull):
            signer.issue([wish("more", pool=IPv4Network(pool))], made.deliver)
