"""What setup.py lays into a wheel is what stands in the checkout: a new role or data file cannot be left out."""

import ast
import fnmatch
import subprocess
import tomllib
from pathlib import Path
from typing import Any

import pytest

from atlantis_netcfg.core import paths

ROOT = Path(__file__).parents[3]
DEVELOPMENT = {"bench", "checks", "docs", "requirements", "tests", "tools"}
"""Folders that only those who have a checkout need."""


def plain_part(file: Path) -> dict[str, Any]:
    """What setup.py defines without setuptools, whose import takes the place of distutils in the whole process."""
    kinds = (ast.Assign, ast.FunctionDef)
    nodes: list[ast.stmt] = [
        node
        for node in ast.parse(file.read_text()).body
        if isinstance(node, kinds) or (isinstance(node, ast.ImportFrom) and node.module == "pathlib")
    ]
    names: dict[str, Any] = {"__file__": str(file)}
    exec(compile(ast.Module(nodes, []), file, "exec"), names)  # noqa: S102 - our own file
    return names


SETUP = plain_part(ROOT / "setup.py")


def tracked_files() -> set[Path]:
    """The files that git knows or would know."""
    command = ["git", "-c", "safe.directory=*", "ls-files", "-z", "--cached", "--others", "--exclude-standard"]
    names = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True).stdout.split("\0")
    return {Path(name) for name in names if name and (ROOT / name).is_file()}


def test_every_top_level_folder_is_in_the_wheel_or_for_development_only() -> None:
    folders = {path.parts[0] for path in tracked_files() if len(path.parts) > 1 and not path.parts[0].startswith(".")}
    assert folders == {*SETUP["RESOURCES"], "atlantis_netcfg", *DEVELOPMENT} - {"ansible.cfg"}


def test_resources_are_exactly_the_tracked_files_of_their_folders() -> None:
    files = {path for path in tracked_files() if path.parts[0] in SETUP["RESOURCES"]}
    assert {Path("roles/routeros/tasks/main.yml"), Path("inventory/.schema/site.json"), Path("ansible.cfg")} <= files
    assert set(SETUP["resource_files"]()) == files


def test_resources_leave_out_compiled_modules_and_images(tmp_path: Path) -> None:
    for name in ("templates/__pycache__/a.pyc", "inventory/images/debian.img", "inventory/hosts.yml", "docs/index.md"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text("")
    assert SETUP["resource_files"](tmp_path) == [Path("inventory/hosts.yml")]


def test_every_data_file_of_the_package_has_a_pattern() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())
    patterns = ["*.py", *project["tool"]["setuptools"]["package-data"]["*"]]
    names = {str(path): path.name for path in tracked_files() if path.parts[0] == "atlantis_netcfg"}
    assert [path for path, name in names.items() if not any(fnmatch.fnmatch(name, each) for each in patterns)] == []


def test_resources_of_a_checkout_are_its_own_folders() -> None:
    assert not paths.is_installed()
    assert [paths.resource(name) for name in SETUP["RESOURCES"]] == [ROOT / name for name in SETUP["RESOURCES"]]
    assert (paths.collections() / "ansible_collections" / "atlantis" / "netcfg").is_dir()
    assert paths.inventory_folder(None) == ROOT / "inventory"
    assert paths.inventory_folder("mine") == Path("mine")


def test_resources_of_an_installed_package_are_inside_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(paths, "_SHARE", tmp_path)
    monkeypatch.chdir(tmp_path)
    assert paths.is_installed()
    assert [paths.resource(name) for name in SETUP["RESOURCES"]] == [tmp_path / name for name in SETUP["RESOURCES"]]
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path / "elsewhere")
    assert paths.inventory_folder(None) == tmp_path / "elsewhere" / "inventory", "never the example in the package"
