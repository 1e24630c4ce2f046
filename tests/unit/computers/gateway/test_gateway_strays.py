"""Folders that are ours alone hold what is declared, and nothing that an earlier declaration has left."""

import os
from pathlib import Path
from typing import Any

import pytest

from atlantis_netcfg.ansible_collections.atlantis.netcfg.plugins.module_utils.configure import Configure
from atlantis_netcfg.ansible_collections.atlantis.netcfg.plugins.module_utils.desired_state import DesiredState
from atlantis_netcfg.ansible_collections.atlantis.netcfg.plugins.module_utils.errors import ModuleError
from atlantis_netcfg.ansible_collections.atlantis.netcfg.plugins.module_utils.filesystem import FileSystem
from atlantis_netcfg.ansible_collections.atlantis.netcfg.plugins.module_utils.programs import ProgramResult

FOLDER = "/etc/ours"
KEPT = {"path": f"{FOLDER}/4g/a.xml", "content": "a", "owner": str(os.geteuid()), "group": str(os.getegid())}


def configured(root: Path, *, check: bool = False, **told: Any) -> list[str]:  # noqa: ANN401 - of the module
    wishes = DesiredState.of({"only": [FOLDER], **told})
    configure = Configure(FileSystem(str(root)), wishes, check=check, run=lambda _argv: ProgramResult(0, ""))
    configure.converge({})
    return configure.changes


@pytest.fixture
def root(tmp_path: Path) -> Path:
    """A folder with what is declared, what is not, and neighbours that are nobody's business."""
    for name in ("4g/a.xml", "4g/old.xml", "satellite/deep/old.xml", ".hidden"):
        path = tmp_path / FOLDER[1:] / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text("a")
    (tmp_path / "etc" / "oursnot").mkdir()
    (tmp_path / "etc" / "oursnot" / "theirs").write_text("x")
    (tmp_path / FOLDER[1:] / "link").symlink_to("../oursnot")
    return tmp_path


def test_undeclared_files_and_empty_folders_are_removed(root: Path) -> None:
    gone = [f"absent {FOLDER}/{name}" for name in (".hidden", "link", "4g/old.xml", "satellite/deep/old.xml")]
    assert sorted(configured(root, files=[KEPT], check=True)) == sorted(gone)
    assert (root / FOLDER[1:] / ".hidden").exists()
    assert sorted(configured(root, files=[KEPT])) == sorted(gone)
    assert sorted(path.name for path in (root / FOLDER[1:]).rglob("*")) == ["4g", "a.xml"]
    assert (root / "etc" / "oursnot" / "theirs").exists()
    assert configured(root, files=[KEPT]) == []


def test_folder_without_declared_files_is_emptied_but_kept(root: Path) -> None:
    assert len(configured(root)) == 5
    assert list((root / FOLDER[1:]).iterdir()) == []
    assert configured(root) == []


def test_missing_folder_needs_no_cleaning(tmp_path: Path) -> None:
    assert configured(tmp_path) == []


def test_folder_must_be_an_absolute_path(tmp_path: Path) -> None:
    with pytest.raises(ModuleError, match="`etc/ours` is not an absolute path"):
        configured(tmp_path, only=["etc/ours"])


# A file that takes another's place is a whole second younger, however fast it came.


def test_files_written_in_one_second_get_increasing_times(tmp_path: Path) -> None:
    tree, seconds = FileSystem(str(tmp_path)), []
    for content in (b"one", b"two", b"six"):
        tree.write("/list", content)
        seconds.append(int((tmp_path / "list").stat().st_mtime))
    assert seconds[0] < seconds[1] < seconds[2]


def test_file_with_a_future_time_gets_a_later_one(tmp_path: Path) -> None:
    tree = FileSystem(str(tmp_path))
    tree.write("/list", b"one")
    os.utime(tmp_path / "list", (4e9, 4e9))
    tree.write("/list", b"two")
    assert (tmp_path / "list").stat().st_mtime == 4e9 + 1
