"""`provision device restore`: the router has drowned, and another box from the shelf takes its place."""

import os
import re
import signal
import subprocess

import pytest
from quay import PROVISION, ROUTER, Quay, fresh_quay
from test_real_run import await_record, kill_workers

from atlantis_netcfg.emulator.routeros import ManagementSpec

pytestmark = [pytest.mark.slow, pytest.mark.namespace]

SMALL = {
    "ports": tuple(f"ether{number}" for number in range(1, 6)),
    "poe_ports": (),
    "board": "RB750Gr3",
    "management": ManagementSpec(port="ether5"),
}
at = pytest.fixture(fresh_quay)


def provisioned(at: Quay) -> str:
    """A run, and a row of a technician that the next run has seen and left alone; what the router is then."""
    at.configure()
    at.do("console", words=["/ip/dns/static/add", "=name=printer", "=address=10.64.1.77", "=ttl=5m"])
    at.configure()
    return of_any_box(at.export())


def of_any_box(export: str) -> str:
    """The address that the device made up for its tunnel belongs to the box."""
    return re.sub(r"(?<=mac-address=)\\\n +48:A9:8A:[0-9A-F:]+", "OWN", export)


@pytest.mark.smoke
def test_replacement_gets_the_state_of_the_lost_router(at: Quay) -> None:
    lost = provisioned(at)
    assert "printer" in lost
    at.replace("spare")
    fresh = at.export()
    # The new box shows a certificate that is not the pinned one: nobody talks to it before it was adopted.
    refused = at.json("device", "restore", f"device={ROUTER}", "run=latest", "--yes", code=4)
    assert "provision device adopt" in refused["devices"][ROUTER]["hint"]
    at.adopt()
    planned = at.provision("device", "restore", f"device={ROUTER}", "run=latest", "--plan", code=2).stdout
    assert "~ name: MikroTik → coastal-router" in planned
    assert "password=********" in planned
    assert at.export() == fresh

    told = at.json("device", "restore", f"device={ROUTER}", "run=latest", "--yes", code=0)
    assert told["devices"][ROUTER]["status"] == "changed"
    assert of_any_box(at.export()) == lost
    assert "a-real-vpn-coastal" in str(at.do("export", show_sensitive=True))
    assert (
        at.json("device", "restore", f"device={ROUTER}", "run=latest", "--yes", code=0)["devices"][ROUTER]["planned"]
        == 0
    )
    assert of_any_box(at.export()) == lost
    assert (
        "as in the inventory; 1 foreign row left unchanged"
        in at.provision("report", "drift", "site=coastal", code=0).stdout
    )
    assert at.json("plan", "site=coastal", code=0)["devices"][ROUTER]["planned"] == 0


def test_older_state_can_be_listed_and_restored(at: Quay) -> None:
    lost = provisioned(at)
    first, second = at.runs()
    assert [run["devices"][ROUTER]["confirmed_state"] for run in (first, second)] == [True, True]
    listed = subprocess.run(
        [PROVISION, "report", "runs"], env=at.environment(), capture_output=True, text=True, check=True
    ).stdout
    assert "coastal-router changed (184, state kept)" in listed
    at.replace("spare")
    at.adopt()
    at.provision("device", "restore", f"device={ROUTER}", f"run={first['run']}", "--yes", code=0)
    assert of_any_box(at.export()) == re.sub(r"(?m)^add .*name=printer.*\n", "", lost)


def test_device_with_too_few_ports_is_refused_with_all_missing_ports(at: Quay) -> None:
    provisioned(at)
    at.replace("small", **SMALL)
    at.adopt()
    before = at.export()
    done = at.json("device", "restore", f"device={ROUTER}", "run=latest", "--yes", code=4)
    message = done["devices"][ROUTER]["message"]
    for port in ("ether6", "ether7", "ether8"):
        assert f"{port} does not exist in /interface ethernet" in message
    assert at.export() == before
    assert at.provision("device", "restore", f"device={ROUTER}", "run=latest", "--plan", code=4)
    assert at.export() == before


def test_older_routeros_is_refused_with_the_missing_feature(at: Quay) -> None:
    at.configure()
    words = ["=name=siem", "=target=remote", "=remote=10.99.1.9", "=remote-log-format=cef"]
    at.do("console", words=["/system/logging/action/add", *words])
    at.configure()
    at.replace("old", version="7.16")
    at.adopt()
    before = at.export()
    done = at.json("device", "restore", f"device={ROUTER}", "run=latest", "--yes", code=4)
    assert (
        "has `remote-log-format` from RouterOS 7.18 on, but this device has 7.16" in done["devices"][ROUTER]["message"]
    )
    assert at.export() == before


def test_restore_needs_consent(at: Quay) -> None:
    lost = provisioned(at)
    at.replace("spare")
    at.adopt()
    fresh = at.export()
    assert "not confirmed; nothing was changed" in at.typed(
        "device", "restore", f"device={ROUTER}", "run=latest", answer="no", code=4
    )
    assert at.export() == fresh
    assert "--yes" in at.provision("device", "restore", f"device={ROUTER}", "run=latest", code=3).stderr
    at.typed("device", "restore", f"device={ROUTER}", "run=latest", answer="yes", code=0)
    assert of_any_box(at.export()) == lost


def test_undeclared_secret_is_reported_as_missing(at: Quay) -> None:
    at.configure()
    words = ["=name=own", "=connect-to=10.99.1.9", "=user=bob", "=password=his own"]
    at.do("console", words=["/interface/ovpn-client/add", *words])
    at.configure()
    at.replace("spare")
    at.adopt()
    told = at.json("device", "restore", f"device={ROUTER}", "run=latest", "--yes", code=0)["devices"][ROUTER]
    assert "/interface ovpn-client: `password` of own is not in the saved export: enter it by hand" in told["notes"]
    assert "his own" not in str(at.do("export", show_sensitive=True))


def test_near_miss_names_get_a_suggestion(at: Quay) -> None:
    provisioned(at)
    first, second = at.runs()
    assert (
        "did you mean `coastal-router`?"
        in at.provision("device", "restore", "device=coastal-ruter", "run=latest", code=7).stderr
    )
    near = at.provision("device", "restore", f"device={ROUTER}", f"run={first['run'][:-2]}", code=7).stderr
    assert f"run {first['run'][:-2]} has confirmed no state of coastal-router" in near
    assert f"runs with a state: {first['run']}, {second['run']}; or type `run=latest`" in near
    assert (
        "did you mean `run=latest`?"
        in at.provision("device", "restore", f"device={ROUTER}", "run=lastest", code=7).stderr
    )
    never = at.provision("device", "restore", "device=scc-router", "run=latest", code=7).stderr
    assert "no run has confirmed a state of scc-router" in never
    assert (
        "these devices are not supported yet"
        in at.provision("device", "restore", "device=coastal-gateway", "run=latest", code=7).stderr
    )


def test_rehearsed_restore_uses_the_real_state_on_an_emulated_device(at: Quay) -> None:
    provisioned(at)
    before = at.export()
    told = at.json("device", "restore", f"device={ROUTER}", "run=latest", "--rehearse", code=0)
    assert told["devices"][ROUTER]["second_pass"] == 0
    assert told["rehearsed"] is True
    assert at.export() == before


def test_damaged_state_is_not_restored(at: Quay) -> None:
    provisioned(at)
    for path in (at.state / "real/coastal/confirmed").iterdir():
        path.write_text(path.read_text(encoding="utf-8") + "\n# touched\n", encoding="utf-8")
    assert (
        "it was changed since"
        in at.provision("device", "restore", f"device={ROUTER}", "run=latest", "--yes", code=4).stderr
    )


def test_a_killed_restore_is_resumed_towards_the_same_state(at: Quay) -> None:
    lost = provisioned(at)
    at.replace("spare")
    at.adopt()
    at.do("link", delay_s=0.15)
    killed(at, ["device", "restore", f"device={ROUTER}", "run=latest", "--yes"], run=2)
    at.do("link", delay_s=0.0)
    assert at.runs()[-1]["unfinished"] is True
    said = at.provision("recover", "resume", "site=coastal", code=0).stdout
    assert "it continues towards the saved state of run" in said
    assert of_any_box(at.export()) == lost
    assert (
        at.json("device", "restore", f"device={ROUTER}", "run=latest", "--yes", code=0)["devices"][ROUTER]["planned"]
        == 0
    )


def test_a_killed_rollback_is_resumed_backwards(at: Quay) -> None:
    before = at.export()
    at.configure()
    (run,) = at.runs()
    at.do("link", delay_s=0.15)
    killed(at, ["recover", "rollback", "site=coastal", f"run={run['run']}", "--yes"], run=1)
    assert at.export() != before
    at.do("link", delay_s=0.0)
    at.provision("recover", "resume", "site=coastal", code=0)
    assert at.export() == before


def killed(at: Quay, typed: list[str], run: int) -> None:
    """Type a command, and kill it and its workers as soon as the run of that number has sent something."""
    with (
        (at.state.parent / "killed.txt").open("w", encoding="utf-8") as printed,
        subprocess.Popen(
            [PROVISION, *typed, f"inventory={at.inventory}"],
            env=at.environment(),
            start_new_session=True,
            stdout=printed,
            stderr=printed,
        ) as running,
    ):
        await_record(at.state, '"kind":"layer-sent"', run=run)
        os.killpg(running.pid, signal.SIGKILL)
        kill_workers(at.state)
