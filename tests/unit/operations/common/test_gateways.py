"""Gateways in a run: what a role is told, and what becomes of the results of its tasks."""

import json
import os
import shutil
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from atlantis_netcfg.core import stored_messages
from atlantis_netcfg.core.errors import ExitCode, UsageError
from atlantis_netcfg.core.messages import Message, arg
from atlantis_netcfg.inventory import load
from atlantis_netcfg.operations.apply import RunName, SiteRun
from atlantis_netcfg.operations.common.request import Mode, Request, StandIns, Target
from atlantis_netcfg.operations.computers import _watch
from atlantis_netcfg.operations.computers._watch import Watch
from atlantis_netcfg.operations.computers.desired_state import narrow, package_sources, perform
from atlantis_netcfg.operations.computers.parts import PARTS
from atlantis_netcfg.runs import SiteBusy, Store
from atlantis_netcfg.runs.report.drift import drift_lines

SHIPPED = Path(__file__).parents[4] / "inventory"
HOST = "coastal-gateway"
FILE = {"changed": True, "changes": ["file /etc/a", "unit a restarted"], "notes": ["slow card"]}


class Listener:
    def __init__(self) -> None:
        self.reader, self.writer = os.pipe()

    def told(self) -> list[dict[str, Any]]:
        os.close(self.writer)
        with os.fdopen(self.reader, encoding="utf-8") as lines:
            return [json.loads(line) for line in lines]


@pytest.fixture(autouse=True)
def nothing_refused() -> Iterator[None]:
    yield
    _watch._refusals.clear()


@pytest.fixture
def listener() -> Listener:
    return Listener()


@pytest.fixture
def watch(tmp_path: Path, listener: Listener) -> Watch:
    return Watch(SHIPPED, Request(state=tmp_path, rehearsed=True, events_fd=listener.writer), plan_only=False)


@pytest.fixture
def real_watch(tmp_path: Path, listener: Listener) -> Watch:
    """Of a real run, which locks its site."""
    return Watch(SHIPPED, Request(state=tmp_path, events_fd=listener.writer), plan_only=False)


def outcome(listener: Listener) -> dict[str, Any]:
    (told,) = [one for one in listener.told() if one.get("devices")]
    result: dict[str, Any] = told["devices"][HOST]
    return {**result, "run": told["runs"]}


def msg(text: str) -> Message:
    return Message(text)


def ask(tmp_path: Path, part: str, inventory: Path = SHIPPED, **asked: Any) -> Any:  # noqa: ANN401
    request = Request(state=tmp_path, **asked).model_dump(mode="json")
    return perform(inventory, [HOST, "coastal-router"], request, part, plan_only=False)["per_host"]


def test_rehearsed_gateway_is_reached_at_its_target(tmp_path: Path) -> None:
    target = Target(host="127.0.0.1", port=2222, known_hosts="/k", identity="/i")
    told = ask(tmp_path, "computer_access", rehearsed=True, targets={HOST: target})
    assert set(told) == {HOST}
    reached = told[HOST]
    assert (reached["host"], reached["port"], reached["user"]) == ("127.0.0.1", 2222, "root")
    for option in ("StrictHostKeyChecking=yes", "UserKnownHostsFile=/k", "IdentityFile=/i"):
        assert f"-o {option}" in reached["ssh_args"]


def test_gateway_is_reached_as_declared_and_pinned_by_name(tmp_path: Path) -> None:
    inventory = tmp_path / "inventory"
    shutil.copytree(SHIPPED, inventory)
    host = inventory / "host_vars" / f"{HOST}.yml"
    told = perform(inventory, [HOST], {"state": str(tmp_path), "rehearsed": True}, "computer_access", plan_only=False)
    assert told["per_host"][HOST]["host"] == "10.64.1.10"
    assert not told["per_host"][HOST]["become"]
    host.write_text(host.read_text("utf-8") + "  ssh: {user: atlantis, port: 2200}\n", "utf-8")
    told = perform(inventory, [HOST], {"state": str(tmp_path), "rehearsed": True}, "computer_access", plan_only=False)
    reached = told["per_host"][HOST]
    assert (reached["user"], reached["port"], reached["become"]) == ("atlantis", 2200, True)
    assert f"HostKeyAlias={HOST}" in reached["ssh_args"]


def test_gateway_with_example_values_is_refused(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="example values"):
        ask(tmp_path, "computer_access")


def test_unknown_part_is_refused(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="` is not a part of a computer"):
        ask(tmp_path, "gateway_misspelt", rehearsed=True)


def test_changes_are_counted_and_journalled(watch: Watch, listener: Listener, tmp_path: Path) -> None:
    watch.begin([HOST, "coastal-router"])
    watch.start_task(HOST, "Configure")
    watch.ok(HOST, "Configure", FILE)
    watch.ok(HOST, "Look", {"changed": False, "changes": []})
    watch.ok(HOST, "Reload", {"changed": True})
    watch.end(set())
    result = outcome(listener)
    assert (result["status"], result["exit"], result["planned"], result["confirmed"]) == ("changed", 0, 3, 3)
    assert result["message"] == "3 changes made"
    assert result["changes"] == ["file /etc/a", "unit a restarted", "Reload"]
    assert result["notes"] == ["slow card"]
    (run,) = Store(tmp_path, is_rehearsal=True).runs("coastal")
    assert result["run"] == {"coastal": {"computers": run.id}}
    assert run.exit == 0
    assert run.outcomes[HOST].status == "changed"
    assert len(run.confirmed_actions(HOST)) == 3


def test_nothing_to_change(watch: Watch, listener: Listener) -> None:
    watch.begin([HOST])
    watch.start_task(HOST, "Configure")
    watch.ok(HOST, "Configure", {"changed": False})
    watch.end(set())
    assert outcome(listener)["message"] == "matches the inventory, nothing to change"


def test_failure_names_task_reason_and_hint(watch: Watch, listener: Listener, tmp_path: Path) -> None:
    watch.begin([HOST])
    watch.start_task(HOST, "Install")
    watch.ok(HOST, "Configure", FILE)
    watch.fail_task(HOST, "Install", {"msg": "the key has expired", "hint": "ship a new one"})
    watch.end({HOST})
    result = outcome(listener)
    assert (result["exit"], result["status"]) == (int(ExitCode.FAILED), "left-as-found")
    assert result["message"] == "Install: the key has expired (after 2 changes)"
    assert result["hint"] == "ship a new one"
    assert Store(tmp_path, is_rehearsal=True).runs("coastal")[0].exit == int(ExitCode.FAILED)


def test_messages_of_a_module_keep_their_values(watch: Watch, listener: Listener) -> None:
    name, size = msg(f"start {arg('radio')} if it is plugged in"), msg(f"{arg(1.5)} GB are missing")
    watch.begin([HOST])
    watch.start_task(HOST, "Configure")
    watch.ok(HOST, "Work out", stored_messages.pack({"changed": False, "per_host": {HOST: [name]}}))
    change = msg(f"step {arg(str.__str__(name))}")
    watch.ok(HOST, "Configure", stored_messages.pack({"changed": True, "changes": [change]}))
    watch.fail_task(HOST, "Install", stored_messages.pack({"msg": size, "hint": ""}))
    watch.end({HOST})
    (line,) = [line for line in listener.told() if line.get("devices")]
    result = stored_messages.unpack(line)["devices"][HOST]
    assert result["changes"] == ["step start radio if it is plugged in"]
    assert name.source in result["changes"][0].source
    assert name.source in result["diff"].source
    assert size.source in result["message"].source


def test_rolled_back_failure_is_reported_as_rolled_back(watch: Watch, listener: Listener) -> None:
    watch.begin([HOST])
    watch.start_task(HOST, "Network")
    watch.fail_task(HOST, "Network", {"msg": "nothing answered at the new address", "rolled_back": True})
    watch.end({HOST})
    assert outcome(listener)["status"] == "rolled-back"


def test_rescued_failure_is_not_a_failure(watch: Watch, listener: Listener) -> None:
    watch.begin([HOST])
    watch.start_task(HOST, "Try")
    watch.fail_task(HOST, "Try", {"msg": "not yet"})
    watch.ok(HOST, "Try otherwise", FILE)
    watch.end(set())
    result = outcome(listener)
    assert (result["status"], result["hint"]) == ("changed", None)


@pytest.mark.parametrize(("answered", "status"), [(False, "left-as-found"), (True, "unknown")])
def test_host_is_unreached_only_if_it_never_responded(
    watch: Watch, listener: Listener, *, answered: bool, status: str
) -> None:
    watch.begin([HOST])
    watch.start_task(HOST, "Work out")
    watch.ok(HOST, "Work out", {"changed": False, "per_host": {}})
    if answered:
        watch.ok(HOST, "Look", {"changed": False})
    watch.unreachable(HOST, "Install", {"msg": "Connection timed out"})
    watch.end({HOST})
    result = outcome(listener)
    assert result["status"] == status
    assert result["message"] == ("Install: " if answered else "not reached: ") + "Connection timed out"
    assert result["hint"] == "check its power and its cable, then run the same command again"


def test_plan_takes_no_lock_and_writes_no_journal(tmp_path: Path, listener: Listener) -> None:
    watch = Watch(SHIPPED, Request(state=tmp_path, events_fd=listener.writer), plan_only=True)
    store = Store(tmp_path)
    with store.lock("coastal", "somebody else"):
        watch.begin([HOST])
        watch.start_task(HOST, "Configure")
        difference = {"before": "a\n", "after": "b\n", "before_header": "/etc/a", "after_header": "/etc/a"}
        watch.ok(HOST, "Configure", {**FILE, "diff": [difference]})
        watch.end(set())
    result = outcome(listener)
    assert (result["status"], result["exit"]) == ("planned", int(ExitCode.CHANGES))
    assert result["message"] == "2 changes to make"
    assert result["diff"].splitlines() == [
        *("  file /etc/a", "  unit a restarted", "--- /etc/a", "+++ /etc/a", "@@ -1 +1 @@", "-a", "+b")
    ]
    assert store.runs("coastal") == ()


def test_busy_site_is_refused_by_the_next_task(
    real_watch: Watch, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("atlantis_netcfg.operations.computers.desired_state.refuse_examples", lambda *_, **_named: None)
    with Store(tmp_path).lock("coastal", "provision site=coastal"):
        real_watch.begin([HOST])
    with pytest.raises(SiteBusy, match="provision site=coastal"):
        ask(tmp_path, "computer_access")


def test_run_is_recorded_with_the_most_serious_exit_code(tmp_path: Path) -> None:
    declaration = load(SHIPPED)
    hosts = list(declaration.site_hosts("coastal"))[:3]
    turn = SiteRun(declaration, "coastal", hosts, Request(state=tmp_path, rehearsed=True), RunName())
    turn.begin()
    for host, code in zip(hosts, (ExitCode.CHECKS_FAILED, ExitCode.UNKNOWN, ExitCode.NOTHING), strict=True):
        turn.finish(SimpleNamespace(name=host.name, exit=code))
    (run,) = Store(tmp_path, is_rehearsal=True).runs("coastal")
    assert run.exit == ExitCode.UNKNOWN


def test_site_lock_is_held_until_the_end(real_watch: Watch, tmp_path: Path) -> None:
    real_watch.begin([HOST])
    lock = Store(tmp_path).lock("coastal", "another")
    with pytest.raises(SiteBusy):
        lock.__enter__()
    real_watch.end(set())
    with lock:
        assert True


def test_drift_reports_what_a_run_would_change(tmp_path: Path, listener: Listener) -> None:
    request = Request(state=tmp_path, rehearsed=True, mode=Mode.DRIFT, events_fd=listener.writer)
    watch = Watch(SHIPPED, request, plan_only=True)
    watch.begin([HOST])
    watch.start_task(HOST, "Configure")
    watch.ok(HOST, "Configure", FILE)
    watch.end(set())
    result = outcome(listener)
    assert (result["status"], result["exit"]) == ("drifted", int(ExitCode.CHECKS_FAILED))
    assert result["message"] == "2 differences"
    assert drift_lines(result["comparison"])[:3] == [*("  roles", "    changed  file /etc/a", "             declared")]


def test_no_package_is_fetched_over_a_metered_link_without_consent(tmp_path: Path) -> None:
    declaration = load(SHIPPED)
    vessel, testbed = declaration.hosts["te4sea-gateway"], declaration.hosts[HOST]
    asked = Request(state=tmp_path)
    assert package_sources(declaration, testbed, asked, None) == {}
    dear = package_sources(declaration, vessel, asked, None)
    assert dear == {"limit_bytes": 0, "limit_words": "over 4g of te4sea, which is metered"}
    paid = package_sources(declaration, vessel, asked.model_copy(update={"accept_cost": True}), None)
    assert paid["limit_bytes"] == 5_000_000
    assert package_sources(declaration, vessel, asked.model_copy(update={"rehearsed": True}), None) == {}


def test_everything_is_installed_from_the_bundle(tmp_path: Path) -> None:
    declaration = load(SHIPPED)
    asked = Request(state=tmp_path)
    how = package_sources(declaration, declaration.hosts["te4sea-gateway"], asked, "b1")
    wanted = narrow({"packages": {"packages": []}, "build": {"prefix": "/opt"}, "configure": {}}, how, "b1")
    assert wanted["packages"] == {"packages": [], "offline": "/var/lib/atlantis/bundle/b1/repository"}
    assert wanted["build"] == {"prefix": "/opt", "offline": "/var/lib/atlantis/bundle/b1/sources"}
    assert narrow({"packages": None, "build": None}, how, "b1") == {"packages": None, "build": None}


def test_stand_in_servers_are_used_in_a_rehearsal(tmp_path: Path) -> None:
    served = StandIns(
        archive="http://10.64.1.1:1",
        key="AA==",
        fingerprint="F" * 40,
        codename="bookworm",
        distribution="debian",
        repositories="http://10.64.1.1:2",
    )
    told = ask(tmp_path, "gateway_ros2", rehearsed=True, standins=served)[HOST]["packages"]
    assert told["expected"]["codename"] == "bookworm"
    assert "http://10.64.1.1:1" in told["sources"][0]["content"]
    built = ask(tmp_path, "gateway_interop", rehearsed=True, standins=served)[HOST]["build"]
    assert built["library"]["url"] == "http://10.64.1.1:2/uv-interoperability.git"
    assert built["examples"]["url"] == "http://10.64.1.1:2/uv-interoperability-example.git"
    assert "token" not in str(built)


def test_rehearsal_keeps_the_network_of_the_machine(tmp_path: Path) -> None:
    inventory = tmp_path / "inventory"
    shutil.copytree(SHIPPED, inventory)
    host = inventory / "host_vars" / f"{HOST}.yml"
    host.write_text(host.read_text("utf-8") + "  network: {by: netplan, interface: eth0}\n", "utf-8")
    assert "network" not in ask(tmp_path, "gateway_base", inventory, rehearsed=True)[HOST]
    declaration = load(inventory)
    assert "network" in PARTS["gateway_base"](declaration, declaration.hosts[HOST], Request(state=tmp_path))
