"""Repair .venv after its checkout was moved: `move_venv.py OLD_CHECKOUT NEW_CHECKOUT`, run by the .venv's own Python.

Environments hold absolute paths in their activate scripts and in the first lines of their programs; the packages
themselves do not care. So a checkout on a stick or a renamed folder starts without the package index.
"""

from __future__ import annotations

import sys
import venv
from pathlib import Path


def _header(python: Path) -> bytes:
    """A first line for any path: the plain form ends at a space and is cut at 127 bytes by the kernel."""
    return f"#!/bin/sh\n'''exec' \"{python}\" \"$0\" \"$@\"\n' '''\n".encode()


def _repaired(program: bytes, old: bytes, header: bytes) -> bytes | None:
    first, _, rest = program.partition(b"\n")
    if first.startswith(b"#!") and old in first:
        return header + rest
    if first == b"#!/bin/sh" and old in rest.partition(b"\n")[0]:
        return header + rest.split(b"\n", 2)[2]
    return None


def main(old: Path, new: Path) -> None:
    """Write the activate scripts anew, then the first lines of the programs."""
    venv.EnvBuilder(symlinks=True).create(new / ".venv")
    programs = new / ".venv" / "bin"
    header = _header(programs / "python")
    for path in programs.iterdir():
        if path.is_symlink() or not path.is_file():
            continue
        repaired = _repaired(path.read_bytes(), f"{old}/.venv/".encode(), header)
        if repaired is not None:
            path.write_bytes(repaired)


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
