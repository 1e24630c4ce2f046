from __future__ import annotations

import pytest

from atlantis_netcfg.core.secret import MASK
from atlantis_netcfg.emulator.routeros import FaultKind, LinkFault, WireBehaviour, WireCounters
from atlantis_netcfg.emulator.routeros.wire.link import Faults, WirePace, masked


def test_the_knee_comes_after_a_burst_and_goes_when_idle() -> None:
    knobs, pace = WireBehaviour(knee_after=2), WirePace()
    assert [pace.wait_s(knobs, 5.0) for _ in range(4)] == pytest.approx([0, 0, 0.02, 0.04])
    assert pace.wait_s(knobs, 5.1) == pytest.approx(0.02)
    assert pace.wait_s(knobs, 7.0) == 0


def test_every_nth_sentence_stalls_and_holds_up_the_rest() -> None:
    knobs, pace = WireBehaviour(stall_every=2, stall_s=7), WirePace()
    assert [pace.wait_s(knobs, 5.0) for _ in range(3)] == [0, 7, 7]


def test_a_fault_strikes_once_at_its_sentence() -> None:
    faults = Faults()
    faults.arm(LinkFault(do=FaultKind.DROP, sentence=2, match="/ip/firewall/*"))
    assert faults.upon("/ip/firewall/filter/add") == []
    assert faults.upon("/ip/address/add") == []
    assert [fault.do for fault in faults.upon("/ip/firewall/nat/add")] == [FaultKind.DROP]
    assert faults.upon("/ip/firewall/nat/add") == []
    assert faults.armed == ()


def test_disarmed_faults_do_not_strike() -> None:
    faults = Faults()
    faults.arm(LinkFault(do=FaultKind.GAP, seconds=1))
    faults.disarm()
    assert faults.upon("/login") == []


@pytest.mark.parametrize(
    ("word", "shown"),
    [
        ("=password=hunter2", f"=password={MASK}"),
        ("=wpa2-pre-shared-key=a=b c", f"=wpa2-pre-shared-key={MASK}"),
        ("=response=00ab", f"=response={MASK}"),
        ("=name=password", "=name=password"),
        ("=private-key=", "=private-key="),
        (
            '=script=/interface ovpn-client add name=x password="a \\" b" user=u\n:put "ok 1"',
            f'=script=/interface ovpn-client add name=x password={MASK} user=u\n:put "ok 1"',
        ),
    ],
)
def test_secrets_do_not_reach_the_log(word: str, shown: str) -> None:
    assert masked(["/x", word]) == ("/x", shown)


def test_counters_add_up() -> None:
    assert WireCounters(1, 2, 3, 4, 5, 6, 7, 8).plus(WireCounters(turns=1, wire_out=1)) == WireCounters(
        1, 2, 4, 4, 5, 6, 7, 9
    )
