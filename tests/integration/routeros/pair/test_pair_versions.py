"""A bridge of which one end is too old for its protection: refused, with what to type at that end alone."""

from pathlib import Path

import pytest
from pair_bench import PairBench, Words, on

from atlantis_netcfg.routeros import DeviceResult, Status


@pytest.mark.parametrize("old", ["near", "far"])
def test_an_end_without_safe_mode_has_a_hint(tmp_path: Path, old: str) -> None:
    bench = PairBench(
        tmp_path,
        near_spec={"version": "7.17.1"} if old == "near" else {},
        far_spec={"version": "7.17.1"} if old == "far" else {},
    )

    async def act(bench: PairBench) -> tuple[tuple[DeviceResult, DeviceResult], bool]:
        before = bench.exports()
        return await bench.converge(Words(ssid="another")), before == bench.exports()

    results, as_before = on(bench, act)
    assert as_before
    for result in results:
        assert result.status is Status.REFUSED
        assert f"{old}: RouterOS 7.17.1 has no safe mode over the API; 7.18 and later have it" in result.message
        if result.name == old:
            assert result.hint is not None
            assert (
                f"install RouterOS 7.18 or later on it: `provision device upgrade site=quay device={old} packages="
                in result.hint
            )
        else:
            assert result.hint is None
