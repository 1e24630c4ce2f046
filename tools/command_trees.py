#!/usr/bin/env python3
"""Writes what each published RouterOS version changed in the command tree (emulator/routeros/data/changes.json.gz).

    tools/command_trees.py FOLDER    a clone of github.com/tikoci/restraml, bare or not; data only, The Unlicense

A new version is one more name in VERSIONS, in order. Each change is a JSON merge patch (RFC 7396) of the names on the
tree of the version before it; 7.18.2 and 7.21.5 are whole files of their own, from which the chain goes on.
"""

from __future__ import annotations

import gzip
import hashlib
import json
import subprocess
import sys
from itertools import pairwise
from pathlib import Path
from typing import Any

COMMIT = "676c4bdfe211d51e8d48785b2ae2b72f838d20c8"
VERSIONS = (
    *("7.16", "7.17", "7.18.2", "7.19", "7.19.3", "7.19.6", "7.20", "7.20.1", "7.20.5", "7.20.8"),
    *("7.21", "7.21.1", "7.21.2", "7.21.3", "7.21.4", "7.21.5"),
    *("7.22", "7.22.1", "7.22.2", "7.23", "7.23.1", "7.23.2", "7.24"),
)
"""Every published tree from 7.16 on that differs from the one before it."""
WHOLE = ("7.16", "7.18.2", "7.21.5")
DATA = Path(__file__).resolve().parents[1] / "atlantis_netcfg" / "emulator" / "routeros" / "data"

Node = dict[str, Any]


def main() -> None:
    """Read the trees, write the changes and the list of digests."""
    trees = {version: names(published(sys.argv[1], version)) for version in VERSIONS}
    changes = {
        version: {"after": before, "change": difference(trees[before], trees[version])}
        for before, version in pairwise(VERSIONS)
        if version not in WHOLE
    }
    text = json.dumps(changes, separators=(",", ":")).encode()
    (DATA / "changes.json.gz").write_bytes(gzip.compress(text, 9, mtime=0))
    digests = {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in sorted(DATA.glob("*.json.gz"))}
    (DATA / "SHA256SUMS").write_text("".join(f"{digest}  {name}\n" for name, digest in digests.items()), "utf-8")


def published(folder: str, version: str) -> Node:
    """Return one tree as it was published."""
    show = ["git", "-C", folder, "show", f"{COMMIT}:docs/{version}/extra/inspect.json"]
    tree: Node = json.loads(subprocess.run(show, capture_output=True, check=True).stdout)
    return tree


def names(node: Node) -> Node:
    """Leave out the descriptions: they come and go between versions without any change of meaning."""
    return {name: names(child) if isinstance(child, dict) else child for name, child in node.items() if name != "desc"}


def difference(old: Node, new: Node) -> Node:
    """Return the merge patch that makes `new` of `old`."""
    patch: Node = {name: None for name in old if name not in new}
    for name, child in new.items():
        before = old.get(name)
        if isinstance(before, dict) and isinstance(child, dict):
            if changed := difference(before, child):
                patch[name] = changed
        elif before != child:
            patch[name] = child
    return patch


if __name__ == "__main__":
    main()
