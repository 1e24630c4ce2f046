from dataclasses import replace
from pathlib import Path

import pytest
from plan_world import observed
from row_subtests import for_each_row

from atlantis_netcfg.routeros import estimate as module
from atlantis_netcfg.routeros._types import Observation, Plan
from atlantis_netcfg.routeros.api._wire import encode
from atlantis_netcfg.routeros.desired import read
from atlantis_netcfg.routeros.estimate import TYPICAL_MENUS, Estimate, LinkMetrics, estimate
from atlantis_netcfg.routeros.menus import MENUS
from atlantis_netcfg.routeros.observe import printing
from atlantis_netcfg.routeros.planner import plan, simulate
from atlantis_netcfg.routeros.safe_mode import BUDGET

LAN = LinkMetrics("lan", 0.001, 100e6, 100e6, is_metered=False)
IRIDIUM = LinkMetrics("satellite", 0.7, 352e3, 704e3, is_metered=True)
NOTHING = Plan("r", (), "")
CHECKPOINT = 7
"""Round trips: a session (four), release, take, and the next script."""
SIGN = 1
"""Where safe mode is not held from the first change to the last, a sign goes up in a round trip of its own."""
GOLDEN = Path(__file__).parents[2] / "routeros" / "render" / "golden" / "coastal-router.rsc"


def first_configuration() -> tuple[Plan, Observation]:
    there = observed(
        "/interface ethernet\n"
        + "".join(f"set [ find default-name=ether{n} ] name=ether{n} poe-out=auto-on\n" for n in range(1, 9))
        + "/interface wifi\nset [ find default-name=wifi1 ] name=wifi1\n"
        + '/ip address\nadd address=10.64.101.1/24 comment="atlantis: management" interface=ether8'
        + " network=10.64.101.0\n"
        + "/ip service\nset telnet\nset ftp\nset www\nset ssh\nset www-ssl\nset api\nset winbox\nset api-ssl\n"
        + "/system logging action\nadd name=memory target=memory\n"
    )
    there = Observation(there.facts, {path: there.rows[path] for path in TYPICAL_MENUS})
    return plan("r", read(GOLDEN.read_text(encoding="utf-8")), there), there


def pools(count: int) -> Plan:
    text = "/ip address\n" + "".join(f"add address=10.{n // 250}.{n % 250}.1/24 interface=b\n" for n in range(count))
    return plan("r", read(text), observed(""))


def test_a_run_that_changes_nothing_costs_handshakes_login_and_one_batch() -> None:
    cost = estimate(NOTHING, IRIDIUM)
    assert cost.round_trips == 5
    assert 4.3 < cost.seconds < 5.5
    tally = module._CostTally()
    tally.log_in()
    up, down = (tally.up - module.LOGIN_BYTES, tally.down - module.TAG_BYTES)
    assert up + down == module.HANDSHAKE_BYTES + 2 * module.RECORD_BYTES
    assert down - up == pytest.approx(module.HANDSHAKE_BYTES / 3, abs=1)


def test_a_first_configuration_stays_within_its_round_trips() -> None:
    planned, there = first_configuration()
    cost = estimate(planned, IRIDIUM, there)
    assert 14 <= cost.round_trips <= 25  # the engine itself stays within 24, and the estimate is at most one off
    assert cost.bytes_up > sum(len(action.menu) for action in planned.actions)
    assert estimate(planned, LAN, there).seconds < 5 < cost.seconds


def test_after_the_first_configuration_only_reading_costs() -> None:
    planned, there = first_configuration()
    later = Observation(there.facts, simulate(there.rows, planned))
    again = estimate(plan("r", read(GOLDEN.read_text(encoding="utf-8")), later), LAN, later)
    assert again.round_trips == 5
    assert again.bytes_down > estimate(NOTHING, LAN, there).bytes_down


def test_round_trips_are_constant_within_one_safe_mode() -> None:
    assert estimate(pools(1), LAN).round_trips == estimate(pools(BUDGET), LAN).round_trips
    assert estimate(pools(BUDGET + 1), LAN).round_trips > estimate(pools(BUDGET), LAN).round_trips


def test_harmless_rows_skip_safe_mode_if_that_saves_a_checkpoint() -> None:
    harmless = "/ip pool\n" + "".join(f"add name=p{n} ranges=10.0.0.{n}\n" for n in range(BUDGET))
    one = plan("r", read(harmless + "/ip address\nadd address=10.0.0.1/24 interface=b"), observed(""))
    assert estimate(one, LAN).round_trips == estimate(pools(1), LAN).round_trips + SIGN + 2
    assert estimate(pools(BUDGET + 1), LAN).round_trips == estimate(pools(1), LAN).round_trips + SIGN + CHECKPOINT


@pytest.mark.parametrize("field", ["rtt_s", "rate_up_bps", "rate_down_bps"])
def test_every_property_of_the_link_affects_the_time(field: str) -> None:
    worse = replace(IRIDIUM, **{field: 5.0})  # type: ignore[arg-type]
    assert estimate(pools(5), worse).seconds > estimate(pools(5), IRIDIUM).seconds
    assert estimate(pools(5), worse).bytes == estimate(pools(5), IRIDIUM).bytes


def test_removing_very_many_rows_takes_several_safe_modes() -> None:
    device = "/ip pool\n" + "".join(f"add comment=atlantis name=p{n}\n" for n in range(200))
    removal = plan("r", read("/ip pool"), observed(device))
    assert len(removal.actions) == 1
    assert estimate(removal, LAN).round_trips == estimate(pools(1), LAN).round_trips + SIGN + 2 * CHECKPOINT


def test_dhcp_leases_after_safe_mode_cost_one_round_trip() -> None:
    leases = "".join(f"add address=10.0.0.{n} mac-address=02:00:00:00:00:{n:02X}\n" for n in range(90))
    text = "/ip address\nadd address=10.9.0.1/24 interface=b\n/ip dhcp-server lease\n" + leases
    one = estimate(pools(1), LAN).round_trips
    assert estimate(plan("r", read(text), observed("")), LAN).round_trips == one + SIGN + 1


def test_more_to_write_is_never_cheaper() -> None:
    costs: list[Estimate] = [estimate(pools(count), IRIDIUM) for count in (1, 10, 50, 100, 1000)]
    assert [cost.bytes_up for cost in costs] == sorted(cost.bytes_up for cost in costs)
    assert [cost.seconds for cost in costs] == sorted(cost.seconds for cost in costs)
    assert costs[-1].bytes == costs[-1].bytes_up + costs[-1].bytes_down


def test_oversized_scripts_are_split() -> None:
    text = "/system note\nset note=" + "x" * 130_000
    long = plan("r", read(text), observed(""))
    assert estimate(long, LAN).round_trips == estimate(pools(1), LAN).round_trips + 2


@for_each_row("path", MENUS)
def test_request_size_estimate_matches_real_sentences(path: str) -> None:
    words = printing(path).words()
    assert abs(module._question(path) - len(encode((words[0], ".tag=1234", *words[1:])))) <= 6


@pytest.mark.parametrize("row", [{".id": "*1", "comment": "é" * 100, "note": "x" * 20_000}, {}])
def test_reply_size_estimate_matches_real_sentences(row: dict[str, str]) -> None:
    words = ("!re", ".tag=123", *(f"={name}={value}" for name, value in row.items()))
    assert abs(module._answer(row) - len(encode(words))) <= 2
