"""Which run a rollback goes back to, and which state stands for a device when that is rehearsed."""

from dataclasses import dataclass
from pathlib import Path

import pytest

from atlantis_netcfg.core.errors import NoMatchError
from atlantis_netcfg.inventory import Inventory
from atlantis_netcfg.operations.common.saved_states import before_resuming, before_rollback, hosts_of_run, saved_run
from atlantis_netcfg.operations.restore import confirmed_state
from atlantis_netcfg.runs import ActionConfirmation, NoSuchRun, Run, RunStart, Store

ROUTER = "coastal-router"


@dataclass
class Laptop:
    """A state folder in which runs are recorded."""

    state: Path

    def run(  # noqa: PLR0913 - each is something that a run may have recorded
        self,
        name: str = "",
        *,
        rehearsed: bool = False,
        saves: str = "",
        confirms: str = "",
        actions: int = 0,
        back_to: str | None = None,
        prepares: bool = False,
    ) -> Run:
        store = Store(self.state, is_rehearsal=rehearsed)
        started = RunStart(
            site="coastal",
            revision="",
            tool="",
            hosts=(ROUTER,),
            rehearsed=rehearsed,
            command="provision site=coastal",
            back_to=back_to,
            prepares=prepares,
        )
        with store.start(started, name) as journal:
            if saves:
                journal.save(ROUTER, saves)
            if actions:
                journal.write(ActionConfirmation(device=ROUTER, actions=tuple(range(actions))))
            if confirms:
                journal.confirm(ROUTER, lambda: confirms)
        return store.run("coastal", journal.run)


@pytest.fixture
def laptop(tmp_path: Path) -> Laptop:
    return Laptop(tmp_path)


def test_latest_is_the_newest_run_with_a_saved_state(laptop: Laptop) -> None:
    laptop.run(saves="a")
    newer = laptop.run(saves="b")
    laptop.run()
    assert saved_run(laptop.state, "coastal", "latest", [ROUTER]).id == newer.id
    with pytest.raises(NoMatchError, match="no run of coastal has a saved state of coastal-cpe, coastal-4g"):
        saved_run(laptop.state, "coastal", "latest", ["coastal-cpe", "coastal-4g"])


def test_preparation_of_emulated_devices_is_not_the_latest_run(laptop: Laptop) -> None:
    """Nobody asked for it: `use`, `links` and the checklist rehearse on configured devices."""
    run = laptop.run(saves="a", rehearsed=True)
    laptop.run(saves="b", rehearsed=True, prepares=True)
    assert saved_run(laptop.state, "coastal", "latest", [ROUTER], is_rehearsal=True).id == run.id


def test_a_rollback_is_not_the_latest_run(laptop: Laptop) -> None:
    """Else who types it twice would be where it began, and so would a rollback that was stopped and typed again."""
    run = laptop.run(saves="a")
    rollback = laptop.run(saves="b", back_to=run.id)
    assert saved_run(laptop.state, "coastal", "latest", [ROUTER]).id == run.id
    assert saved_run(laptop.state, "coastal", rollback.id, [ROUTER]).id == rollback.id


def test_real_rollback_never_uses_a_rehearsal(laptop: Laptop) -> None:
    emulated = laptop.run(rehearsed=True, saves="a")
    with pytest.raises(NoMatchError):
        saved_run(laptop.state, "coastal", "latest", [ROUTER])
    with pytest.raises(NoSuchRun):
        saved_run(laptop.state, "coastal", emulated.id)
    for name in ("latest", emulated.id):
        found = saved_run(laptop.state, "coastal", name, [ROUTER], is_rehearsal=True)
        assert found.directory == emulated.directory


def test_rehearsal_prefers_real_runs(laptop: Laptop) -> None:
    real = laptop.run(saves="a")
    laptop.run(rehearsed=True, saves="b")
    laptop.run(rehearsed=True, saves="c")
    assert saved_run(laptop.state, "coastal", "latest", [ROUTER], is_rehearsal=True).directory == real.directory


def test_unknown_run_lists_the_runs_of_the_real_site_first(laptop: Laptop) -> None:
    with pytest.raises(NoSuchRun):
        saved_run(laptop.state, "coastal", "1999", is_rehearsal=True)
    emulated = laptop.run(rehearsed=True)
    with pytest.raises(NoSuchRun) as refused:
        saved_run(laptop.state, "coastal", "1999", is_rehearsal=True)
    assert emulated.id in str(refused.value.hint)
    real = laptop.run()
    with pytest.raises(NoSuchRun) as refused:
        saved_run(laptop.state, "coastal", "1999", is_rehearsal=True)
    assert str(refused.value.hint) == f"its latest runs: {real.id}"


def test_last_confirmed_state_is_used_for_the_device(laptop: Laptop, declaration: Inventory) -> None:
    hosts = [declaration.hosts[ROUTER]]
    run = laptop.run(saves="a", confirms="b")
    (start,) = before_rollback(laptop.state, hosts, run)
    assert (start.restore, start.back_to, start.is_ready) == (run.id, None, False)
    assert f"verified by run {run.id} at " in start.words
    later = laptop.run(confirms="c")
    (start,) = before_rollback(laptop.state, hosts, run)
    assert start.restore == later.id
    assert start.gap == f"changes on {ROUTER} since run {later.id} verified it"


def test_emulated_state_is_not_used_for_a_real_device(laptop: Laptop, declaration: Inventory) -> None:
    hosts = [declaration.hosts[ROUTER]]
    emulated = laptop.run(rehearsed=True, saves="a", confirms="b")
    real = laptop.run(saves="a")
    (start,) = before_rollback(laptop.state, hosts, real)
    assert (start.restore, start.back_to, start.is_ready) == (None, None, False)
    assert "the inventory is used instead" in start.gap
    (start,) = before_rollback(laptop.state, hosts, emulated)
    assert start.restore == emulated.id


def test_state_of_a_named_rehearsal_is_found_among_real_runs(laptop: Laptop, declaration: Inventory) -> None:
    emulated = laptop.run("20261121T093000Z", rehearsed=True, confirms="emulated")
    laptop.run("20261122T093000Z", confirms="real")
    host = declaration.hosts[ROUTER]
    assert confirmed_state(laptop.state, host, "latest", is_rehearsal=True).text() == "real"
    assert confirmed_state(laptop.state, host, emulated.id, is_rehearsal=True).text() == "emulated"
    with pytest.raises(NoMatchError):
        confirmed_state(laptop.state, host, "1999", is_rehearsal=True)


def test_interrupted_run_resumes_from_the_state_before_it(laptop: Laptop, declaration: Inventory) -> None:
    hosts = [declaration.hosts[ROUTER]]
    earlier = laptop.run(confirms="a")
    broken = laptop.run(saves="b", actions=7)
    (start,) = before_resuming(laptop.state, hosts, broken)
    assert (start.back_to, start.restore) == (broken.id, None)
    assert "the 7 actions that it had confirmed are repeated" in start.words
    untouched = laptop.run()
    (start,) = before_resuming(laptop.state, hosts, untouched)
    assert (start.back_to, start.restore) == (None, earlier.id)


def test_device_without_saved_state_starts_as_adopted(laptop: Laptop, declaration: Inventory) -> None:
    (start,) = before_resuming(laptop.state, [declaration.hosts[ROUTER]], laptop.run())
    assert (start.back_to, start.restore, start.is_ready) == (None, None, True)
    assert "starts as after adoption" in start.words


def test_computer_starts_as_a_fresh_one(laptop: Laptop, declaration: Inventory) -> None:
    broken = laptop.run(saves="a")
    gateway, router = before_resuming(
        laptop.state, [declaration.hosts["coastal-gateway"], declaration.hosts[ROUTER]], broken
    )
    assert (gateway.is_ready, router.is_ready) == (True, False)
    assert gateway.gap == f"what run {broken.id} left on coastal-gateway: the factory state is used instead"


def test_hosts_of_a_run(declaration: Inventory) -> None:
    hosts = [declaration.hosts[name] for name in (ROUTER, "coastal-cpe")]
    assert [host.name for host in hosts_of_run(hosts, ["coastal-cpe", "gone"])] == ["coastal-cpe"]
    with pytest.raises(NoMatchError, match="nothing to do for any device of that run"):
        hosts_of_run(hosts, ["gone"])


def test_killed_rehearsal_is_resumed_as_a_rehearsal(laptop: Laptop) -> None:
    emulated, real = laptop.run(rehearsed=True), laptop.run()
    assert emulated.next_command == f"provision recover resume site=coastal run={emulated.id} --rehearse"
    assert real.next_command == f"provision recover resume site=coastal run={real.id}"
