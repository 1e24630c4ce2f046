"""What may differ between two ends is changed at both as one, far end first, and a second run finds nothing to do."""

from contextlib import AsyncExitStack
from dataclasses import replace
from pathlib import Path

import pytest
from pair_bench import LINK_TIMEOUT_S, PairBench, Words, on, text

from atlantis_netcfg.routeros import DeviceJob, DeviceResult, Status
from atlantis_netcfg.routeros.desired import read
from atlantis_netcfg.routeros.pair import Pair, converge_pair
from bench.proxy import Proxy, Shape

pytestmark = pytest.mark.slow

CHANGES = {
    "name": Words(ssid="new name"),
    "key": Words(key="a new key for both ends"),
    "frequency": Words(frequency=5520),
    "protocol": Words(protocol="nv2"),
    "all": Words(ssid="new name", key='a new key $ for "both"', frequency=5540, protocol="nv2"),
}


SIDES = [
    *(("legacy", "bridge", change) for change in CHANGES),
    *(("legacy", "station-bridge", change) for change in ("name", "frequency", "all")),
    *(("wifi", "bridge", change) for change in ("name", "key", "frequency")),
    *(("wifi", "station-bridge", change) for change in ("key", "frequency")),
]
"""The technician stands at the access point, or at the station."""


@pytest.mark.smoke("legacy-bridge-all", "wifi-bridge-key")
@pytest.mark.parametrize(("family", "near_mode", "change"), SIDES)
def test_change_converges_on_both_ends(tmp_path: Path, family: str, near_mode: str, change: str) -> None:
    words = CHANGES[change]

    async def act(bench: PairBench) -> tuple[tuple[DeviceResult, ...], tuple[DeviceResult, ...], bool, tuple[str, str]]:
        first = await bench.converge(words)
        assert bench.link.up, bench.link.down_reason
        return first, await bench.converge(words), bench.far_first(), bench.exports()

    bench = PairBench(tmp_path, family=family, near_mode=near_mode)
    first, second, far_first, exports = on(bench, act)
    changed = {result.name for result in first if result.status is Status.CHANGED}
    assert changed, [result.message for result in first]
    assert {result.status for result in first} <= {Status.CHANGED, Status.UNCHANGED}, [r.message for r in first]
    assert [result.status for result in second] == [Status.UNCHANGED] * 2
    assert far_first or "far" not in changed
    assert not any("atlantis-pair" in export for export in exports)
    kept = bench.store.last_confirmed("quay", ("near", "far"))
    assert kept.keys() == {"near", "far"}, "what was read back is there for drift and for a replacement"
    assert all(words.key not in state.text() for state in kept.values() if words.key)


@pytest.mark.smoke
def test_progress_of_a_finished_end_is_complete(tmp_path: Path) -> None:
    async def act(bench: PairBench) -> list[tuple[str, int, int]]:
        await bench.converge(CHANGES["name"])
        return [(event.device, event.done_count, event.total) for event in bench.events if event.stage == "confirmed"]

    ended = on(PairBench(tmp_path), act)
    assert {device for device, _, _ in ended} == {"near", "far"}
    assert all(done == total > 0 for _, done, total in ended), ended


@pytest.mark.parametrize("change", ["nothing", "identity", "name"])
def test_result_counts_every_session_of_its_end(tmp_path: Path, change: str) -> None:
    """Also those in which both were read as a pair, before they were changed one by one."""
    words = CHANGES["name"] if change == "name" else Words()

    async def act(bench: PairBench) -> None:
        async with AsyncExitStack() as stack:
            jobs: list[DeviceJob] = []
            proxies: list[Proxy] = []
            journal = stack.enter_context(bench.journal())
            for name in ("near", "far"):
                job = bench.job(name, words, journal=journal)
                door = (job.endpoint.host, job.endpoint.port)
                proxies.append(await stack.enter_async_context(Proxy("127.0.0.1", 0, door, Shape(0.05))))
                host, port = proxies[-1].address
                desired = read(text(bench.family, bench.mode(name), words) + IDENTITY[change])
                endpoint = replace(job.endpoint, host=host, port=port)
                jobs.append(replace(job, endpoint=endpoint, desired_state=desired))
            near, far = jobs
            results = await converge_pair(Pair(near, far, link_timeout_s=LINK_TIMEOUT_S))
            counts = [proxy.count for proxy in proxies]
        status = Status.UNCHANGED if change == "nothing" else Status.CHANGED
        for result, count in zip(results, counts, strict=True):
            assert result.status is status, result.message
            assert result.sessions == count.connections
            assert result.round_trips == pytest.approx(count.round_trips, rel=0.1)
            assert result.sent_bytes == pytest.approx(count.sent, rel=0.1)
            assert result.received_bytes == pytest.approx(count.received, rel=0.1)

    on(PairBench(tmp_path), act)


IDENTITY = {"nothing": "", "name": "", "identity": "/system identity\nset name=another\n"}
