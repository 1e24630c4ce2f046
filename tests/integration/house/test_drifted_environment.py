"""A package was removed from `.venv`: `provision inventory doctor` names it, and what it advises brings it back."""

import json
import shlex
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest
from house_checkout import clean_environment, shared_checkout, start

pytestmark = pytest.mark.slow


@pytest.fixture
def checkout(tmp_path_factory: pytest.TempPathFactory, tmp_path: Path) -> Path:
    """A copy: others use the shared one."""
    return shutil.copytree(shared_checkout(tmp_path_factory), tmp_path / "atlantis", symlinks=True)


def looked(checkout: Path) -> dict[str, Any]:
    """What the doctor says to a program."""
    done = start(checkout, "inventory", "doctor", "--json", environment=clean_environment(HOME=str(checkout.parent)))
    document = json.loads(done.stdout)
    assert isinstance(document, dict)
    return document


def packages(document: dict[str, Any]) -> dict[str, Any]:
    (found,) = [item for item in document["items"] if item["name"] == "packages"]
    assert isinstance(found, dict)
    return found


def remove(checkout: Path, package: str) -> None:
    words = [str(checkout / ".venv" / "bin" / "python"), "-m", "pip", "uninstall", "-y", package]
    subprocess.run(words, check=True, capture_output=True)


def test_missing_package_is_reported_and_reinstalled_as_advised(checkout: Path) -> None:
    assert packages(looked(checkout))["verdict"] == "PASS"
    remove(checkout, "fpdf2")
    found = packages(looked(checkout))
    assert (found["verdict"], found["measured"]) == ("FAIL", "fpdf2 is missing")
    remove(checkout, "pydantic")
    (error,) = looked(checkout)["errors"]
    assert error["message"] == (
        "the packages in .venv differ from the pinned versions: fpdf2 is missing; pydantic is missing"
    )
    assert f"`{found['commands'][0]}` in {checkout}" in error["hint"]
    subprocess.run(shlex.split(found["commands"][0]), cwd=checkout, check=True)
    assert packages(looked(checkout))["verdict"] == "PASS"
