"""What a proof asks, when it stops, and what it concludes."""

import asyncio
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, cast

import pytest
from proving_router import Fake

from atlantis_netcfg.core.errors import DeviceError, ExitCode, OutcomeUnknown, UsageError
from atlantis_netcfg.core.events import Verdict
from atlantis_netcfg.inventory import load
from atlantis_netcfg.inventory.model import AllowedTarget, Link
from atlantis_netcfg.links import LinkFinding
from atlantis_netcfg.links.satellite import ExpectedOutcome, ProbeOutcome, SatelliteProbe
from atlantis_netcfg.operations.allow_list_test.plan import BUDGET_BYTES, NothingToProve, resolve, tasks
from atlantis_netcfg.operations.allow_list_test.prove import Proof, ProofPace, Proving
from atlantis_netcfg.operations.allow_list_test.site import bills, previews, satellite_of
from atlantis_netcfg.routeros.estimate import on_the_wire

if TYPE_CHECKING:
    from collections.abc import Sequence

    from atlantis_netcfg.routeros.api import Command, Reply, Session

DECLARED = load(Path(__file__).parents[4] / "inventory")
SATELLITE = satellite_of(DECLARED, "coastal", None)
ADDED, STRANGER = "192.0.2.50", "203.0.113.3"


async def no_wait(_seconds: float) -> None:
    """The seconds are counted, not spent."""


def bearer() -> Link:
    """The satellite of coastal with one host that a person has added."""
    added = AllowedTarget.model_validate({"name": "weather", "address": ADDED})
    return SATELLITE.link.model_copy(update={"allow": (added,)})


def proving(
    *, open_filter: bool = False, try_all: bool = False, link: Link | None = None, window_s: float = 90.0
) -> Proving:
    made = SATELLITE.proving(DECLARED, open_filter=open_filter, try_all=try_all, is_rehearsal=True)
    made.link = link or bearer()
    made.pace = ProofPace(window_s=window_s, sleep=no_wait)
    return made


def prove(router: Fake, what: Proving | None = None) -> Proof:
    return asyncio.run((what or proving()).run(cast("Session", router)))


def told(proof: Proof) -> dict[str, tuple[str, str]]:
    """Outcome and verdict by target; with the filter open, under the target's name and `open`."""
    return {
        f"{attempt.target}{' open' if attempt.filter_open else ''}": (attempt.outcome.value, finding.verdict.value)
        for attempt, finding in proof.results
    }


def test_allowed_host_answers_after_a_gap_and_other_host_is_refused() -> None:
    router = Fake(beyond={ADDED: 14})
    proof = prove(router)
    found = told(proof)
    assert found[ADDED] == ("answered", "PASS")
    assert found[STRANGER] == ("refused here", "PASS")
    (attempt,) = [one for one, _ in proof.results if one.target == ADDED]
    assert attempt.after_s == 70
    assert proof.exit is ExitCode.CHECKS_FAILED, "four targets could not be tried"
    assert proof.kept_off == 7 + 3
    assert proof.bytes_counted == 15 * 84 + 84


def test_untestable_targets_are_reported_as_not_tried() -> None:
    found = told(prove(Fake(beyond={ADDED: 0})))
    assert found["203.0.113.2 udp 1194"] == ("not tested", "INCONCLUSIVE")
    assert found["203.0.113.2 tcp 1195"] == ("not tested", "INCONCLUSIVE")
    assert len(found) == 6


def test_proof_of_every_target_exits_with_done() -> None:
    only = SATELLITE.link.model_copy(update={"refused_probes": ()})
    router = Fake(active=True, counts_after=3, tells_time=True, tells_both=True)
    proof = prove(router, proving(try_all=True, link=only))
    assert {verdict for _, verdict in told(proof).values()} == {"PASS"}
    assert proof.exit is ExitCode.DONE


@pytest.mark.parametrize(
    ("verdict", "code"), [(Verdict.WARN, 0), (Verdict.INCONCLUSIVE, 6), (Verdict.FAIL, 6), (Verdict.ERROR, 6)]
)
def test_additional_findings_count_towards_the_exit_code(verdict: Verdict, code: int) -> None:
    only = SATELLITE.link.model_copy(update={"refused_probes": ()})
    router = Fake(active=True, counts_after=3, tells_time=True, tells_both=True)
    proof = prove(router, proving(try_all=True, link=only))
    assert replace(proof, findings=(LinkFinding(verdict, "allow-list-name", "it has moved"),)).exit == code


def test_allowed_host_silent_for_the_whole_window_fails() -> None:
    proof = prove(Fake())
    assert told(proof)[ADDED] == ("silent", "FAIL")
    assert proof.exit is ExitCode.CHECKS_FAILED


def test_silence_in_a_short_window_is_inconclusive() -> None:
    assert told(prove(Fake(), proving(window_s=45.0)))[ADDED] == ("silent", "INCONCLUSIVE")


def test_open_filter_is_a_failure() -> None:
    proof = prove(Fake(beyond={ADDED: 0, STRANGER: 0}, open=True))
    assert told(proof)[STRANGER] == ("answered", "FAIL")
    assert proof.exit is ExitCode.CHECKS_FAILED


@pytest.mark.parametrize(("answers", "outcome", "verdict"), [(True, "answered", "WARN"), (False, "silent", "PASS")])
def test_with_filter_opened_for_one_host_the_terminal_decides(answers: bool, outcome: str, verdict: str) -> None:  # noqa: FBT001 - a case
    router = Fake(beyond={ADDED: 0, **({STRANGER: 0} if answers else {})})
    proof = prove(router, proving(open_filter=True))
    assert told(proof)[f"{STRANGER} open"] == (outcome, verdict)
    assert told(proof)[STRANGER] == ("refused here", "PASS")
    assert (router.rows, router.held) == ([], False)
    assert [command.path for command in router.sent if command.path.startswith("/safe-mode/")] == [
        "/safe-mode/take",
        "/safe-mode/print",
        "/safe-mode/release",
    ]
    added = [dict(command.arguments) for command in router.sent if command.path == "/ip/firewall/filter/add"]
    assert [row["chain"] for row in added] == ["to-satellite", "from-satellite"]
    assert {row["protocol"] for row in added} == {"icmp"}
    assert {row.get("dst-address") or row.get("src-address") for row in added} == {STRANGER}
    assert proof.exit is ExitCode.CHECKS_FAILED, "the VPN and the time could not be tried"


def test_filter_is_not_opened_without_safe_mode() -> None:
    router = Fake(beyond={ADDED: 0}, safe_mode=False)
    with pytest.raises(
        DeviceError, match="cannot enter safe mode, so nothing was changed for the test: no such command prefix"
    ):
        prove(router, proving(open_filter=True))
    assert not any(command.path == "/ip/firewall/filter/add" for command in router.sent)


def test_safe_mode_is_read_again_after_reordered_replies() -> None:
    class Shuffled(Fake):
        async def flight(self, commands: "Sequence[Command]", *, silence_s: float | None = None) -> "list[Reply]":
            takes = [command.path for command in commands] == ["/safe-mode/take", "/safe-mode/print"]
            replies = await super().flight(commands[::-1] if takes else commands, silence_s=silence_s)
            return replies[::-1] if takes else replies

    router = Shuffled(beyond={ADDED: 0})
    assert told(prove(router, proving(open_filter=True)))[f"{STRANGER} open"] == ("silent", "PASS")
    assert (router.rows, router.held) == ([], False)


def test_filter_that_may_still_be_open_is_outcome_unknown() -> None:
    with pytest.raises(OutcomeUnknown, match="the router does not confirm that the test rows are removed"):
        prove(Fake(beyond={ADDED: 0}, stuck=True), proving(open_filter=True))


def test_silent_link_is_inconclusive_about_refusal() -> None:
    plain = proving(open_filter=True, link=SATELLITE.link)
    assert told(prove(Fake(), plain))[f"{STRANGER} open"] == ("silent", "INCONCLUSIVE")


def test_byte_budget_stops_the_test() -> None:
    router = Fake(burst_bytes=BUDGET_BYTES)
    assert told(prove(router))[ADDED] == ("silent", "INCONCLUSIVE")
    assert len([command for command in router.sent if ("address", ADDED) in command.arguments]) == 1


def test_session_over_the_tested_satellite_is_included_in_the_bill() -> None:
    """The router of the vessel is reached over the satellite that is proved."""
    found = satellite_of(DECLARED, "te4sea", None)
    what = found.proving(DECLARED, is_rehearsal=True)
    assert what.carrier == "satellite"
    (expected,) = previews(DECLARED, what)
    assert expected.words.startswith("over metered link satellite of te4sea: up to ")
    what.port = "ether3"
    proof = prove(Fake(burst_bytes=2_000), what)
    (bill,) = bills(DECLARED, proof, 90.0).values()
    assert bill.payload_bytes == proof.bytes_counted + on_the_wire(4 * 100, 1)
    assert expected.bill.payload_bytes >= bill.payload_bytes > 3_000


def test_session_over_another_link_is_billed_separately() -> None:
    what = SATELLITE.proving(DECLARED, is_rehearsal=True, via="4g")
    session, pings = previews(DECLARED, what)
    assert [one.link.name for one in (session, pings)] == ["4g", "satellite"]
    assert session.bill.payload_bytes > pings.bill.payload_bytes == 2 * 18 * 84
    proof = prove(Fake(), what)
    paid = bills(DECLARED, proof, 90.0)
    assert {name: bill.payload_bytes for name, bill in paid.items()} == {
        "satellite": proof.bytes_counted,
        "4g": on_the_wire(proof.session_bytes, 1),
    }
    with pytest.raises(UsageError, match="has no such link"):
        SATELLITE.proving(DECLARED, is_rehearsal=True, via="4h")


def test_pings_use_less_than_half_the_budget() -> None:
    assert proving(open_filter=True).expected_bytes <= BUDGET_BYTES / 2
    assert prove(Fake()).bytes_counted < BUDGET_BYTES / 2


def test_tunnel_replies_count_while_satellite_is_active() -> None:
    proof = prove(Fake(beyond={ADDED: 0}, active=True, counts_after=3))
    assert proof.active
    assert told(proof)["203.0.113.2 udp 1194"] == ("answered", "PASS")
    assert told(proof)["192.0.2.123 udp 123"] == ("silent", "INCONCLUSIVE")


@pytest.mark.parametrize(("tunnel", "verdict"), [("false", "FAIL"), ("true", "INCONCLUSIVE"), (None, "INCONCLUSIVE")])
def test_vpn_silence_counts_only_while_the_tunnel_is_connecting(tunnel: str | None, verdict: str) -> None:
    proof = prove(Fake(beyond={ADDED: 0}, active=True, tunnel=tunnel))
    assert told(proof)["203.0.113.2 udp 1194"] == ("silent", verdict)


@pytest.mark.parametrize(
    ("terminal", "factory", "code"),
    [(True, False, None), (False, True, "box-in-wrong-subnet"), (False, False, "box-silent")],
)
def test_terminal_in_the_wrong_subnet_is_detected_by_arp(terminal: bool, factory: bool, code: str | None) -> None:  # noqa: FBT001 - a case
    proof = prove(Fake(beyond={ADDED: 0}, terminal=terminal, at_factory=factory))
    assert [finding.code for finding in proof.findings] == ([] if code is None else [code])


def test_renamed_port_is_probed_by_its_current_name() -> None:
    proof = prove(Fake(beyond={ADDED: 0}, terminal=True, at_factory=True, port_name="starlink"))
    assert [finding.code for finding in proof.findings] == ["factory-address-answers"]


def test_unprobed_port_is_inconclusive(monkeypatch: pytest.MonkeyPatch) -> None:
    router = Fake(beyond={ADDED: 0}, terminal=True, port_name="starlink")
    monkeypatch.setattr(router, "_port", lambda: replace(Fake()._port()))
    proof = prove(router)
    assert [(finding.verdict, finding.code) for finding in proof.findings] == [(Verdict.INCONCLUSIVE, "box-not-asked")]


def over_tcp() -> Link:
    """The satellite of coastal with a web page that a person has added, and one that must be refused."""
    words = {"address": ADDED, "port": 443, "transport": "tcp"}
    added = AllowedTarget.model_validate({"name": "weather", **words})
    refused = AllowedTarget.model_validate({"name": "ours", **words, "address": STRANGER})
    return SATELLITE.link.model_copy(update={"allow": (added,), "refused_probes": (refused,)})


@pytest.mark.parametrize(("connects", "seen"), [(True, ("answered", "PASS")), (False, ("silent", "FAIL"))])
def test_tcp_target_is_tested_by_a_temporary_netwatch_row(connects: bool, seen: tuple[str, str]) -> None:  # noqa: FBT001 - a case
    router = Fake(connects=connects)
    assert told(prove(router, proving(try_all=True, link=over_tcp())))[f"{ADDED} tcp 443"] == seen
    assert (router.rows, router.held) == ([], False)
    added = [dict(command.arguments) for command in router.sent if command.path == "/tool/netwatch/add"]
    assert [(row["type"], row["host"], row["port"]) for row in added] == [
        ("tcp-conn", ADDED, "443"),
        ("tcp-conn", STRANGER, "443"),
    ]
    assert {row["src-address"] for row in added} == {"10.10.2.2"}


@pytest.mark.parametrize("connects", [True, False])
def test_packets_not_sent_over_the_satellite_prove_nothing(connects: bool) -> None:  # noqa: FBT001 - a case
    rule = {"chain": "to-satellite", "action": "return", "dst-address": ADDED, "dst-port": "443", "protocol": "tcp"}
    router = Fake(connects=connects, more_rules=({**rule, "packets": "3"},))
    proof = prove(router, proving(try_all=True, link=over_tcp()))
    assert told(proof)[f"{ADDED} tcp 443"] == ("not tested", "INCONCLUSIVE")
    assert "but the router counted no traffic to it over the satellite" in proof.as_text()


@pytest.mark.parametrize(
    ("asks", "tells", "seen"),
    [
        (True, True, ("answered", "PASS")),
        (True, False, ("silent", "FAIL")),
        (False, True, ("not tested", "INCONCLUSIVE")),
    ],
)
def test_time_client_is_routed_over_the_satellite_and_back(asks: bool, tells: bool, seen: tuple[str, str]) -> None:  # noqa: FBT001 - a case
    router = Fake(beyond={ADDED: 0}, asks_time=asks, tells_time=tells)
    assert told(prove(router, proving(try_all=True)))["192.0.2.123 udp 123"] == seen
    assert (router.clock, router.rows, router.held) == (["no", "yes"], [], False)
    ways = [dict(command.arguments) for command in router.sent if command.path == "/routing/rule/add"]
    assert [(row["dst-address"], row["table"], row["place-before"], row.get("src-address")) for row in ways] == [
        ("192.0.2.123/32", "via-satellite", "*A", None),
        ("192.0.2.124/32", "via-satellite", "*A", None),
        # The site's own packets to it, which have other senders, stay where they are.
        ("203.0.113.2/32", "via-satellite", "*A", "10.10.2.2/32"),
    ]


def test_time_needs_no_route_while_satellite_is_active() -> None:
    router = Fake(beyond={ADDED: 0}, active=True, tells_time=True)
    assert told(prove(router, proving(try_all=True)))["192.0.2.123 udp 123"] == ("answered", "PASS")
    assert not any(command.path == "/routing/rule/add" for command in router.sent)


def test_no_row_is_added_by_default() -> None:
    router = Fake(beyond={ADDED: 0})
    prove(router, proving(link=over_tcp()))
    reading = ("/print", "/tool/ping")
    assert [command.path for command in router.sent if not command.path.endswith(reading)] == []


def test_no_tested_target_gives_exit_code_nothing() -> None:
    alone = SATELLITE.link.model_copy(update={"refused_probes": ()})
    proof = prove(Fake(), proving(link=alone))
    assert {finding.verdict for _, finding in proof.results} == {Verdict.INCONCLUSIVE}
    assert proof.exit is ExitCode.NOTHING


def test_vpn_address_is_pinged_only_over_the_active_link() -> None:
    whole = AllowedTarget.model_validate({"name": "VPN host", "address": "203.0.113.2"})
    link = SATELLITE.link.model_copy(update={"allow": (whole,)})
    by_activity = {
        active: next(task for task in tasks(DECLARED.pilot, link, active=active) if task.name == "VPN host")
        for active in (False, True)
    }
    assert by_activity[False].probe is SatelliteProbe.NONE
    assert by_activity[True].probe is SatelliteProbe.ICMP


def test_every_target_of_the_shipped_sites_is_planned_once() -> None:
    for site, refused in (("coastal", 2), ("te4sea", 0)):
        planned = tasks(DECLARED.pilot, satellite_of(DECLARED, site, None).link, active=True)
        assert [task.expectation for task in planned] == [ExpectedOutcome.REACHED] * 3 + [
            ExpectedOutcome.REFUSED
        ] * refused
        assert all((task.probe is SatelliteProbe.NONE) == bool(task.why_not) for task in planned)


@pytest.mark.parametrize(("site", "name", "words"), [("scc", None, "no satellite link"), ("coastal", "4g", "`4g`")])
def test_site_without_a_satellite_link_is_refused(site: str, name: str | None, words: str) -> None:
    with pytest.raises(NothingToProve, match=words):
        satellite_of(DECLARED, site, name)


def test_resolver_distinguishes_no_reply_from_no_address() -> None:
    answers = {"a.example.org": frozenset({"192.0.2.1"}), "b.example.org": frozenset[str](), "c.example.org": None}
    assert asyncio.run(resolve([*answers, "a.example.org"], ask=answers.__getitem__)) == answers
    assert asyncio.run(resolve([])) == {}


def test_json_matches_the_text() -> None:
    proof = prove(Fake(beyond={ADDED: 0}))
    data = proof.as_json()
    assert data["exit"] == 6
    assert {row["target"]: row["outcome"] for row in data["targets"]}[ADDED] == ProbeOutcome.ANSWERED
    text = proof.as_text()
    assert all(finding.message in text for _, finding in proof.results)
    assert data["left_out"] == (
        "far end of measurements (203.0.113.2 udp 862): `provision measure link site=coastal link=satellite` tests it"
    )
    assert f"SKIP         {data['left_out']}" in text
    assert "2 of 6 targets proved, 4 could not be tested" in text
