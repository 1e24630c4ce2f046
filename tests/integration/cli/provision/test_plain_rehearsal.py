"""Plain `ansible-playbook` with `-e atlantis_rehearse=true` meets emulated devices, and nothing real."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from atlantis_netcfg.core.paths import checkout
from atlantis_netcfg.runs import Store

pytestmark = pytest.mark.slow


def play(state: Path, *words: str) -> subprocess.CompletedProcess[str]:
    folder = checkout()
    variables = {
        "ATLANTIS_STATE": str(state),
        "ANSIBLE_CONFIG": str(folder / "ansible.cfg"),
        "ANSIBLE_NOCOLOR": "1",
        "COLUMNS": "1000",
    }
    command = [sys.executable, "-m", "ansible", "playbook", "-i", str(folder / "inventory"), *words]
    return subprocess.run(
        [*command, str(folder / "playbooks" / "site.yml")],
        env={**os.environ, **variables},
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        check=False,
    )


def test_shipped_example_rehearses_in_plain_ansible(tmp_path: Path) -> None:
    done = play(tmp_path, "--limit", "coastal-router,coastal-4g", "-e", "atlantis_rehearse=true")
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stdout.count("changed=1") == 2
    assert Store(tmp_path, is_rehearsal=True).sites() == ("coastal",)
    assert Store(tmp_path).sites() == (), "nothing real has run"


def test_play_advises_its_own_variables(tmp_path: Path) -> None:
    refused = play(tmp_path, "--limit", "coastal-router", "--check")
    told = refused.stdout + refused.stderr
    assert refused.returncode != 0
    assert "or add `-e atlantis_rehearse=true`" in told
    assert "--rehearse" not in told
    mistyped = play(tmp_path, "--limit", "coastal-router", "--check", "-e", "atlantis_rehearse=ture")
    told = mistyped.stdout + mistyped.stderr
    assert mistyped.returncode == 3
    assert "atlantis_rehearse is neither true nor false: ture" in told
    assert "PLAY RECAP" not in told
