"""One call for many modules: what a gateway answers to it, and when a task may take such an answer."""

import json
import subprocess
import sys
import time
import zlib
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import yaml
from ansible.parsing.dataloader import DataLoader
from ansible.template import Templar

from atlantis_netcfg.ansible_collections.atlantis.netcfg.plugins.action import prefetch as action
from atlantis_netcfg.ansible_collections.atlantis.netcfg.plugins.action.desired_state import (
    ActionModule as DesiredState,
)
from atlantis_netcfg.ansible_collections.atlantis.netcfg.plugins.plugin_utils import prefetch, zipapp_action
from atlantis_netcfg.ansible_collections.atlantis.netcfg.plugins.plugin_utils.board.basic import MARK
from atlantis_netcfg.core.processes import remote_bundle

ROOT = Path(__file__).parents[3]
QUIET = {"variables": {}, "ours": [], "why": "because"}


def request(name: str, params: dict[str, Any], *, check: bool = False) -> dict[str, Any]:
    return {"name": name, "params": params, "check": check, "log": False}


def clock(now: float, *, check: bool = False) -> dict[str, Any]:
    return request("clock", {"now": now, "tolerance_s": 300}, check=check)


def configure(folder: Path, content: str, *, check: bool = False) -> dict[str, Any]:
    """A file, as the action would request it: complete parameters."""
    owner = {"owner": _name(), "group": _name()}
    file = {"path": str(folder / "file"), "content": content, "secret_content": None, "mode": "0644"}
    lists: dict[str, Any] = {
        name: [] for name in ("directories", "links", "absent", "only", "steps", "units", "brought", "checks")
    }
    files: list[dict[str, Any]] = [{**file, **owner, "validate": [], "hint": "", "finding": ""}]
    return request("configure", {**lists, "files": files, "secrets": {}, "way_in": None}, check=check)


def _name() -> str:
    return subprocess.run(["id", "-un"], capture_output=True, text=True, check=True).stdout.strip()


def answers(folder: Path, *requests: dict[str, Any]) -> list[dict[str, Any]]:
    """What a gateway tells."""
    (folder / "tool.pyz").write_bytes(remote_bundle.build().content)
    done = subprocess.run(
        [sys.executable, "-I", folder / "tool.pyz", "batch"],
        input=zlib.compress(json.dumps(requests).encode()),
        capture_output=True,
        check=True,
    )
    found: dict[str, Any] = json.loads(done.stdout.decode().rpartition(MARK)[2])
    assert list(found) == ["answers"]
    told: list[dict[str, Any]] = found["answers"]
    return told


def test_unchanged_requests_are_answered_in_one_call(tmp_path: Path) -> None:
    quiet = request("env_conflicts", QUIET)
    told = answers(tmp_path, clock(time.time()), quiet, quiet)
    assert [(answer["changed"], answer["changes"], answer["notes"]) for answer in told] == [(False, [], [])] * 3


def test_prefetch_stops_at_the_first_difference(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("before")
    quiet = request("env_conflicts", QUIET)
    assert len(answers(tmp_path, quiet, configure(tmp_path, "after"), quiet)) == 1
    assert (tmp_path / "file").read_text() == "before"


def test_plan_has_every_response_up_to_a_failure(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("before")
    quiet = request("env_conflicts", QUIET, check=True)
    told = answers(tmp_path, configure(tmp_path, "after", check=True), quiet, clock(0, check=True), quiet)
    assert told[0]["changes"][0] == f"file {tmp_path / 'file'}"
    assert [answer["changed"] for answer in told] == [True, False], "a laptop in 1970 is refused"
    assert (tmp_path / "file").read_text() == "before"


def test_crashed_module_has_no_response(tmp_path: Path) -> None:
    quiet = request("env_conflicts", QUIET)
    assert len(answers(tmp_path, quiet, request("env_conflicts", {}), quiet)) == 1


def variables(*requests: dict[str, Any]) -> dict[str, Any]:
    """What a task sees after the action has got an answer to each of these requests."""
    return {prefetch.VARIABLE: prefetch.pack(requests, [{"changes": [], "number": i} for i in range(len(requests))])}


def test_task_uses_only_the_response_to_its_own_request() -> None:
    seen = variables(request("packages", {"packages": ["a"]}), clock(1.0))
    assert prefetch.find_answer(seen, request("packages", {"packages": ["a"]})) == {"changes": [], "number": 0}
    assert prefetch.find_answer(seen, clock(2.0)) == {"changes": [], "number": 1}, "the same request, a moment later"
    others = [
        request("packages", {"packages": ["b"]}),
        request("configure", {"packages": ["a"]}),
        request("packages", {"packages": ["a"]}, check=True),
        request("clock", {"now": 1.0, "tolerance_s": 1}),
    ]
    assert [prefetch.find_answer(seen, other) for other in others] == [None] * len(others)
    assert prefetch.find_answer({}, others[0]) is None


def test_prefetched_responses_are_void_after_a_task_calls() -> None:
    asked = request("packages", {"packages": ["a"]})
    seen, other = variables(asked), variables(asked)
    facts = prefetch.discard(seen)
    assert prefetch.find_answer(seen | facts, asked) is None
    assert prefetch.find_answer(other | facts, asked) is not None, "facts that a cache keeps are of another run"
    assert prefetch.discard({}) == {}


def test_old_response_expires(monkeypatch: pytest.MonkeyPatch) -> None:
    asked = request("packages", {"packages": ["a"]})
    seen, began = variables(asked), time.monotonic()
    monkeypatch.setattr(time, "monotonic", lambda: began + 59.0)
    assert prefetch.find_answer(seen, asked) is not None
    monkeypatch.setattr(time, "monotonic", lambda: began + 61.0)
    assert prefetch.find_answer(seen, asked) is None


def test_request_digest_reveals_no_secret(monkeypatch: pytest.MonkeyPatch) -> None:
    asked = request("configure", {"secrets": {"key": "short"}})
    before = variables(asked)
    assert "short" not in json.dumps(before)
    monkeypatch.setattr(prefetch, "_KEY", bytes(32))
    assert prefetch.find_answer(before, asked) is None, "nobody without the key can compare a guess"


def test_prefetch_covers_role_requests_up_to_the_first_dependent_one(monkeypatch: pytest.MonkeyPatch) -> None:
    network = {"by": "netplan", "interface": "eth0", "address": "10.0.0.1/24"}
    desired = {"packages": {"packages": [{"name": "chrony"}]}, "network": network}
    monkeypatch.setattr(DesiredState, "perform", lambda requested: {"per_host": {requested.hosts[0]: desired}})
    monkeypatch.setenv("ANSIBLE_ROLES_PATH", str(ROOT / "roles"))
    loader = DataLoader()
    made = action.ActionModule.__new__(action.ActionModule)
    made._loader, made._templar = loader, Templar(loader)
    made._task = SimpleNamespace(args={"roles": ["gateway_base", "no_such_role"]}, check_mode=False)
    calls = dict(made._calls({"inventory_hostname": "station", "inventory_dir": str(ROOT / "inventory")}))
    assert calls.keys() == {"clock", "packages", "network"}, "no bundle, nothing to configure, nothing to confirm yet"
    assert calls["packages"] == {"packages": [{"name": "chrony"}]}, "what a task omits is excluded"
    assert calls["network"] == {**network, "action": "stage"}


@pytest.mark.parametrize("book", ["computer", "operator_station"])
def test_playbook_prefetches_its_own_roles(book: str) -> None:
    first, *tasks = yaml.safe_load((ROOT / f"playbooks/computers/{book}.yml").read_text())
    roles = [task["ansible.builtin.import_role"] for task in tasks if "ansible.builtin.import_role" in task]
    assert first["atlantis.netcfg.prefetch"]["roles"] == [role["name"] for role in roles if "tasks_from" not in role]
    assert first["register"] == prefetch.VARIABLE


class Task(zipapp_action.ZipappAction):
    """Calls a gateway that has been changed, and counts it."""

    def __init__(self) -> None:
        self._task = SimpleNamespace(no_log=True, check_mode=False)
        self.calls = 0

    def _run_tool(self, name: str, data: bytes, variables: dict[str, Any]) -> dict[str, Any]:  # noqa: ARG002
        self.calls += 1
        return {"stdout": f'{MARK}{{"changed": true, "changes": ["clock set"]}}\n', "stderr": "", "rc": 0}


def test_task_without_a_response_calls_and_so_do_later_ones(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(zipapp_action, "end_with_parent", lambda: None)
    task = Task()
    seen = variables(task.request("clock", {"now": 1.0, "tolerance_s": 300.0}, {}))
    assert task.run_module("clock", {"now": 2}, seen) == {"changes": [], "number": 0}
    assert task.calls == 0
    told = task.run_module("clock", {"now": 2, "tolerance_s": 9}, seen)
    assert (task.calls, told["changes"]) == (1, ["clock set"])
    task.run_module("clock", {"now": 2}, seen | {"ansible_facts": told["ansible_facts"]})
    assert task.calls == 2
