"""The repository as an AWX project: ansible-runner, which AWX runs jobs with, drives `playbooks/site.yml` unchanged."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
import yaml
from quay import CHECKOUT

from atlantis_netcfg.inventory import load
from atlantis_netcfg.operations.common.rehearsal import Rehearsal, rehearsal

RUNNER = str(Path(sys.executable).with_name("ansible-runner"))
DEFINITION = yaml.safe_load((CHECKOUT / "execution-environment.yml").read_text(encoding="utf-8"))
SECRET = re.compile("EXAMPLE-[a-z]")


def image_variables() -> dict[str, str]:
    """The variables of the image, for a project in another place."""
    steps = DEFINITION["additional_build_steps"]["append_final"]
    found = [step.removeprefix("ENV ").split("=", 1) for step in steps if step.startswith("ENV ")]
    return {name: value.replace("/runner/project", str(CHECKOUT)) for name, value in found}


def job(folder: Path, twins: Rehearsal, hosts: list[str]) -> Path:
    """A job as AWX lays it out: project, hosts as a script, variables."""
    for name in ("inventory", "env"):
        (folder / name).mkdir(parents=True)
    (folder / "project").symlink_to(CHECKOUT)
    listed = {"all": {"children": ["routers"]}, "routers": {"hosts": hosts}, "_meta": {"hostvars": {}}}
    script = folder / "inventory" / "hosts"
    script.write_text(f"#!{sys.executable}\nprint({json.dumps(listed)!r})\n", encoding="utf-8")
    script.chmod(0o700)
    targets = {name: target.model_dump(mode="json") for name, target in twins.targets.items()}
    request = {"state": str(folder.parent / "state"), "rehearsed": True, "targets": targets}
    (folder / "env" / "extravars").write_text(json.dumps({"atlantis_request": request}), encoding="utf-8")
    variables = image_variables() | {"PATH": f"{Path(sys.executable).parent}:{os.environ['PATH']}"}
    (folder / "env" / "envvars").write_text(json.dumps(variables), encoding="utf-8")
    return folder


def run(folder: Path, *options: str) -> dict[str, Any]:
    """Run the job; give the counts of its recap, and see that no secret is on disk."""
    done = subprocess.run(
        [RUNNER, "run", str(folder), "-p", "playbooks/site.yml", "--ident", "one", *options],
        capture_output=True,
        text=True,
        check=False,
    )
    artifacts = folder / "artifacts" / "one"
    assert (artifacts / "status").read_text() == ("failed" if done.returncode else "successful"), done.stdout
    files = [path for path in artifacts.rglob("*") if path.is_file()]
    assert files
    assert not [path.name for path in files if SECRET.search(path.read_text(encoding="utf-8", errors="replace"))]
    events = [json.loads(path.read_text(encoding="utf-8")) for path in (artifacts / "job_events").glob("*.json")]
    (recap,) = [event["event_data"] for event in events if event["event"] == "playbook_on_stats"]
    return {"code": done.returncode, **recap}


@pytest.mark.slow
def test_ansible_runner_runs_the_playbook_unmodified(tmp_path: Path) -> None:
    declaration = load(CHECKOUT / "inventory")
    hosts = ["coastal-router", "te4sea-router"]
    with rehearsal(declaration, [declaration.hosts[name] for name in hosts], via="lan") as twins:
        first = run(job(tmp_path / "first", twins, hosts))
        again = run(job(tmp_path / "again", twins, hosts))
        before = twins.export(hosts[0])
        planned = run(job(tmp_path / "planned", twins, hosts), "--cmdline", "--check --diff")
        assert twins.export(hosts[0]).splitlines()[1:] == before.splitlines()[1:]
    assert (first["code"], again["code"], planned["code"]) == (0, 0, 0)
    assert set(first["ok"]) == set(again["ok"]) == set(hosts)
    assert first["changed"] == dict.fromkeys(hosts, 1)
    assert not again["changed"]
    assert not planned["changed"]
    assert not first["failures"]


@pytest.mark.slow
def test_a_dead_router_fails_alone(tmp_path: Path) -> None:
    declaration = load(CHECKOUT / "inventory")
    hosts = ["coastal-router", "te4sea-router"]
    with rehearsal(declaration, [declaration.hosts[name] for name in hosts], via="lan") as twins:
        place = job(tmp_path / "dead", twins, hosts)
        request = json.loads((place / "env" / "extravars").read_text())
        request["atlantis_request"]["targets"][hosts[0]]["port"] = 1
        (place / "env" / "extravars").write_text(json.dumps(request))
        recap = run(place)
    assert recap["code"] == 2
    assert list(recap["failures"]) == [hosts[0]]
    assert hosts[1] in recap["ok"]


def test_image_definition_installs_only_the_locked_requirements() -> None:
    """And nothing besides that pip could fetch: tests of the lists say what is in it."""
    assert set(DEFINITION["dependencies"]) == {"system"}
    assert DEFINITION["additional_build_files"] == [{"src": "requirements/awx.txt", "dest": "configs"}]
    steps = DEFINITION["additional_build_steps"]
    assert steps["append_base"][0] == "COPY _build/configs/awx.txt /tmp/awx.txt"
    assert "--require-hashes --only-binary :all: --requirement /tmp/awx.txt" in steps["append_base"][1]
    assert [one for one in steps["append_final"] if not one.startswith("ENV ")] == []
    assert DEFINITION["version"] == 3
    assert "/" not in DEFINITION["images"]["base_image"]["name"]
