"""A budget is never exceeded by more than one packet, as the sender's interface counts."""

import random
from dataclasses import replace
from decimal import Decimal

import pytest
from simulated_network import KEY, SECOND, Recording, SimulatedNetwork, network
from tolerances import tolerances

from atlantis_netcfg.emulator.udp_link import HEADERS, LinkShape
from atlantis_netcfg.links.cost import Tariff, bill
from atlantis_netcfg.links.qualify.budget import Budget, BudgetError, BudgetGuard, BudgetLimit
from atlantis_netcfg.links.qualify.messages import MessagePlan, MessageStream
from atlantis_netcfg.links.qualify.messages_down import DownMessageStream
from atlantis_netcfg.links.qualify.path_mtu import path_mtu
from atlantis_netcfg.links.qualify.session import PacketStream, ReflectorPeer, Train, TrainPlan, run

TARIFF = Tariff(Decimal("8.00"), min_session_bytes=5000, floor_bytes_per_s=300, floor_after_s=300)
"""An example, in the shape of Certus 100's published rules; its price is not the pilot's."""
CLOSING_S = 3.0


def _counted(net: SimulatedNetwork) -> int:
    """What an interface of the sender would count up to now: all that it sent, and all that came."""
    return net.up.sent_bytes + net.delivered_bytes


def _random_shape(draw: random.Random) -> LinkShape:
    return LinkShape(
        rate_bps=draw.choice([None, 50_000, 352_000]),
        delay_s=draw.uniform(0, 0.5),
        jitter_s=draw.uniform(0, 0.1),
        loss=draw.choice([0, 0.01, 0.3, 1.0]) if draw.random() < 0.5 else 0.0,
        duplicates=draw.choice([0.01, 0.3, 1.0]) if draw.random() < 0.5 else 0.0,
        queue_bytes=draw.choice([3000, 64_000]),
        reordering=draw.choice([0, 0.1]),
        reorder_s=1.0,
    )


def _random_streams(draw: random.Random, net: SimulatedNetwork, peer: ReflectorPeer) -> list[PacketStream]:
    write = Recording().write
    size = draw.choice([112, 172, 584, 1400])
    train = Train("t", TrainPlan(size, draw.uniform(0.02, 0.5), draw.uniform(1, 8), CLOSING_S), peer, net, write)
    octets, rate = draw.randrange(1, 9000), draw.uniform(0.2, 2)
    pace = draw.choice([None, 200_000])
    plan = MessagePlan(octets, rate, 4, draw.random() < 0.5, pace, timeout_s=1, give_up_s=4)
    down = replace(plan, size=draw.randrange(1, 9000), pace_bps=draw.choice([None, 100_000]))
    streams: list[PacketStream] = [
        train,
        MessageStream("m", plan, peer, net, write),
        DownMessageStream("d", down, peer, net, write),
    ]
    return draw.sample(streams, draw.randrange(1, 4))


def _largest() -> int:
    return 1400 + HEADERS


@pytest.mark.parametrize("block", range(10))
def test_random_budgets_are_respected(block: int) -> None:
    limits = []
    for seed in range(block * 100, block * 100 + 100):
        draw = random.Random(seed)  # noqa: S311 - a test
        net = network(_random_shape(draw), _random_shape(draw), seed)
        peer = ReflectorPeer(KEY)
        budget = Budget(
            max_bytes=draw.choice([None, draw.randrange(40_000)]),
            max_seconds=draw.choice([None, draw.uniform(0, 12)]),
            max_price=draw.choice([None, Decimal(draw.randrange(400)) / 1000]),
            tariff=TARIFF,
            closing_s=CLOSING_S,
        )
        guard = BudgetGuard(budget, lambda net=net: net.now / SECOND)  # type: ignore[misc] # its type is that of net
        reason = run(net, peer, _random_streams(draw, net, peer), guard)
        slack = round(tolerances()["budget_packets"] * _largest())
        assert _counted(net) == guard.sent_bytes + guard.received_bytes, f"seed {seed}: not the interface's count"
        seconds = guard.seconds
        net.drain()
        used = _counted(net)
        assert budget.max_bytes is None or used <= budget.max_bytes + slack, f"seed {seed}"
        assert budget.max_seconds is None or seconds <= budget.max_seconds + 0.01, f"seed {seed}"
        price = bill(used, seconds, TARIFF).price
        dearer = bill(slack, 0, TARIFF).price
        assert price is not None
        assert dearer is not None
        assert budget.max_price is None or price <= budget.max_price + dearer, f"seed {seed}"
        assert (reason in set(BudgetLimit)) is (guard.limited_by is not None)
        limits.append(reason)
    assert {"bytes", "seconds", "done"} <= set(limits), "the budgets of this block try nothing"


@pytest.mark.parametrize("max_bytes", [0, 139, 279])
def test_budget_below_one_packet_and_reply_sends_nothing(max_bytes: int) -> None:
    net = network()
    peer = ReflectorPeer(KEY)
    train = Train("t", TrainPlan(112, 0.1, 5), peer, net, Recording().write)
    assert run(net, peer, [train], BudgetGuard(Budget(max_bytes), lambda: 0.0)) == "bytes"
    assert net.up.sent_count == 0


def test_budget_is_used_except_room_for_duplicates() -> None:
    net = network()
    peer = ReflectorPeer(KEY)
    train = Train("t", TrainPlan(112, 0.1, 5), peer, net, Recording().write)
    run(net, peer, [train], BudgetGuard(Budget(20 * 280 + 100), lambda: net.now / SECOND))
    # Room is kept for copies of the answers of the last second, which are nine before the newest packet.
    assert net.up.sent_count == (20 * 280 + 100 - 9 * 140) // 280 == 15


def test_lost_replies_are_not_refunded() -> None:
    net = network(down=LinkShape(loss=1.0))
    peer = ReflectorPeer(KEY)
    train = Train("t", TrainPlan(112, 1.1, 50), peer, net, Recording().write)
    run(net, peer, [train], BudgetGuard(Budget(10 * 280), lambda: net.now / SECOND))
    assert net.up.sent_count == 10, "a provider may bill what it has lost"


@pytest.mark.parametrize("delay_s", [0.01, 2.0])
def test_duplicated_replies_do_not_exceed_the_budget(delay_s: float) -> None:
    net = network(down=LinkShape(delay_s=delay_s, duplicates=1.0))
    peer = ReflectorPeer(KEY)
    train = Train("t", TrainPlan(112, 0.01, 5), peer, net, Recording().write)
    guard = BudgetGuard(Budget(20_000, closing_s=3), lambda: net.now / SECOND)
    assert run(net, peer, [train], guard) == "bytes"
    net.drain()
    assert net.down.copies == net.up.sent_count > 30
    # Of a second's packets the answers are counted twice, and room for another copy is still kept.
    assert 15_000 < _counted(net) <= 20_000 + 140


@pytest.mark.parametrize("rate_hz", [2, 0.4])
def test_requested_message_is_charged_with_its_duplicates(rate_hz: float) -> None:
    net = network(down=LinkShape(duplicates=1.0))
    peer = ReflectorPeer(KEY)
    stream = DownMessageStream("d", MessagePlan(10_000, rate_hz, 60), peer, net, Recording().write)
    guard = BudgetGuard(Budget(100_000, closing_s=3), lambda: net.now / SECOND)
    assert run(net, peer, [stream], guard) == "bytes"
    net.drain()
    assert 70_000 < _counted(net) <= 100_000 + 1228


def test_sending_time_of_the_far_end_is_charged_in_advance() -> None:
    net = network()
    peer = ReflectorPeer(KEY)
    plan = MessagePlan(50_000, 1, 60, pace_bps=100_000)
    stream = DownMessageStream("d", plan, peer, net, Recording().write)
    guard = BudgetGuard(Budget(max_seconds=7.0, closing_s=1), lambda: net.now / SECOND)
    assert run(net, peer, [stream], guard) == "seconds"
    net.drain()
    assert net.now <= 7 * SECOND, "a message takes 4.6 s at this pace, and the next one leaves after it"
    assert net.reflector.statistics.requested == 48


def test_mtu_search_respects_the_budget() -> None:
    net = network(LinkShape(mtu=1320))
    guard = BudgetGuard(Budget(9000), lambda: net.now / SECOND)
    found = path_mtu(net, ReflectorPeer(KEY), guard)
    assert _counted(net) <= 9000
    assert found.both is None
    assert found.why == "the budget ended: bytes"


def test_price_limit_needs_a_tariff() -> None:
    with pytest.raises(BudgetError, match="needs the tariff of the link"):
        Budget(max_price=Decimal(5))


def test_floor_of_a_long_session_counts_towards_the_price() -> None:
    budget = Budget(max_price=Decimal("0.80"), tariff=TARIFF, closing_s=10)
    assert budget.limit(1000, 100) is None
    assert budget.limit(1000, 400) is BudgetLimit.MONEY, "300 bytes a second for 410 s are 0.98"
