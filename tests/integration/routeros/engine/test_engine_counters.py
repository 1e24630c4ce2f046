"""The byte counters of ports, read along: what they say, what they cost, and what a reboot makes of them."""

from dataclasses import replace
from pathlib import Path

import pytest
from engine_bench import Bench, run

from atlantis_netcfg.emulator.routeros import RouterLink
from atlantis_netcfg.routeros import DeviceResult, Status
from atlantis_netcfg.routeros._types import Observation
from atlantis_netcfg.routeros.api import WINDOW, Command, Reply
from atlantis_netcfg.routeros.apply import Admission
from atlantis_netcfg.routeros.estimate import Estimate, LinkMetrics, on_the_wire
from atlantis_netcfg.routeros.observe import counter_reads, counting, read_counts, seconds

SATELLITE = LinkMetrics("satellite", 0.7, 352_000, 704_000, is_metered=True)


def twice(folder: Path, *counted: str) -> tuple[DeviceResult, DeviceResult]:
    async def act() -> tuple[DeviceResult, DeviceResult]:
        async with Bench(folder) as bench:
            bench.router.set_link(RouterLink(port="ether3"))
            return await bench.converge(counted_ports=counted), await bench.converge(counted_ports=counted)

    return run(act())


def test_counters_cost_no_round_trip(tmp_path: Path) -> None:
    without, with_them = twice(tmp_path / "without"), twice(tmp_path / "with", "ether2", "ether3")
    assert [one.status for one in with_them] == [Status.CHANGED, Status.UNCHANGED]
    assert [one.round_trips for one in with_them] == [one.round_trips for one in without]
    assert all(one.counts == () for one in without)


def test_router_counters_match_what_we_sent(tmp_path: Path) -> None:
    for result in twice(tmp_path, "ether2", "ether3"):
        first, last = result.counts
        assert first.ports["ether2"] == last.ports["ether2"] == (0, 0)
        risen = sum(last.ports["ether3"]) - sum(first.ports["ether3"])
        ours = on_the_wire(result.sent_bytes + result.received_bytes, result.sessions)
        # The first look is after the handshake and the login, the last one before the last answers have gone.
        assert 0 < risen < ours
    assert first.uptime_s is not None
    assert last.uptime_s is not None
    assert last.at >= first.at


def test_a_first_configuration_is_counted_nearly_whole(tmp_path: Path) -> None:
    """From behind the first login to the release; an emulated port counts no acknowledgements."""
    first, _ = twice(tmp_path, "ether3")
    before, after = first.counts
    risen = sum(after.ports["ether3"]) - sum(before.ports["ether3"])
    assert risen == pytest.approx(on_the_wire(first.sent_bytes + first.received_bytes, first.sessions), rel=0.25)
    assert after.uptime_s is not None


def test_missing_port_gives_no_counts(tmp_path: Path) -> None:
    for result in twice(tmp_path, "ether33"):
        assert result.counts == ()


def test_a_reboot_sets_the_counters_back(tmp_path: Path) -> None:
    async def act() -> tuple[DeviceResult, DeviceResult]:
        async with Bench(tmp_path) as bench:
            bench.router.set_link(RouterLink(port="ether3"))
            before = await bench.converge(counted_ports=("ether3",))
            bench.router.reboot()
            return before, await bench.converge(counted_ports=("ether3",))

    before, after = run(act())
    assert sum(after.counts[0].ports["ether3"]) < sum(before.counts[-1].ports["ether3"])


class Collector:
    """A toll that refuses whatever would be sent."""

    def __init__(self) -> None:
        self.asked: list[tuple[bool, bool, int]] = []

    def judge(self, observation: Observation, estimate: Estimate | None, *, spends: bool, is_plan: bool) -> Admission:
        assert observation.rows
        assert estimate is not None
        self.asked.append((spends, is_plan, estimate.wire_bytes))
        return Admission(("told in any case",), "too dear" if spends and not is_plan else None, "wait for the cable")


def test_run_over_the_cost_limit_changes_nothing_and_says_why(tmp_path: Path) -> None:
    collector = Collector()

    said: list[str] = []

    async def act() -> tuple[str, DeviceResult, str, DeviceResult]:
        async with Bench(tmp_path) as bench:
            before = bench.export()
            refused = await bench.converge(cost_policy=collector, link=SATELLITE)
            sentences = [sentence[0] for each in bench.router.connections() for sentence in each.sentences]
            said.extend(word for word in sentences if word == "/execute")
            after = bench.export()
            await bench.converge()
            return before, refused, after, await bench.converge(cost_policy=collector, link=SATELLITE)

    before, refused, after, idle = run(act())
    assert (refused.status, refused.message) == (Status.REFUSED, "refused, nothing was changed: too dear")
    assert (refused.hint, refused.notes) == ("wait for the cable", ("told in any case",))
    assert before == after
    assert idle.status is Status.UNCHANGED
    judged = list(dict.fromkeys((spends, planned) for spends, planned, _ in collector.asked))
    assert judged == [(True, False), (False, False)]
    assert collector.asked[0][2] > collector.asked[-1][2] > 0
    assert said == [], "not even the device's parser is paid for"


@pytest.mark.parametrize(
    ("beside", "first", "last"),
    [(1, 1, 1), (WINDOW - 2, 1, 1), (WINDOW - 1, 0, 1), (WINDOW, 0, 0), (WINDOW + 1, 1, 1), (2 * WINDOW, 0, 0)],
)
def test_counter_reads_fill_the_remaining_window(beside: int, first: int, last: int) -> None:
    assert tuple(map(len, counter_reads(("ether3",), beside, WINDOW))) == (first, last)
    assert -(-(beside + first + last) // WINDOW) == -(-beside // WINDOW)
    assert counter_reads((), beside, WINDOW) == ([], [])


def test_one_command_reads_all_ports() -> None:
    assert counting(("ether1", "ether2", "ether3")).queries == (
        "?default-name=ether1", "?default-name=ether2", "?#|", "?default-name=ether3", "?#|",
    )  # fmt: skip


@pytest.mark.parametrize(
    ("text", "expected"),
    [("0s", 0), ("1m5s", 65), ("2h", 7200), ("1w2d3h4m5s", 788_645), ("", None), ("soon", None), ("5", None)],
)
def test_routeros_durations_are_parsed(text: str, expected: float | None) -> None:
    assert seconds(text) == expected


def test_responses_without_numbers_give_no_counters() -> None:
    resource = Reply(({"uptime": "1m"},))
    rows = (("ether1", "7"), ("ether2", ""))
    whole = Reply(tuple({"default-name": name, "rx-byte": rx, "tx-byte": "8"} for name, rx in rows))
    found = read_counts(whole, resource)
    assert found is not None
    assert (dict(found.ports), found.uptime_s) == ({"ether1": (7, 8)}, 60.0)
    assert read_counts(replace(whole, rows=whole.rows[1:]), resource) is None
    assert counting(("ether1",)) == Command(
        "/interface/print", ((".proplist", "default-name,rx-byte,tx-byte"),), ("?default-name=ether1",)
    )
