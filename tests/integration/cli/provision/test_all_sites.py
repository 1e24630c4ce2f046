"""A run over every site: each has its own lock and journal, and one on which somebody works fails alone."""

import json
from pathlib import Path
from typing import Any

import pytest
from quay import CHECKOUT
from test_rehearsal import provision

from atlantis_netcfg.inventory import load
from atlantis_netcfg.operations.apply import perform
from atlantis_netcfg.operations.common.rehearsal import Rehearsal, rehearsal
from atlantis_netcfg.runs import SiteLock, Store

ROUTERS = ["coastal-router", "scc-router", "te4sea-router"]
INVENTORY = CHECKOUT / "inventory"


def run(state: Path, twins: Rehearsal) -> tuple[dict[str, Any], list[dict[str, Any]]]:
    """Give what Ansible gets, and what was told on the way."""
    heard = state.with_name("events.jsonl")
    targets = {name: target.model_dump(mode="json") for name, target in twins.targets.items()}
    with heard.open("w", encoding="utf-8") as events:
        request = {"state": str(state), "rehearsed": True, "targets": targets, "events_fd": events.fileno()}
        outcome = perform(INVENTORY, ROUTERS, request, plan_only=False, decrypt=str)
    return outcome["per_host"], [json.loads(line) for line in heard.read_text(encoding="utf-8").splitlines()]


@pytest.mark.slow
def test_locked_site_fails_alone_and_results_are_streamed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Rehearsals are locked here as real runs are."""
    monkeypatch.setattr(Store, "lock", lambda self, site, command: SiteLock(self.root / site / "lock", site, command))
    declaration = load(INVENTORY)
    store = Store(tmp_path / "state", is_rehearsal=True)
    with rehearsal(declaration, [declaration.hosts[name] for name in ROUTERS], via="lan") as twins:
        with store.lock("coastal", "somebody else's provision"):
            first, told = run(tmp_path / "state", twins)
        again, _ = run(tmp_path / "state", twins)
        third, _ = run(tmp_path / "state", twins)
    assert [first[name]["status"] for name in ROUTERS] == ["left-as-found", "changed", "changed"]
    assert "coastal is locked by" in first["coastal-router"]["message"]
    assert [again[name]["status"] for name in ROUTERS] == ["changed", "unchanged", "unchanged"]
    assert [third[name]["status"] for name in ROUTERS] == ["unchanged"] * 3
    ends = [place for place, line in enumerate(told) if line.get("devices")]
    assert len(ends) == len(ROUTERS)
    assert list(told[ends[0]]["devices"]) == ["coastal-router"]
    assert any("event" in line for line in told[ends[0] :])
    assert [len(store.runs(site)) for site in ("coastal", "scc", "te4sea")] == [2, 3, 3]
    assert store.unfinished_runs("scc") == ()


@pytest.mark.slow
def test_streamed_json_has_one_line_per_device(tmp_path: Path) -> None:
    typed = ("plan", "site=all", "--rehearse", "--json")
    *lines, last = provision(tmp_path, *typed, "--stream", code=2).stdout.splitlines()
    document = json.loads(last)
    statuses = {name: told["status"] for name, told in document["devices"].items()}
    told = [json.loads(line)["device"] for line in lines]
    silent = {"not supported yet", "not rehearsed"}
    assert sorted(told) == sorted(name for name, status in statuses.items() if status not in silent)
    assert document["exit"] == 2
    planned = {name for name, status in statuses.items() if status == "planned"}
    assert planned >= {*ROUTERS, "coastal-cpe", "scc-cpe"}
    (only,) = provision(tmp_path, *typed, code=2).stdout.splitlines()
    assert set(json.loads(only)["devices"]) == set(document["devices"])
