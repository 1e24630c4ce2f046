"""The VPN server is asked over a satellite that carries nothing: what is led, what is believed, and what it costs."""

import hmac
from dataclasses import dataclass, field
from hashlib import sha256
from ipaddress import IPv4Address
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest
from proving_router import LAPTOP, Fake
from test_proving import DECLARED, SATELLITE, prove, proving, told

from atlantis_netcfg.core.errors import NetcfgError, NoMatchError, UsageError
from atlantis_netcfg.links.qualify.transport import Arrival
from atlantis_netcfg.operations.allow_list_test import vpn
from atlantis_netcfg.operations.allow_list_test.plan import BUDGET_BYTES, VPN_BYTES
from atlantis_netcfg.operations.allow_list_test.prove import Proof
from atlantis_netcfg.operations.allow_list_test.site import previews
from atlantis_netcfg.operations.common.request import Request
from atlantis_netcfg.runs import Store
from atlantis_netcfg.vpn import pki
from atlantis_netcfg.vpn.enrolment_package.profile import identity_file
from atlantis_netcfg.vpn.pki.keys import FirstPacket, _client_bytes, _ctr
from atlantis_netcfg.vpn.rehearsal import rehearsed_identity

SERVER = "203.0.113.2 udp 1194"
ROUTER = DECLARED.hosts["coastal-router"]


def answer_to(packet: FirstPacket) -> bytes:
    """What a server with the same key makes of a first packet."""
    keys, _ = _client_bytes(packet.wrap_key)
    head, plain = bytes([8 << 3]) + bytes(16), bytes([1]) + bytes(4) + packet.session + bytes(4)
    tag = hmac.digest(keys[64:96], head + plain, sha256)
    return head + tag + _ctr(keys[:32], tag, plain)


@dataclass
class Line:
    """Stands for the socket of this computer; `answers` comes once as many questions were sent as it says."""

    answer: bytes = b""
    after: int = 1
    sent: list[bytes] = field(default_factory=list)
    at_ns: int = 0

    def now_ns(self) -> int:
        return self.at_ns

    def send(self, datagram: bytes) -> str:
        self.sent.append(datagram)
        return ""

    def receive(self, until_ns: int) -> Arrival | None:
        if self.answer and len(self.sent) >= self.after:
            self.at_ns += 700_000_000
            return Arrival(self.answer, self.at_ns) if self.at_ns <= until_ns else None
        self.at_ns = max(self.at_ns, until_ns)
        return None


def asked(router: Fake, line: Line, packet: FirstPacket | None = None, window_s: float = 90.0) -> Proof:
    what = proving(try_all=True, window_s=window_s)
    what.vpn = vpn.VpnQuestion(LAPTOP, cast("Any", line), packet or FirstPacket(pki.shared_key()))
    return prove(router, what)


def test_server_replies_over_the_satellite_and_no_row_remains() -> None:
    packet = FirstPacket(pki.client_key(pki.server_key(), b"cn=coastal-router"))
    router = Fake()
    proof = asked(router, Line(answer_to(packet)), packet)
    assert told(proof)[SERVER] == ("answered", "PASS")
    assert proof.vpn_answered
    (attempt,) = [one for one, _ in proof.results if one.target == SERVER]
    assert attempt.after_s == pytest.approx(0.7)
    ways = [dict(command.arguments) for command in router.sent if command.path == "/routing/rule/add"]
    # The tunnels of the site, which have other senders, stay where they are.
    assert {
        "action": "lookup-only-in-table",
        "comment": "atlantis: for a proof, taken back after it",
        "src-address": f"{LAPTOP}/32",
        "dst-address": "203.0.113.2/32",
        "table": "via-satellite",
        "place-before": "*A",
    } in ways
    assert (router.rows, router.held) == ([], False)


def test_probe_outlasts_a_gap_of_the_link() -> None:
    packet = FirstPacket(pki.shared_key())
    line = Line(answer_to(packet), after=6)
    proof = asked(Fake(), line, packet)
    assert told(proof)[SERVER] == ("answered", "PASS")
    assert len(line.sent) == 6
    (attempt,) = [one for one, _ in proof.results if one.target == SERVER]
    assert attempt.after_s == pytest.approx(75.7)


def test_silence_counts_after_six_requests() -> None:
    line = Line()
    proof = asked(Fake(vpn_counts=(True, False)), line)
    assert told(proof)[SERVER] == ("silent", "FAIL")
    assert (len(line.sent), proof.vpn_answered) == (6, False)
    assert told(asked(Fake(vpn_counts=(True, False)), Line(), window_s=45.0))[SERVER] == ("silent", "INCONCLUSIVE")


@pytest.mark.parametrize("counts", [(False, True), (True, False), (False, False)])
def test_reply_not_counted_over_the_satellite_proves_nothing(counts: tuple[bool, bool]) -> None:
    packet = FirstPacket(pki.shared_key())
    proof = asked(Fake(vpn_counts=counts), Line(answer_to(packet)), packet)
    assert told(proof)[SERVER] == ("not tested", "INCONCLUSIVE")
    assert "it responded, but the router counted no traffic to it over the satellite" in proof.as_text()
    assert not proof.vpn_answered


def test_reply_with_another_key_is_rejected() -> None:
    packet = FirstPacket(pki.shared_key())
    proof = asked(Fake(), Line(answer_to(FirstPacket(pki.shared_key(), packet.session))), packet)
    assert told(proof)[SERVER] == ("silent", "FAIL")
    assert not proof.vpn_answered


def test_no_probe_is_sent_while_satellite_carries_the_tunnel() -> None:
    line = Line()
    packet = FirstPacket(pki.shared_key())
    proof = asked(Fake(active=True, counts_after=3, tells_time=True), line, packet)
    assert told(proof)[SERVER] == ("answered", "PASS")
    assert (line.sent, proof.vpn_answered) == ([], False)


def test_obstacle_is_reported_with_a_hint() -> None:
    what = proving(try_all=True)
    what.vpn = UsageError("this computer stands elsewhere", hint="plug it in")
    (found,) = [finding for attempt, finding in prove(Fake(), what).results if attempt.target == SERVER]
    assert (found.message, found.hint) == (
        f"VPN server ({SERVER}) could not be tested: this computer stands elsewhere",
        "plug it in",
    )


def test_vpn_probe_is_priced_and_within_the_budget() -> None:
    without, asking = proving(), proving(try_all=True)
    assert asking.expected_bytes - without.expected_bytes > VPN_BYTES
    (_, satellite) = previews(DECLARED, asking)
    assert satellite.bill.payload_bytes == asking.expected_bytes <= BUDGET_BYTES


def trial(folder: Path, twins: object = None) -> vpn.VpnQuestion | NetcfgError:
    with vpn.vpn_trial(DECLARED, ROUTER, SATELLITE.link, Request(state=folder), cast("Any", twins)) as made:
        return made


def test_missing_member_identity_is_reported(tmp_path: Path) -> None:
    made = trial(tmp_path)
    assert isinstance(made, UsageError)
    assert str(made) == "there is no identity of coastal-router on this computer"


def test_computer_outside_the_site_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    hosts = tmp_path / "vpn" / "hosts"
    hosts.mkdir(parents=True)
    (hosts / "coastal-router.identity").write_text(identity_file(rehearsed_identity(DECLARED, ROUTER)).reveal())
    elsewhere = "atlantis_netcfg.operations.qualify.far_end._address_towards"
    monkeypatch.setattr(elsewhere, lambda *_: IPv4Address("192.0.2.9"))
    made = trial(tmp_path)
    assert isinstance(made, UsageError)
    assert "but the router forwards only packets from networks of `coastal`" in str(made)


def test_rehearsal_without_openvpn_is_reported_as_not_rehearsed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("shutil.which", lambda *_, **__: None)
    made = trial(tmp_path, SimpleNamespace(replay=None))
    assert isinstance(made, NoMatchError)
    assert str(made) == "not rehearsed: OpenVPN is not installed on this computer"


def test_proof_is_stored_per_link_and_damaged_file_is_ignored(tmp_path: Path) -> None:
    store = Store(tmp_path)
    assert store.proof("coastal", "satellite") is None
    store.keep_proof("coastal", "satellite")
    assert store.proof("coastal", "satellite") is not None
    assert (store.proof("coastal", "4g"), Store(tmp_path, is_rehearsal=True).proof("coastal", "satellite")) == (
        None,
        None,
    )
    for damage in (b"", b"\xff", b"yesterday"):
        (tmp_path / "real" / "coastal" / "proofs" / "satellite").write_bytes(damage)
        assert store.proof("coastal", "satellite") is None
