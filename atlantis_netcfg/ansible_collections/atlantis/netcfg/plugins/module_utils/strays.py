"""What stands in folders that are ours alone, and is not declared: left by an earlier declaration."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from typing import Iterator

    from .tree import Tree
    from .wishes import Wishes

__all__ = ["clear", "strays"]


def strays(tree: Tree, wishes: Wishes) -> tuple[str, ...]:
    """Files and links, at any depth, below the folders `only`; a link to a directory is not followed."""
    kinds = (wishes.directories, wishes.files, wishes.links)
    declared = {item.path for kind in kinds for item in kind} | {*wishes.absent}
    return tuple(path for folder in wishes.only for path in _below(tree, folder) if path not in declared)


def clear(tree: Tree, wishes: Wishes, removed: tuple[str, ...]) -> None:
    """Remove the directories that have become empty, up to the folders `only`, which stay."""
    for folder in map(Path, wishes.only):
        below = {above for path in removed for above in Path(path).parents if folder in above.parents}
        for empty in sorted(below, key=lambda path: len(path.parts), reverse=True):
            tree.remove_directory(str(empty))


def _below(tree: Tree, folder: str) -> Iterator[str]:
    root = Path(tree.root)
    for at, directories, files in os.walk(tree.at(folder)):
        links = [name for name in directories if Path(at, name).is_symlink()]
        yield from (f"/{Path(at, name).relative_to(root)}" for name in sorted(files + links))
