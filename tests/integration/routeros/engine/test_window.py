"""How many questions a device bears at once: as many as it takes, or few, which is found out once and remembered."""

from dataclasses import replace
from pathlib import Path

from engine_bench import Bench, on

from atlantis_netcfg.emulator.routeros import WireBehaviour
from atlantis_netcfg.routeros import DeviceResult, JobMode, Status
from atlantis_netcfg.routeros.api import WINDOW

NOTE = "the device stopped responding to more than 24 requests at once"


def twice(tmp_path: Path, knobs: WireBehaviour) -> tuple[DeviceResult, DeviceResult, list[bool]]:
    """Converge two times, the second time with what the first has taught."""

    async def act(bench: Bench) -> tuple[DeviceResult, DeviceResult, list[bool]]:
        told: list[bool] = []
        endpoint = replace(bench.job().endpoint, on_window_shrink=lambda: told.append(True))
        first = await bench.converge(endpoint=endpoint)
        known = replace(endpoint, window=WINDOW) if told else endpoint
        return first, await bench.converge(endpoint=known), told

    return on(Bench(tmp_path, knobs=knobs), act)


def test_capable_device_is_read_in_one_batch(tmp_path: Path) -> None:
    first, second, told = twice(tmp_path, WireBehaviour())
    assert (first.status, second.status) == (Status.CHANGED, Status.UNCHANGED)
    assert not told
    assert second.round_trips == 5
    assert not [note for note in (*first.notes, *second.notes) if NOTE in note]


def test_hanging_device_is_read_in_smaller_batches_and_noted(tmp_path: Path) -> None:
    first, second, told = twice(tmp_path, WireBehaviour(hang_at=25))
    assert (first.status, second.status) == (Status.CHANGED, Status.UNCHANGED), first.message
    assert told == [True]
    assert [note for note in first.notes if NOTE in note]
    # What was learnt holds for the verifying session, too: only the first reading was waited for in vain.
    assert 180 <= first.seconds < 200
    assert second.round_trips == 6
    assert not [note for note in second.notes if NOTE in note]


def test_plan_notes_smaller_batches_too(tmp_path: Path) -> None:
    async def act(bench: Bench) -> DeviceResult:
        return await bench.converge(JobMode.PLAN)

    result = on(Bench(tmp_path, knobs=WireBehaviour(hang_at=25)), act)
    assert result.status is Status.PLANNED
    assert [note for note in result.notes if NOTE in note]
