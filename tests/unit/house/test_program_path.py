"""Programs of the system are found although the PATH of an ordinary user lacks their folders."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from atlantis_netcfg import cli
from atlantis_netcfg.core import processes

ROOT = Path(__file__).parents[3]
CHECK = """
import shutil, sys
from atlantis_netcfg.cli import main
sys.argv = ["provision", "help", "version"]
main()
print([shutil.which(name) is not None for name in ("sysctl", "nft")])
"""


@pytest.mark.parametrize(
    ("path", "folders"),
    [
        ("/usr/bin:/bin", "/usr/bin:/bin:/usr/sbin:/sbin"),
        ("/sbin:/usr/bin", "/sbin:/usr/bin:/usr/sbin"),
        ("", "/usr/sbin:/sbin"),
        ("/usr/bin::", "/usr/bin:/usr/sbin:/sbin"),  # an empty entry would be the current folder
    ],
)
def test_program_path_ends_with_the_folders_of_the_system(
    path: str, folders: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PATH", path)
    assert processes.program_path() == folders


def test_program_path_without_a_path_has_them_too(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("PATH")
    assert processes.program_path() == f"{os.defpath.strip(':')}:/usr/sbin:/sbin"


def test_a_started_program_finds_them_and_a_call_in_a_process_changes_nothing(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    environment = {"PATH": "/usr/bin:/bin", "PYTHONPATH": os.pathsep.join([str(ROOT), *filter(None, sys.path)])}
    done = subprocess.run(
        [sys.executable, "-P", "-c", CHECK], env=environment, capture_output=True, text=True, check=False
    )
    assert done.stdout.splitlines()[-1:] == ["[True, True]"], done.stdout + done.stderr
    monkeypatch.setenv("PATH", "/usr/bin:/bin")
    assert cli.main(["help", "version"]) == 0
    assert os.environ["PATH"] == "/usr/bin:/bin"
