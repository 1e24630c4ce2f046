"""Two technicians type `provision` on two laptops at one router: one is told plainly, and nothing is half done."""

import json
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest
from quay import PROVISION, ROUTER, Quay, fresh_quay

pytestmark = [pytest.mark.slow, pytest.mark.namespace]
at = pytest.fixture(fresh_quay)


def start(at: Quay, laptop: str, inventory: Path) -> subprocess.Popen[str]:
    """Type the command on a laptop: a state folder of its own, so that no lock is in common."""
    return subprocess.Popen(
        [PROVISION, "site=coastal", f"device={ROUTER}", "--yes", "--json", f"inventory={inventory}"],
        env=at.laptop(laptop),
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def ended(laptop: subprocess.Popen[str]) -> tuple[int, dict[str, Any]]:
    out, err = laptop.communicate()
    assert out, err
    result: dict[str, Any] = json.loads(out)["devices"][ROUTER]
    return laptop.returncode, result


def other_declaration(at: Quay) -> Path:
    """The same pilot, but the coastal lab is somewhere else."""
    copy = at.inventory.with_name("other-inventory")
    shutil.copytree(at.inventory, copy)
    for path in copy.rglob("*.yml"):
        path.write_text(path.read_text(encoding="utf-8").replace("Europe/Lisbon", "Europe/Athens"), encoding="utf-8")
    return copy


@pytest.mark.parametrize("other", [False, True], ids=["same", "other"])
def test_only_one_of_two_concurrent_laptops_changes_the_device(at: Quay, other: bool) -> None:  # noqa: FBT001
    declarations = (at.inventory, other_declaration(at) if other else at.inventory)
    at.do("link", delay_s=0.1)
    laptops = [start(at, f"laptop{number}", declaration) for number, declaration in enumerate(declarations)]
    results = [ended(laptop) for laptop in laptops]
    told = [(code, result["status"], result["message"]) for code, result in results]
    statuses = sorted(result["status"] for _, result in results)
    assert statuses in (["changed", "left-as-found"], ["changed", "unchanged"]), told
    for code, result in results:
        assert code == (4 if result["status"] == "left-as-found" else 0)
        if code:
            assert "nothing was changed" in result["message"]
            assert "provision@" in result["message"] or "somebody else has changed the device" in result["message"]
    at.do("link", delay_s=0.0)
    winner = declarations[[result["status"] for _, result in results].index("changed")]
    code, again = ended(start(at, "laptop2", winner))
    assert (code, again["status"]) == (0, "unchanged")
