"""`provision` and plain `ansible-playbook` are two doors to one engine: equal plans, results and exports."""

from pathlib import Path

import pytest
from quay import ROUTER, Quay, quay

pytestmark = [pytest.mark.slow, pytest.mark.namespace]


@pytest.mark.smoke
def test_provision_and_playbook_plan_and_do_the_same(tmp_path: Path) -> None:
    seen = []
    for name in ("provision", "playbook"):
        (tmp_path / name).mkdir()
        with quay(tmp_path / name) as at:
            seen.append(by_provision(at) if name == "provision" else by_playbook(at))
    (planned, export, runs), (shown, export_too, runs_too) = seen
    assert len(planned) > 100
    assert shown[: len(planned)] == planned
    assert export_too == export
    assert runs_too == runs


def by_provision(at: Quay) -> tuple[list[str], list[str], list[object]]:
    plan = at.json("plan", "site=coastal", code=2)["devices"][ROUTER]
    at.provision("site=coastal", "--yes", code=0)
    at.provision("site=coastal", "--yes", code=0)
    return plan["diff"].splitlines(), exported(at), results(at)


def by_playbook(at: Quay) -> tuple[list[str], list[str], list[object]]:
    plan = at.playbook("--check", "--diff")
    assert (plan.returncode, "changed=1" in plan.stdout) == (0, True), plan.stdout + plan.stderr
    for changed in (1, 0):
        done = at.playbook()
        assert (done.returncode, f"changed={changed}" in done.stdout) == (0, True), done.stdout + done.stderr
    shown = plan.stdout.splitlines()
    start = next(number for number, line in enumerate(shown) if line == f"{ROUTER}:") + 1
    return shown[start:], exported(at), results(at)


def exported(at: Quay) -> list[str]:
    """What is configured; keys and certificates are each twin's own."""
    return at.export().splitlines()


def results(at: Quay) -> list[object]:
    """How the journal has each run: exit code, status, confirmed actions."""
    return [(row["exit"], row["unfinished"], row["devices"]) for row in at.runs()]
