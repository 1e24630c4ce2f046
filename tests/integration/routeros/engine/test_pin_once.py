"""A PIN reaches a SIM only while it asks, and a wrong one at most once, however often the run is repeated."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from engine_bench import Bench, on

from atlantis_netcfg.emulator.routeros import CellSpec, ModemSpec, SimSpec
from atlantis_netcfg.emulator.routeros.core import SimState
from atlantis_netcfg.operations.common.terminals import PinRecorder, TriedPin
from atlantis_netcfg.routeros import DeviceResult, JobMode, converge
from atlantis_netcfg.routeros.apply import Patience
from atlantis_netcfg.runs import NoJournal

TEXT = """\
/system identity
set name=box
/interface lte apn
add apn=umts comment="atlantis: contract" name=atlantis use-network-apn=no
/interface lte
set [ find default-name=lte1 ] apn-profiles=atlantis comment="atlantis: 4G" disabled=no pin={pin}
"""


def bench(tmp_path: Path, pin: str, *, asks: str = "73951846", version: str = "7.18.2") -> Bench:
    modem = ModemSpec(sim=SimSpec(pin=asks), cell=CellSpec(apns=("umts",)))
    return Bench(tmp_path, TEXT.format(pin=pin), spec={"modem": modem, "version": version})


async def once(bench: Bench, mode: JobMode = JobMode.APPLY, **changes: Any) -> DeviceResult:  # noqa: ANN401 - fields of DeviceJob
    """A run as `operations.jobs` makes it."""
    tried = TriedPin(bench.store.root, "coastal", "router")
    with bench.journal() as journal:
        job = bench.job(journal=PinRecorder(journal, tried), **changes)
        return await converge(
            replace(job, desired_state=replace(job.desired_state, pin_refusal=tried.why_not)), mode=mode
        )


def card(bench: Bench) -> tuple[int, int]:
    sim = bench.router.device.core.sim
    return sim.tries_left, sim.pins_entered


def tried(bench: Bench) -> bool:
    return TriedPin(bench.store.root, "coastal", "router").path.exists()


@pytest.mark.smoke("7.18.2")
@pytest.mark.parametrize("version", ["7.17.1", "7.18.2", "7.21.5"])
def test_a_right_pin_is_sent_once_and_the_second_run_changes_nothing(tmp_path: Path, version: str) -> None:
    async def act(bench: Bench) -> None:
        first = await once(bench, allows_unprotected=True)
        assert (first.status, card(bench), tried(bench)) == ("changed", (3, 1), False)
        assert "73951846" not in first.diff + first.message
        second = await once(bench)
        assert (second.status, second.planned_count, card(bench)) == ("unchanged", 0, (3, 1))

    on(bench(tmp_path, "73951846", version=version), act)


@pytest.mark.smoke("7.18.2")
@pytest.mark.parametrize("version", ["7.17.1", "7.18.2", "7.21.5"])
def test_a_wrong_pin_reaches_the_sim_once_over_many_runs(tmp_path: Path, version: str) -> None:
    async def act(bench: Bench) -> None:
        before = bench.export()
        first = await once(bench, allows_unprotected=True)
        assert first.status == "rolled-back"
        assert "the SIM refused the PIN; it will not be tried again" in first.message
        assert (card(bench), tried(bench)) == ((2, 1), True)
        assert bench.export() == before
        for _ in range(2):
            again = await once(bench)
            assert again.status == "refused"
            assert "but the SIM did not confirm it; it is not retried" in again.message
            assert str(TriedPin(bench.store.root, "coastal", "router").path) in again.message
        assert card(bench) == (2, 1)
        assert "99887766" not in first.message + again.message + first.diff
        bench.router.device.reboot()
        assert (await once(bench)).status == "refused"
        assert card(bench) == (2, 1)

    on(bench(tmp_path, "99887766", version=version), act)


@pytest.mark.smoke("99887766-rolled-back-entered1-ether9")
@pytest.mark.parametrize("name", ["starlink", "ether9"])
@pytest.mark.parametrize(
    ("pin", "status", "entered"), [("73951846", "changed", (3, 1)), ("99887766", "rolled-back", (2, 1))]
)
def test_renamed_modem_gets_the_pin_at_most_once(
    tmp_path: Path, name: str, pin: str, status: str, entered: tuple[int, int]
) -> None:
    """Its identity is its default name; by `lte1` it says nothing of its PIN, and none would be sent."""

    async def act(bench: Bench) -> None:
        await bench.router.console(["/interface/lte/set", "=.id=lte1", f"=name={name}"])
        first = await once(bench)
        assert (first.status, card(bench)) == (status, entered)
        second = await once(bench)
        assert (second.status, card(bench)) == ("unchanged" if status == "changed" else "refused", entered)

    on(bench(tmp_path, pin), act)


def test_corrected_pin_is_sent_after_the_record_is_deleted(tmp_path: Path) -> None:
    async def act(bench: Bench) -> None:
        await once(bench)
        bench.text = TEXT.format(pin="73951846")
        assert (await once(bench)).status == "refused"
        TriedPin(bench.store.root, "coastal", "router").path.unlink()
        assert (await once(bench)).status == "changed"
        assert (card(bench), tried(bench)) == ((3, 2), False)

    on(bench(tmp_path, "99887766"), act)


def test_no_file_holds_the_pin(tmp_path: Path) -> None:
    async def act(bench: Bench) -> None:
        assert (await once(bench)).status == "changed"
        files = [path for path in bench.store.root.rglob("*") if path.is_file()]
        assert any(path.name == "journal.jsonl" for path in files)
        assert [path for path in files if b"90210768" in path.read_bytes()] == []

    on(bench(tmp_path, "90210768", asks="90210768"), act)


def test_sim_without_pin_request_gets_none(tmp_path: Path) -> None:
    async def act(bench: Bench) -> None:
        assert (await once(bench)).status == "changed"
        assert (card(bench), tried(bench)) == ((3, 0), False)
        assert "99887766" not in bench.export()
        assert (await once(bench)).status == "unchanged"

    on(bench(tmp_path, "99887766", asks=""), act)


def test_a_sim_that_waits_for_its_puk_gets_nothing(tmp_path: Path) -> None:
    async def act(bench: Bench) -> None:
        bench.router.device.core.sim.tries_left = 0
        found = await once(bench)
        assert found.status == "refused"
        assert "asks for its PUK" in found.message
        assert card(bench) == (0, 0)

    on(bench(tmp_path, "73951846"), act)


def test_a_plan_sends_nothing(tmp_path: Path) -> None:
    async def act(bench: Bench) -> None:
        found = await once(bench, JobMode.PLAN)
        assert found.planned_count == 3
        assert "pin=********" in found.diff
        assert (card(bench), tried(bench)) == ((3, 0), False)

    on(bench(tmp_path, "99887766"), act)


def test_pin_is_not_sent_if_the_attempt_cannot_be_recorded(tmp_path: Path) -> None:
    async def act(bench: Bench) -> None:
        path = TriedPin(bench.store.root, "coastal", "router").path
        path.parent.parent.mkdir(parents=True, exist_ok=True)
        path.parent.symlink_to("nowhere")  # in the way of its folder
        found = await once(bench)
        assert found.status == "left-as-found"
        assert "cannot record the PIN attempt:" in found.message
        assert card(bench) == (3, 0)

    on(bench(tmp_path, "73951846"), act)


def test_pin_is_removed_if_the_modem_does_not_accept_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As if the modem never came back after it was given the PIN."""
    heard: list[str] = []

    def deaf(sim: SimState, given: str, _right: str) -> None:
        sim.tried_pin = given
        heard.append(given)

    monkeypatch.setattr(SimState, "enter", deaf)

    async def act(bench: Bench) -> None:
        found = await converge(bench.job(journal=NoJournal(), patience=Patience(modem_s=30)))
        assert found.status == "rolled-back"
        assert "the modem did not accept the PIN within 30 s" in found.message
        assert heard == ["73951846"]
        assert "pin=73951846" not in bench.export()

    on(bench(tmp_path, "73951846"), act)
