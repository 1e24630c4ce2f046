"""The link of known truth is what it says: its own counters and the times of arrival."""

import random
import socket

import pytest
from waiting import HANG_S

from atlantis_netcfg.emulator.udp_link import LinkModel, LinkShape, UdpRelay


def _model(shape: LinkShape, seed: int = 1) -> LinkModel:
    return LinkModel(shape, random.Random(seed))  # noqa: S311 - an emulation


def test_same_seed_gives_the_same_result() -> None:
    shape = LinkShape(352_000, 0.28, 0.02, 0.1, 0.1, 0.1, 0.5)
    first, second, other = _model(shape), _model(shape), _model(shape, 2)
    fates = [[model.offer(200, n / 10) for n in range(200)] for model in (first, second, other)]
    assert fates[0] == fates[1] != fates[2]


def test_loss_setting_does_not_change_other_delays() -> None:
    kept = [_model(LinkShape(delay_s=0.1, jitter_s=0.05, loss=loss)) for loss in (0.0, 0.2)]
    fates = [[model.offer(200, n * 10.0) for n in range(100)] for model in kept]
    assert all(lossy in {(), whole} for whole, lossy in zip(*fates, strict=True))
    assert fates[0] != fates[1]


def test_a_rate_is_kept_and_the_queue_is_bounded() -> None:
    model = _model(LinkShape(rate_bps=80_000, queue_bytes=5_000))
    times = [model.offer(1000, 0.0) for _ in range(10)]
    assert [time[0] for time in times if time] == pytest.approx([0.1, 0.2, 0.3, 0.4, 0.5])
    assert model.drop_count == 5
    assert [*model.offer(1000, 10.0)] == pytest.approx([10.1])


@pytest.mark.parametrize("loss", [0.01, 0.2])
def test_loss_has_the_configured_share(loss: float) -> None:
    model = _model(LinkShape(loss=loss))
    assert sum(bool(model.offer(100, n / 100)) for n in range(20_000)) == 20_000 - model.loss_count
    assert model.loss_count / 20_000 == pytest.approx(loss, rel=0.2)


def test_only_reordered_packets_change_order() -> None:
    kept = _model(LinkShape(delay_s=0.1, jitter_s=0.2))
    times = [kept.offer(100, n / 100)[0] for n in range(1000)]
    assert times == sorted(times)
    mixed = _model(LinkShape(delay_s=0.1, reordering=0.1, reorder_s=0.5))
    delays = [round(mixed.offer(100, n / 100)[0] - n / 100, 6) for n in range(1000)]
    assert set(delays) == {0.1, 0.6}
    assert delays.count(0.6) == pytest.approx(100, abs=40)


def test_nothing_passes_in_a_gap_nor_beyond_the_mtu() -> None:
    model = _model(LinkShape(gaps_s=((10.0, 80.0),), mtu=1400))
    assert [bool(model.offer(100, now)) for now in (9.9, 10.0, 79.9, 80.0)] == [True, False, False, True]
    assert [bool(model.offer(size, 100.0)) for size in (1400, 1401)] == [True, False]
    assert (model.in_gaps, model.drop_count, model.sent_count) == (2, 1, 6)


def test_the_relay_carries_both_ways() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as server:
        server.bind(("127.0.0.1", 0))
        server.settimeout(HANG_S)
        shape = LinkShape(delay_s=0.01, duplicates=1.0)
        with (
            UdpRelay(server.getsockname(), shape, LinkShape()) as relay,
            socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as client,
        ):
            client.settimeout(HANG_S)
            client.sendto(b"there", relay.address)
            first, back = server.recvfrom(100)
            second, _ = server.recvfrom(100)
            assert first == second == b"there"
            server.sendto(b"and back", back)
            assert client.recv(100) == b"and back"
            assert (relay.up.sent_count, relay.up.copies, relay.down.sent_count) == (1, 1, 1)
