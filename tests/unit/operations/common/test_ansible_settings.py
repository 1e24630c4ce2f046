"""What a start leaves out of Ansible, and that nobody notices."""

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

PROGRAM = """
import json, sys
from atlantis_netcfg.operations.common.vault import import_ansible
import_ansible()
import ansible.executor.playbook_executor
left_out = "paramiko" not in sys.modules
from ansible.plugins.loader import init_plugin_loader
init_plugin_loader()
import ansible_collections.ansible.builtin as builtin
import paramiko
print(json.dumps([left_out, hasattr(paramiko, "SSHClient"), builtin._collection_meta]))
"""
PLAIN = """
import json
from ansible.plugins.loader import init_plugin_loader
init_plugin_loader()
import ansible_collections.ansible.builtin as builtin
print(json.dumps(builtin._collection_meta))
"""


def started(program: str, cache: Path) -> Any:  # noqa: ANN401 - JSON of any shape
    environment = {**os.environ, "XDG_CACHE_HOME": str(cache)}
    done = subprocess.run([sys.executable, "-c", program], env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


@pytest.fixture(scope="module")
def metadata(tmp_path_factory: pytest.TempPathFactory) -> object:
    """What Ansible reads itself."""
    return started(PLAIN, tmp_path_factory.mktemp("plain"))


def test_cached_metadata_equals_what_ansible_reads(tmp_path: Path, metadata: object) -> None:
    for _ in range(2):
        assert started(PROGRAM, tmp_path) == [True, True, metadata]
        assert len(list((tmp_path / "atlantis" / "ansible").iterdir())) == 1


@pytest.mark.smoke("{")
@pytest.mark.parametrize("damaged", [b"", b"{", b"[]", b"\xff\xfe"])
def test_damaged_cache_file_is_rewritten(damaged: bytes, tmp_path: Path, metadata: object) -> None:
    started(PROGRAM, tmp_path)
    (file,) = (tmp_path / "atlantis" / "ansible").iterdir()
    whole = file.read_bytes()
    file.write_bytes(damaged)
    assert started(PROGRAM, tmp_path)[2] == metadata
    assert file.read_bytes() == whole


def test_no_cache_where_others_can_write(tmp_path: Path, metadata: object) -> None:
    (tmp_path / "atlantis").mkdir()
    (tmp_path / "atlantis").chmod(0o777)
    assert started(PROGRAM, tmp_path)[2] == metadata
    assert list(tmp_path.rglob("*.json")) == []
