"""The program that goes to a gateway: always the same bytes, whole or not at all in its place, and what it can do."""

import ast
import errno
import io
import json
import os
import subprocess
import sys
import zipfile
import zlib
from pathlib import Path
from typing import Any

import pytest

from atlantis_netcfg.ansible_collections.atlantis.netcfg.plugins.plugin_utils.board import basic, install
from atlantis_netcfg.core.messages import Message
from atlantis_netcfg.core.processes import remote_bundle as tool
from atlantis_netcfg.operations.common.costs import _TOOL

PLUGINS = Path(basic.__file__).parents[2]
MODULES = sorted(path.stem for path in (PLUGINS / "modules").glob("*.py"))
ELSEWHERE = {"variables": {}, "ours": [], "why": "because"}


def asked(name: str, params: dict[str, Any], *, check: bool = True) -> bytes:
    return zlib.compress(json.dumps({"name": name, "params": params, "check": check, "log": False}).encode())


def sent(folder: Path, made: tool.Tool, packed: bytes | None = None) -> subprocess.CompletedProcess[bytes]:
    """What a gateway does with a tool that it did not have, and with a module behind it."""
    packed = made.payload if packed is None else packed
    return subprocess.run(
        [sys.executable, "-I", tool.INSTALL, folder, made.sha256, str(len(made.payload)), basic.MARK, "env_conflicts"],
        input=packed + asked("env_conflicts", ELSEWHERE),
        capture_output=True,
        check=False,
    )


def told(done: subprocess.CompletedProcess[bytes]) -> dict[str, Any]:
    """The result that a program has told in its last line."""
    line = done.stdout.decode().splitlines()[-1]
    assert line.startswith(basic.MARK), done
    found: dict[str, Any] = json.loads(line.removeprefix(basic.MARK))
    return found


def test_every_module_has_its_thin_action() -> None:
    actions = {path.stem: path.read_text() for path in (PLUGINS / "action").glob("*.py")}
    thin = {name for name, text in actions.items() if "(ZipappAction)" in text and f'module = "{name}"' in text}
    assert thin == set(MODULES)


def test_build_is_reproducible_and_small(tmp_path: Path) -> None:
    one, other = tool.build(), tool.build()
    assert (one.content, one.payload) == (other.content, other.payload)
    assert len(one.payload) <= _TOOL
    copied = tmp_path / "plugins"
    for name in ("modules", "module_utils"):
        (copied / name).mkdir(parents=True)
        for path in sorted((PLUGINS / name).glob("*.py"), reverse=True):
            (copied / name / path.name).write_bytes(path.read_bytes())
            os.utime(copied / name / path.name, (1e9, 1e9))
    assert tool.build(copied).sha256 == one.sha256
    (copied / "modules" / "clock.py").write_text("def main() -> None: pass\n")
    assert tool.build(copied).sha256 != one.sha256


def test_documentation_is_stripped_from_modules(tmp_path: Path) -> None:
    (tmp_path / "tool").write_bytes(tool.build().content)
    with zipfile.ZipFile(tmp_path / "tool") as archive:
        assert archive.testzip() is None
        for name in MODULES:
            text = archive.read(f"atlantis/modules/{name}.py").decode()
            assert "DOCUMENTATION" not in text
            before = ast.parse((PLUGINS / "modules" / f"{name}.py").read_text()).body
            assert len(ast.parse(text).body) == len(before) - 3
        for path in (PLUGINS / "module_utils").glob("*.py"):
            if not path.name.startswith("vpn_"):
                assert archive.read(f"atlantis/module_utils/{path.name}") == path.read_bytes()


def test_vpn_server_tool_is_separate_and_complete(tmp_path: Path) -> None:
    made = tool.build_live()
    assert made.content == tool.build_live().content
    (tmp_path / "tool").write_bytes(made.content)
    with zipfile.ZipFile(tmp_path / "tool") as archive:
        names = set(archive.namelist())
    with zipfile.ZipFile(io.BytesIO(tool.build().content)) as archive:
        assert not [name for name in archive.namelist() if "vpn_" in name], "no gateway pays for it"
    assert {
        "__main__.py",
        "atlantis/module_utils/vpn_serve.py",
        "atlantis/module_utils/errors.py",
        "atlantis_netcfg/core/messages.py",
    } <= names
    done = subprocess.run([sys.executable, "-I", tmp_path / "tool"], input=b"", capture_output=True, check=True)
    assert done.stdout.startswith(b"ATLANTIS-VPN ")


def test_tool_has_the_grammar_of_its_oldest_python() -> None:
    for made in (tool.build(), tool.build_live()):
        with zipfile.ZipFile(io.BytesIO(made.content)) as archive:
            sources = {name: archive.read(name) for name in archive.namelist()}
        assert "atlantis_netcfg/core/messages.py" in sources
        for name, source in sources.items():
            tree = ast.parse(source, feature_version=(3, 8))
            unions = [ast.unparse(node) for node in ast.walk(tree) if _is_union_of_types(node)]
            assert (name, unions) == (name, [])


def _is_union_of_types(node: ast.AST) -> bool:
    """Whether it is `isinstance(value, int | str)`, which is grammar but fails where it runs before Python 3.10."""
    is_isinstance = isinstance(node, ast.Call) and getattr(node.func, "id", "") in ("isinstance", "issubclass")
    return is_isinstance and isinstance(node, ast.Call) and isinstance(node.args[1], ast.BinOp)


def test_shim_covers_everything_that_modules_use() -> None:
    for name in MODULES:
        tree = ast.parse((PLUGINS / "modules" / f"{name}.py").read_text())
        derived = [node for node in tree.body if isinstance(node, ast.ClassDef) and _is_module(node)]
        used = {("module", node) for node in ast.walk(tree)} | {("self", n) for c in derived for n in ast.walk(c)}
        for owner, node in used:
            if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id == owner:
                assert hasattr(basic.AnsibleModule, node.attr) or node.attr in ("params", "check_mode")
        for node in ast.walk(tree):
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("ansible"):
                assert (node.module, [alias.name for alias in node.names]) == (
                    "ansible.module_utils.basic",
                    ["AnsibleModule"],
                )


def _is_module(node: ast.ClassDef) -> bool:
    return any(isinstance(base, ast.Name) and base.id == "AnsibleModule" for base in node.bases)


def test_tool_is_installed_runs_and_replaces_older_ones(tmp_path: Path) -> None:
    folder, made = tmp_path / "a" / "tool", tool.build()
    folder.mkdir(parents=True)
    (folder / "old.pyz").write_text("")
    (folder / ".new-1").write_text("")
    before = os.umask(0o077)
    try:
        done = sent(folder, made)
    finally:
        os.umask(before)
    assert told(done) == {"changed": False, "changes": [], "notes": []}, done
    (left,) = folder.iterdir()
    assert (left.name, left.read_bytes(), left.stat().st_mode & 0o777) == (f"{made.sha256}.pyz", made.content, 0o644)
    again = subprocess.run(
        [sys.executable, "-I", left, "env_conflicts"],
        input=asked("env_conflicts", ELSEWHERE),
        capture_output=True,
        check=False,
    )
    assert (again.returncode, told(again)["notes"]) == (0, [])


@pytest.mark.parametrize("damage", ["short", "other"])
def test_incomplete_upload_is_not_installed(tmp_path: Path, damage: str) -> None:
    made = tool.build()
    packed = made.payload[:1000] if damage == "short" else bytes(len(made.payload))
    done = sent(tmp_path / "tool", made, packed)
    assert told(done)["msg"] == "the toolkit's program did not arrive whole"
    assert done.returncode == 1
    assert list(tmp_path.iterdir()) == []


def test_unwritable_disk_is_reported(tmp_path: Path) -> None:
    (tmp_path / "tool").symlink_to("/proc/atlantis")
    result = told(sent(tmp_path / "tool" / "here", tool.build()))
    assert result["msg"].startswith(str(tmp_path))
    assert [str.__str__(Message(text)) for text in result["texts"]] == [result["msg"]]


def test_full_disk_leaves_no_partial_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(_handle: int) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(OSError, match="No space left"):
        install._install_file(str(tmp_path), "tool.pyz", b"tool")
    assert list(tmp_path.iterdir()) == []


def test_tool_in_use_is_not_removed(tmp_path: Path) -> None:
    made = tool.build()
    sent(tmp_path, made)
    (used,) = tmp_path.iterdir()
    running = subprocess.Popen(
        [sys.executable, "-I", used, "env_conflicts"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    )
    try:
        while not any(str(used.stat().st_ino) in line for line in Path("/proc/locks").read_text().splitlines()):
            assert running.poll() is None
        install._sweep(str(tmp_path), "newer.pyz")
        assert used.exists()
    finally:
        out, _ = running.communicate(asked("env_conflicts", ELSEWHERE))
    assert basic.MARK in out.decode()
    install._sweep(str(tmp_path), "newer.pyz")
    assert not used.exists()
