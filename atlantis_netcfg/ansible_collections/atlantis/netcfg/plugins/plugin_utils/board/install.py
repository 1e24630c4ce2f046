"""Sent ahead of the zipapp: reads it from standard input, installs it atomically, and runs it.

Its arguments are the folder, the SHA-256 and the packed size of the zipapp, the marker of a result, and the module's
name. On standard input the module's parameters follow the zipapp.
"""

# ruff: noqa: PTH103, PTH105, PTH108, PTH118, PTH208 - paths are text on the gateways' side

from __future__ import annotations

import bz2
import contextlib
import fcntl
import hashlib
import io
import json
import os
import runpy
import sys
import tempfile
import types
import zipfile
from typing import Any

MODULES = ("atlantis_netcfg.core.messages", "atlantis_netcfg.core.stored_messages", "atlantis.module_utils.errors")
"""Modules of the tool that turn operating system errors into messages; each needs those before it."""


def main(folder: str, sha256: str, size: str, mark: str, module: str) -> None:
    """Install the zipapp and run the module; report a failure in the module's own format."""
    packed_tool = sys.stdin.buffer.read(int(size))
    try:
        tool = bz2.decompress(packed_tool)
    except (OSError, ValueError):
        tool = b""
    if hashlib.sha256(tool).hexdigest() != sha256:
        _fail(mark, "the toolkit's program did not arrive whole", "type the same again")
    name = f"{sha256}.pyz"
    try:
        _install_file(folder, name, tool)
    except OSError as error:
        archive = zipfile.ZipFile(io.BytesIO(tool))
        _, stored_messages, errors = (_load(archive, name) for name in MODULES)
        failure = errors.as_module_error(error, folder)
        _fail(mark, failure.message, failure.hint, **stored_messages.marked_texts([failure.message, failure.hint]))
    _sweep(folder, name)
    sys.argv = [os.path.join(folder, name), module]
    runpy.run_path(sys.argv[0], run_name="__main__")


def _load(archive: zipfile.ZipFile, name: str) -> Any:  # noqa: ANN401 - its attributes are not known here
    """Import a module of the tool from memory: the disk may be full."""
    module = sys.modules[name] = types.ModuleType(name)
    exec(archive.read(f"{name.replace('.', '/')}.py"), module.__dict__)  # noqa: S102 - what has just been compared
    return module


def _install_file(folder: str, name: str, content: bytes) -> None:
    before = os.umask(0o022)
    try:
        os.makedirs(folder, exist_ok=True)
    finally:
        os.umask(before)
    handle, new = tempfile.mkstemp(dir=folder, prefix=".new-")
    try:
        with open(handle, "wb") as file:  # noqa: PTH123 - a handle
            fcntl.flock(file, fcntl.LOCK_EX)
            os.fchmod(file.fileno(), 0o644)
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
            os.replace(new, os.path.join(folder, name))
    except BaseException:
        with contextlib.suppress(FileNotFoundError):
            os.unlink(new)
        raise
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def _sweep(folder: str, name: str) -> None:
    """Remove older zipapps and leftovers of power cuts, but nothing that another run is using."""
    for other in os.listdir(folder):
        with contextlib.suppress(OSError):
            if other != name:
                handle = os.open(os.path.join(folder, other), os.O_RDONLY | os.O_NOFOLLOW)
                try:
                    fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
                    os.unlink(os.path.join(folder, other))
                finally:
                    os.close(handle)


def _fail(mark: str, message: str, hint: str, **more: object) -> None:
    result = {"failed": True, "msg": message, "hint": hint, "changes": [], **more}
    print(f"\n{mark}{json.dumps(result)}")  # noqa: T201 - as a module reports
    sys.exit(1)


if __name__ == "__main__":
    main(*sys.argv[1:])
