"""What takes a change back below RouterOS 7.18: safe mode of a console, a dead-man job, or nobody."""

import asyncio
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from engine_bench import TEXT, Bench, Meddler, leases, on

from atlantis_netcfg.core.errors import ExitCode
from atlantis_netcfg.emulator.routeros import DeviceMode, FaultKind, LinkFault, WireBehaviour
from atlantis_netcfg.emulator.routeros import DeviceModeName as TwinMode
from atlantis_netcfg.routeros import DeviceResult, JobMode, Patience, Status
from atlantis_netcfg.runs import ProtectionRecord

pytestmark = pytest.mark.slow

HOME = DeviceMode(mode=TwinMode.HOME)
LAST = '/tool mac-server ping\nset enabled=no\n/ip ssh\nset host-key-type="ed25519 of another kind"\n'
"""A value that the router refuses, in the last layer."""
SHUT = TEXT.replace("set telnet disabled=yes\n", "set telnet disabled=yes\nset api-ssl disabled=yes\n")
JOB, CONSOLE = "dead-man", "console-safe-mode"


async def left_behind(bench: Bench) -> tuple[int, bool]:
    """Jobs and signs of ours that are still on the router."""
    jobs = await bench.router.console(["/system/scheduler/print"])
    lists = await bench.router.console(["/ip/firewall/address-list/print"])
    return str(jobs).count("atlantis-dead-man"), "atlantis-run" in str(lists)


async def twice(bench: Bench, **changes: Any) -> list[Any]:  # noqa: ANN401 - fields of DeviceJob
    planned = await bench.converge(JobMode.PLAN, **changes)
    return [planned, await bench.converge(**changes), await bench.converge(**changes), await left_behind(bench)]


def converged(bench: Bench, protection: str, words: str, *, ssh: bool) -> None:
    """Converge twice, under the protection that the plan has told."""

    async def act(bench: Bench) -> list[Any]:
        return await twice(bench, **({"ssh": bench.ssh} if ssh else {}))

    planned, first, second, left = on(bench, act)
    assert (planned.status, planned.protection_words) == (Status.PLANNED, words)
    assert (first.status, first.protection) == (Status.CHANGED, protection), first.message
    assert (second.status, second.planned_count) == (Status.UNCHANGED, 0)
    assert left == (0, False)
    run = bench.store.runs("coastal")[1]
    assert [record.how.split()[0] for record in run.log.records if isinstance(record, ProtectionRecord)][:1] == [
        protection
    ]
    assert first.as_dict()["protection_words"] == words


NO_SSH = (
    "no safe mode: RouterOS before 7.18 has safe mode on a console only, and the inventory has no SSH for this device"
)


@pytest.mark.smoke
def test_safe_mode_of_the_api_session(tmp_path: Path) -> None:
    converged(Bench(tmp_path), "safe-mode", "safe mode of the API session", ssh=True)


@pytest.mark.smoke("7.16")
@pytest.mark.parametrize("version", ["7.16", "7.17.1", "6.49.19"])
def test_safe_mode_of_a_console_and_a_job(tmp_path: Path, version: str) -> None:
    words = "safe mode of an SSH session and a dead-man job, 22 min"
    converged(Bench(tmp_path, spec={"version": version}), CONSOLE, words, ssh=True)


@pytest.mark.parametrize(("version", "status"), [("7.16", Status.REFUSED), ("7.18.2", Status.CHANGED)])
def test_safe_mode_of_a_console_needs_the_ssh_policy(tmp_path: Path, version: str, status: Status) -> None:
    seed = "/user group set full policy=local,telnet,ftp,reboot,read,write,policy,test,winbox,web,sniff,sensitive,api"
    bench = Bench(tmp_path, spec={"version": version, "seed": seed})
    result = on(bench, lambda bench: bench.converge(ssh=bench.ssh))
    assert result.status is status
    assert ("our user lacks the permissions ssh: its group needs these policies" in result.message) is (
        status is Status.REFUSED
    )


def test_safe_mode_of_a_console_alone_in_device_mode_home(tmp_path: Path) -> None:
    bench = Bench(tmp_path, spec={"version": "7.17.1", "device_mode": HOME})
    words = "safe mode of an SSH session (no dead-man job: device-mode home forbids the scheduler)"
    converged(bench, CONSOLE, words, ssh=True)


@pytest.mark.smoke("7.12.2")
@pytest.mark.parametrize("version", ["7.9", "7.12.2", "7.16", "7.17.1", "6.49.19"])
def test_dead_man_job_alone(tmp_path: Path, version: str) -> None:
    bench = Bench(tmp_path, spec={"version": version})
    converged(bench, JOB, f"a dead-man job, 10 min ({NO_SSH})", ssh=False)


def test_a_plan_of_several_pieces(tmp_path: Path) -> None:
    bench = Bench(tmp_path, text=TEXT + leases(90), spec={"version": "7.16"})
    converged(bench, CONSOLE, "safe mode of an SSH session and a dead-man job, 22 min", ssh=True)


@pytest.mark.smoke
def test_unpinned_host_key_is_refused(tmp_path: Path) -> None:
    bench = Bench(tmp_path, spec={"version": "7.17.1", "device_mode": HOME})

    async def act(bench: Bench) -> DeviceResult:
        return await bench.converge(ssh=replace(bench.ssh, pin=None))

    result = on(bench, act)
    assert (result.status, result.exit) == (Status.REFUSED, ExitCode.FAILED)
    assert "and the SSH host key is not pinned" in result.message


@pytest.mark.smoke
def test_changed_host_key_changes_nothing(tmp_path: Path) -> None:
    """No password is sent to it, and nothing is changed."""
    bench = Bench(tmp_path, spec={"version": "7.16"})

    async def act(bench: Bench) -> tuple[DeviceResult, bool, tuple[int, bool]]:
        before, ssh = bench.export(), bench.ssh
        bench.router.rekey()
        result = await bench.converge(ssh=ssh)
        return result, bench.export() == before, await left_behind(bench)

    result, same, left = on(bench, act)
    assert (result.status, same, left) == (Status.LEFT_AS_FOUND, True, (0, False))
    assert "the SSH host key is not the one of this device" in result.message


# --- what goes wrong -----------------------------------------------------------------------------------------------


async def tried(bench: Bench, **changes: Any) -> tuple[DeviceResult, bool, tuple[int, bool], DeviceResult]:  # noqa: ANN401
    """Converge; whether the router is as before, what is left on it; and the next run, resumed."""
    before = bench.export()
    result = await bench.converge(**changes)
    same, left = bench.export() == before, await left_behind(bench)
    bench.router.disarm()
    resumed = await bench.converge(JobMode.RESUME, **changes)
    return result, same, left, resumed


@pytest.mark.smoke("7.16-job")
@pytest.mark.parametrize("ssh", [True, False], ids=["console", "job"])
@pytest.mark.parametrize("version", ["7.16", "6.49.19"])
def test_refused_line_is_rolled_back(tmp_path: Path, version: str, ssh: bool) -> None:  # noqa: FBT001
    bench = Bench(tmp_path, text=TEXT + LAST, spec={"version": version})

    async def act(bench: Bench) -> Any:  # noqa: ANN401
        return await tried(bench, **({"ssh": bench.ssh} if ssh else {}))

    result, same, left, again = on(bench, act)
    assert (result.status, same, left) == (Status.ROLLED_BACK, True, (0, False)), result.message
    assert again.status is Status.ROLLED_BACK


@pytest.mark.parametrize("ssh", [True, False], ids=["console", "job"])
def test_blocked_new_sessions_are_rolled_back(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, ssh: bool) -> None:  # noqa: FBT001
    monkeypatch.setattr("atlantis_netcfg.routeros.guard.objections", lambda *_: ())
    bench = Bench(tmp_path, text=SHUT, spec={"version": "7.16"})

    async def act(bench: Bench) -> Any:  # noqa: ANN401
        return await tried(bench, **({"ssh": bench.ssh} if ssh else {}))

    result, same, left, _ = on(bench, act)
    assert (result.status, same, left) == (Status.ROLLED_BACK, True, (0, False)), result.message


@pytest.mark.smoke("/execute-3-console-drop")
@pytest.mark.parametrize("kind", [FaultKind.DROP, FaultKind.VANISH, FaultKind.REBOOT])
@pytest.mark.parametrize("ssh", [True, False], ids=["console", "job"])
@pytest.mark.parametrize(("path", "nth"), [("/execute", 3), ("/ip/address/print", 3), ("/system/scheduler/remove", 1)])
def test_interrupted_session_ends_consistently_and_resumes(
    tmp_path: Path,
    kind: FaultKind,
    ssh: bool,  # noqa: FBT001
    path: str,
    nth: int,
) -> None:
    # A console that is opened again waits for a reboot in real time.
    bench = Bench(tmp_path, spec={"version": "7.16"}, knobs=WireBehaviour(boot_s=2.0))

    async def act(bench: Bench) -> Any:  # noqa: ANN401
        bench.router.arm(LinkFault(do=kind, match=path, sentence=nth, when="after"))
        return await tried(bench, **({"ssh": bench.ssh} if ssh else {}))

    result, same, left, resumed = on(bench, act)
    assert result.status in (Status.ROLLED_BACK, Status.CHANGED, Status.LEFT_AS_FOUND), result.message
    assert same == (result.status is not Status.CHANGED)
    assert left[0] == 0
    assert resumed.status is (Status.UNCHANGED if result.status is Status.CHANGED else Status.CHANGED), resumed.message


def _consoles(bench: Bench) -> list[Any]:
    return [each for each in bench.router._board.connections if type(each).__name__ == "SshConnection"]


@pytest.mark.parametrize(("how", "nth"), [("drop", 2), ("drop", 3), ("drop", 4), ("vanish", 3)])
def test_the_console_dies_while_the_api_lives(tmp_path: Path, how: str, nth: int) -> None:
    bench = Bench(tmp_path, spec={"version": "7.16"})

    async def act(bench: Bench) -> Any:  # noqa: ANN401
        async def die() -> None:
            for connection in _consoles(bench):
                getattr(connection, how)()

        meddler = Meddler("/ip/pool/print", die, nth=nth)
        patience = Patience(verify_s=2.0)  # a silent console is waited for in real time
        return await tried(bench, ssh=bench.ssh, connect=meddler.connect, patience=patience)

    result, same, left, resumed = on(bench, act)
    assert result.status in (Status.ROLLED_BACK, Status.CHANGED, Status.LEFT_AS_FOUND), result.message
    assert (same, left) == (result.status is not Status.CHANGED, (0, False))
    assert resumed.status is (Status.UNCHANGED if result.status is Status.CHANGED else Status.CHANGED)


async def die_armed(bench: Bench) -> DeviceResult:
    """Let the laptop die after its last script: the dead-man job and the sign of the run stay."""
    bench.router.arm(LinkFault(do=FaultKind.VANISH, match="/execute", sentence=3, when="after"))
    dead = await bench.converge(patience=Patience(reach_s=0, undo_s=0))
    bench.router.disarm()
    return dead


@pytest.mark.smoke
def test_remaining_dead_man_job_rolls_the_router_back(tmp_path: Path) -> None:
    """The router is not as declared: it returns by itself, and a later run is told before that."""
    bench = Bench(tmp_path, spec={"version": "7.16"})

    async def act(bench: Bench) -> tuple[DeviceResult, DeviceResult, DeviceResult, bool, float]:
        before = bench.export()
        dead = await die_armed(bench)
        await bench.router.console(["/system/identity/set", "=name=half-way"])
        told = await bench.converge(JobMode.PLAN)
        refused = await bench.converge(run="another")
        clock = asyncio.get_running_loop().time
        begun = clock()
        resumed = await bench.converge(JobMode.RESUME)
        waited = clock() - begun
        assert told.notes
        assert bench.export() != before
        return dead, refused, resumed, resumed.status is Status.CHANGED, waited

    dead, refused, resumed, changed, waited = on(bench, act)
    assert dead.status is Status.UNKNOWN
    assert dead.hint is not None
    assert "the dead-man job rolls everything back within 10 minutes" in dead.hint
    assert refused.status is Status.LEFT_AS_FOUND
    assert "provision@10.64.101.10" in refused.message
    assert changed, resumed.message
    assert 300 < waited < 700


UPGRADED = {"version": "7.18.2"}
"""A router with safe mode for programs may still have the job of a run that came before its upgrade."""
OURS = "=comment=a run of provision@10.64.101.10"
JOB_ROW = ["/system/scheduler/add", "=name=atlantis-dead-man", "=interval=10m", OURS]


@pytest.mark.parametrize("mode", [JobMode.APPLY, JobMode.RESUME])
def test_leftovers_of_a_dead_run_are_removed_on_a_converged_router(tmp_path: Path, mode: JobMode) -> None:
    """The script had been executed: nothing is waited for, and nothing is taken back later."""

    async def act(bench: Bench) -> tuple[list[DeviceResult], list[tuple[int, bool]], bool]:
        await die_armed(bench)
        left = [await left_behind(bench)]
        told = [await bench.converge(JobMode.PLAN), await bench.converge(JobMode.DRIFT)]
        results = [*told, await bench.converge(mode), await bench.converge()]
        left.append(await left_behind(bench))
        as_declared = bench.export()
        await asyncio.sleep(1300)
        return results, left, bench.export() == as_declared

    (plan, drift, first, second), left, stays = on(Bench(tmp_path, spec={"version": "7.16"}), act)
    assert left[0][0] > 0
    assert left[0][1]
    assert left[1] == (0, False), first.message
    assert (plan.status, plan.exit, plan.planned_count) == (Status.PLANNED, ExitCode.CHANGES, 0)
    assert "the job atlantis-dead-man of a run of provision@10.64.101.10 is armed" in plan.message
    assert drift.exit is ExitCode.CHECKS_FAILED
    assert drift.comparison is not None
    assert [(one.subject, one.kind) for one in drift.comparison.drift] == [
        ("atlantis-run", "open"),
        ("atlantis-dead-man", "open"),
    ]
    assert (first.status, first.exit) == (Status.CHANGED, ExitCode.DONE), first.message
    assert "removed the job atlantis-dead-man of a run of provision@10.64.101.10 and the marker of" in first.message
    assert (second.status, stays) == (Status.UNCHANGED, True), second.message


def test_job_on_a_router_upgraded_to_safe_mode_is_removed(tmp_path: Path) -> None:
    """It would take back what a later run has confirmed."""

    async def act(bench: Bench) -> tuple[list[DeviceResult], tuple[int, bool]]:
        await bench.converge()
        await bench.router.console([*JOB_ROW, "=on-event=:put 1"])
        results = [await bench.converge(each) for each in (JobMode.PLAN, JobMode.DRIFT)]
        return [*results, await bench.converge(), await bench.converge()], await left_behind(bench)

    (plan, drift, first, second), left = on(Bench(tmp_path, spec=UPGRADED), act)
    assert [plan.exit, drift.exit] == [ExitCode.CHANGES, ExitCode.CHECKS_FAILED]
    assert (first.status, left) == (Status.CHANGED, (0, False)), first.message
    assert second.status is Status.UNCHANGED


def test_the_job_of_a_run_that_may_be_alive_is_left_alone(tmp_path: Path) -> None:
    """Another laptop's, of which our journal knows nothing."""

    async def act(bench: Bench) -> tuple[DeviceResult, tuple[int, bool]]:
        await bench.converge()
        stranger = "=comment=run 20260101T000000Z of provision@10.64.101.99"
        await bench.router.console([*JOB_ROW[:-1], stranger, "=on-event=:put 1"])
        return await bench.converge(), await left_behind(bench)

    result, left = on(Bench(tmp_path, spec=UPGRADED), act)
    assert (result.status, result.exit, left) == (Status.LEFT_AS_FOUND, ExitCode.FAILED, (1, False))
    assert "run 20260101T000000Z of provision@10.64.101.99 is armed" in result.message


def test_check_for_armed_jobs_costs_no_round_trip(tmp_path: Path) -> None:
    """Below 7.18 it was a question of its own; now it goes beside the others, in a few bytes."""

    async def act(bench: Bench) -> tuple[DeviceResult, DeviceResult]:
        await bench.converge()
        return await bench.converge(), await bench.converge(JobMode.DRIFT)

    old = on(Bench(tmp_path / "old", spec={"version": "7.16"}), act)
    new = on(Bench(tmp_path / "new"), act)
    assert {each.status for each in (*old, *new)} == {Status.UNCHANGED}
    assert len({each.round_trips for each in (*old, *new)}) == 1


@pytest.mark.parametrize("when", ["before", "after"])
@pytest.mark.parametrize(("path", "nth"), [("/system/scheduler/add", 1), ("/system/scheduler/print", 2)])
def test_unconfirmed_job_is_removed(tmp_path: Path, path: str, nth: int, when: str) -> None:
    async def act(bench: Bench) -> tuple[DeviceResult, tuple[int, bool]]:
        bench.router.arm(LinkFault.model_validate({"do": FaultKind.DROP, "match": path, "sentence": nth, "when": when}))
        return await bench.converge(), await left_behind(bench)

    result, left = on(Bench(tmp_path, spec={"version": "7.16"}), act)
    assert (result.status, result.left_open) == (Status.LEFT_AS_FOUND, False)
    assert left[0] == 0


def test_job_that_cannot_be_removed_is_reported(tmp_path: Path) -> None:
    """It runs in vain, and takes itself away: nothing was changed that it could take back."""

    async def act(bench: Bench) -> DeviceResult:
        bench.router.arm(LinkFault(do=FaultKind.GAP, match="/system/scheduler/add", seconds=5000.0, when="after"))
        return await bench.converge(patience=Patience(reach_s=10.0))

    result = on(Bench(tmp_path, spec={"version": "7.16"}), act)
    assert (result.status, result.left_open) == (Status.LEFT_AS_FOUND, True)
    assert "the dead-man job rolls everything back within 10 minutes" in str(result.hint)
