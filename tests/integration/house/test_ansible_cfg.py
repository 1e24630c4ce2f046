"""Plain Ansible works from the checkout: ansible.cfg is valid, and holds what it promises."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from house_checkout import ROOT

pytestmark = pytest.mark.slow


def ansible(program: str, *arguments: str, home: Path) -> subprocess.CompletedProcess[str]:
    environment = {name: value for name, value in os.environ.items() if not name.startswith("ANSIBLE_")}
    return subprocess.run(
        [str(Path(sys.executable).parent / program), *arguments],
        cwd=ROOT,
        env=environment | {"HOME": str(home), "ANSIBLE_HOME": str(home), "NO_COLOR": "1", "LC_ALL": "C.UTF-8"},
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        check=False,
    )


def test_every_setting_is_known(tmp_path: Path) -> None:
    process = ansible("ansible-config", "validate", "-t", "all", home=tmp_path)
    assert (process.returncode, process.stderr) == (0, "")


def test_the_inventory_is_read_without_a_warning(tmp_path: Path) -> None:
    process = ansible("ansible-inventory", "--list", home=tmp_path)
    assert (process.returncode, process.stderr) == (0, "")
    assert {"scc", "coastal", "te4sea"} <= json.loads(process.stdout).keys()


def test_the_playbooks_are_sound(tmp_path: Path) -> None:
    playbooks = [str(path.relative_to(ROOT)) for path in sorted((ROOT / "playbooks").glob("*.yml"))]
    process = ansible("ansible-playbook", "--syntax-check", *playbooks, home=tmp_path)
    assert (process.returncode, process.stderr) == (0, "")


@pytest.mark.parametrize("text", ["all: [", "{{{"])
def test_a_file_that_cannot_be_read_stops_everything(text: str, tmp_path: Path) -> None:
    (tmp_path / "hosts.yml").write_text(text)
    process = ansible("ansible-inventory", "-i", str(tmp_path / "hosts.yml"), "--list", home=tmp_path)
    assert process.returncode != 0
    assert "hosts.yml" in process.stderr
