"""Runs that are repeated, not resumed, and those that repeat a rehearsal."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from atlantis_netcfg.cli.base import rehearsal
from atlantis_netcfg.cli.base.output import as_typed
from atlantis_netcfg.cli.recovery.resume import _refuse_others, _refuse_settled
from atlantis_netcfg.core import paths
from atlantis_netcfg.core.errors import NoMatchError, UsageError
from atlantis_netcfg.inventory import load
from atlantis_netcfg.runs import Outcome, Purpose, Run, RunResume, RunStart, Store


def broken(state: Path, command: str, purpose: Purpose) -> Run:
    started = RunStart(
        site="quay", revision="", tool="", hosts=("router",), rehearsed=False, command=command, purpose=purpose
    )
    with Store(state).start(started) as journal:
        pass
    return Store(state).run("quay", journal.run)


@pytest.mark.parametrize(
    ("command", "purpose", "what"),
    [
        ("provision device adopt site=quay device=router", Purpose.ADOPT, "an adoption"),
        ("provision device upgrade site=quay device=router packages=x.npk", Purpose.UPGRADE, "an upgrade"),
        ("provision vpn install device=router", Purpose.INSTALL, "an import of a VPN identity"),
    ],
)
def test_command_to_repeat_is_shown(tmp_path: Path, command: str, purpose: Purpose, what: str) -> None:
    with pytest.raises(UsageError, match=f"was {what}") as refused:
        _refuse_others(broken(tmp_path, command, purpose))
    assert refused.value.hint == f"repeat it: `{command}`"


def test_hints_of_a_rehearsal_keep_its_flag() -> None:
    """Only of commands that have the flag: `device trust` has none."""
    hint = (
        "`provision recover resume site=… run=1`, or `provision device backup site=…`; `provision device trust site=…`"
    )
    rehearsed = as_typed(hint, ["site=quay", "--rehearse"])
    assert "`provision recover resume site=quay run=1 --rehearse`" in rehearsed
    assert "`provision device backup site=quay --rehearse`" in rehearsed
    assert rehearsed.endswith("`provision device trust site=quay`")
    assert "--rehearse" not in as_typed(hint, ["site=quay"])


def test_configuration_run_can_be_resumed(tmp_path: Path) -> None:
    run = broken(tmp_path, "provision site=quay", Purpose.CONFIGURE)
    _refuse_others(run)
    assert run.unsettled_devices == ("router",)


def test_backup_leaves_nothing_to_resume(tmp_path: Path) -> None:
    assert broken(tmp_path, "provision device backup site=quay", Purpose.BACKUP).unsettled_devices == ()


def test_run_with_nothing_open_is_typed_again(tmp_path: Path) -> None:
    """Stopped before the last device's turn came: nothing is open, and not everything is done."""
    run = broken(tmp_path, "provision site=quay --yes", Purpose.CONFIGURE)
    _refuse_settled(run)
    with Store(tmp_path).resume("quay", run.id, RunResume(revision="", tool="", command="")) as journal:
        journal.write(Outcome(device="router", status="left-as-found", exit=4, message="interrupted by the user"))
    with pytest.raises(NoMatchError, match="has left nothing pending on any device") as refused:
        _refuse_settled(Store(tmp_path).run("quay", run.id))
    assert "to complete it, run its command again:  provision site=quay --yes" in (refused.value.hint or "")


def test_resume_covers_every_unfinished_device(tmp_path: Path) -> None:
    """Seed 209 of the campaign: `resume` was green, and the devices whose turn had not come were as before."""
    hosts = ("open", "never reached", "taken back", "done")
    started = RunStart(site="quay", revision="", tool="", hosts=hosts, rehearsed=False, command="provision")
    with Store(tmp_path).start(started) as journal:
        for device, status in zip(hosts[1:], ("left-as-found", "rolled-back", "changed"), strict=True):
            journal.write(Outcome(device=device, status=status, exit=4, message=""))
    run = Store(tmp_path).run("quay", journal.run)
    assert run.unsettled_devices == ("open",)
    assert run.undone == ("open", "never reached", "taken back")


def test_every_device_is_repeated_once_over_each_link_of_its_site() -> None:
    inventory = load(paths.resource("inventory"))
    names = ("scc-router", "coastal-router", "coastal-gateway", "te4sea-router", "te4sea-4g")
    hosts = [inventory.hosts[name] for name in names]
    session: Any = SimpleNamespace(inventory=inventory, hosts=hosts, contacted_hosts=hosts[:-1])
    rounds = rehearsal._rounds(session)
    for name, links in (
        ("scc-router", ["lan", "uplink"]),
        ("coastal-gateway", ["lan", "wifi-ptp", "4g", "satellite"]),
        ("te4sea-4g", ["lan", "4g", "satellite"]),
    ):
        assert [each[name] for each in rounds if name in each] == links
    assert rounds[0] == dict.fromkeys(("coastal-router", "coastal-gateway"), "lan")
    assert set(rounds[-1].values()) == {"uplink", "satellite"}, "the slowest links side by side"
