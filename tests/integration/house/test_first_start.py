"""The whole of it: this checkout in the hands of a stranger, its environment made from the pins by ./provision."""

import os
import re
import subprocess
from pathlib import Path

import pytest
from house_checkout import as_nobody, clean_environment, let_others_pass, shared_checkout, start

pytestmark = pytest.mark.slow


@pytest.fixture(scope="session")
def checkout(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return shared_checkout(tmp_path_factory)


def test_first_start_sets_up_the_environment_and_answers(checkout: Path) -> None:
    said = (checkout.parent / "first.stderr").read_text()
    assert said.endswith("exit 0\n"), said
    assert [line[:5] for line in said.splitlines() if re.match(r"\[[124]", line)] == ["[1/4]", "[2/4]", "[4/4]"]
    assert "Usage:" in (checkout.parent / "first.stdout").read_text()


def normal(pin: str) -> str:
    name, _, version = pin.partition("==")
    return f"{re.sub('[-_.]+', '-', name).lower()}=={version}"


def test_every_installed_package_is_pinned(checkout: Path) -> None:
    freeze = [str(checkout / ".venv" / "bin" / "python"), "-m", "pip", "freeze", "--all", "--exclude-editable"]
    installed = subprocess.run(freeze, capture_output=True, text=True, check=True).stdout.split()
    listed = re.findall(r"^[\w.-]+==[^\s;]+", (checkout / "requirements" / "run.txt").read_text(), re.MULTILINE)
    pins = {normal(pin) for pin in listed}
    assert [package for package in installed if normal(package) not in pins and not package.startswith("pip==")] == []


def test_help_is_fast_and_silent(checkout: Path) -> None:
    before = os.times()
    later = start(checkout, "--help")
    took_s = sum(os.times()[2:4]) - sum(before[2:4])
    assert (later.returncode, later.stderr) == (0, "")
    assert took_s < 2, "of the processor; 0.06 s on an idle machine, and pip alone needs more than this bound"


def test_an_ordinary_user_starts_a_checkout_of_root(checkout: Path, tmp_path: Path) -> None:
    let_others_pass(checkout / "below")
    let_others_pass(tmp_path / "below")
    theirs = start(checkout, "help", "version", prefix=as_nobody(), environment=clean_environment(HOME="/nonexistent"))
    assert (theirs.returncode, theirs.stderr) == (0, "")
