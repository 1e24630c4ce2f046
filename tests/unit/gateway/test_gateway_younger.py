"""A file that takes another's place is a whole second younger, however fast it came."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING

from atlantis_netcfg.ansible_collections.atlantis.netcfg.plugins.module_utils.filesystem import FileSystem

if TYPE_CHECKING:
    from pathlib import Path


def test_of_files_of_one_second_each_is_a_second_younger(tmp_path: Path) -> None:
    tree, seconds = FileSystem(str(tmp_path)), []
    for content in (b"one", b"two", b"six"):
        tree.write("/list", content)
        seconds.append(int((tmp_path / "list").stat().st_mtime))
    assert seconds[0] < seconds[1] < seconds[2]


def test_a_file_of_the_future_is_followed(tmp_path: Path) -> None:
    tree = FileSystem(str(tmp_path))
    tree.write("/list", b"one")
    os.utime(tmp_path / "list", (4e9, 4e9))
    tree.write("/list", b"two")
    assert (tmp_path / "list").stat().st_mtime == 4e9 + 1
