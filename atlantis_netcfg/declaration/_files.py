"""Which files an inventory has, and which of them nobody would read.

Ansible takes `group_vars/<name>.yml`, a folder of that name, and more spellings than a person remembers; of a file and
a folder of one name it reads the folder alone (ansible-core, `DataLoader.find_vars_files`). One spelling is allowed
here, and every other file is told, so that nothing is declared in vain.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from atlantis_netcfg.core.suggest import nearest
from atlantis_netcfg.declaration._yaml import parse
from atlantis_netcfg.declaration.findings import Finding, Mark

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from atlantis_netcfg.declaration._node import Node
    from atlantis_netcfg.declaration._vault import Decrypt

__all__ = ["HOSTS", "Sources", "scan"]

HOSTS = "hosts.yml"
_OTHERS = ("evidence", "keys")
"""Folders of files that terminals have exported, and of public keys of archives; ansible.cfg keeps Ansible out."""
_FOLDERS = ("group_vars", "host_vars")
_DOCUMENTS = frozenset({".md", ".rst", ".txt"})
_BACKUPS = ("~", ".bak", ".orig", ".swp", ".old", ".save", ".rej")


@dataclass(slots=True)
class Sources:
    """The files of an inventory by what they are for."""

    root: Path
    shown: str
    """The root's name in errors."""
    group_vars: dict[str, list[Path]] = field(default_factory=dict)
    host_vars: dict[str, list[Path]] = field(default_factory=dict)
    findings: list[Finding] = field(default_factory=list)
    strays: set[str] = field(default_factory=set)
    """Stems of files that nobody reads: their host or site is not without a file, the file is in a wrong place."""
    contents: dict[str, bytes] = field(default_factory=dict)
    """What was read, by the files' names in errors."""

    def name(self, path: Path) -> str:
        """A file's name in errors."""
        return f"{self.shown}/{path.relative_to(self.root).as_posix()}"

    def read(self, path: Path, decrypt: Decrypt | None) -> tuple[Node | None, list[Finding]]:
        """Read and parse one file."""
        shown = self.name(path)
        try:
            self.contents[shown] = path.read_bytes()
        except OSError as error:
            reason = (error.strerror or "no reason given").lower()
            return None, [
                Finding.at(Mark(shown, 1, 1), f"the file cannot be read: {reason}", f"look at it: ls -ld {shown}")
            ]
        return parse(self.contents[shown], shown, decrypt)


def scan(root: Path, shown: str) -> Sources:
    """List an inventory directory that is known to exist."""
    sources = Sources(root, shown)
    for entry in _entries(root):
        if entry.name in _FOLDERS and entry.is_dir():
            _scan_folder(sources, entry, sources.group_vars if entry.name == "group_vars" else sources.host_vars)
        elif entry.name != HOSTS and not (entry.name in _OTHERS and entry.is_dir()):
            _stray(sources, entry, (HOSTS, *_FOLDERS))
    return sources


def _entries(folder: Path) -> list[Path]:
    return sorted(entry for entry in folder.iterdir() if not entry.name.startswith("."))


def _scan_folder(sources: Sources, folder: Path, found: dict[str, list[Path]]) -> None:
    for entry in _entries(folder):
        if entry.is_dir():
            found.setdefault(entry.name, []).extend(_scan_inner(sources, entry))
        elif entry.suffix == ".yml":
            if entry.stem in found:
                hint = f"move it into {sources.name(entry.with_suffix(''))}/"
                message = f"Ansible does not read this file beside the folder `{entry.stem}`"
                sources.findings.append(Finding.at(Mark(sources.name(entry), 1, 1), message, hint))
            found.setdefault(entry.stem, []).append(entry)
        else:
            _stray(sources, entry)


def _scan_inner(sources: Sources, folder: Path) -> Iterator[Path]:
    for entry in _entries(folder):
        if entry.suffix == ".yml" and not entry.is_dir():
            yield entry
        else:
            _stray(sources, entry)


def _stray(sources: Sources, entry: Path, expected: tuple[str, ...] = ()) -> None:
    """Tell a file or folder that is not read; documents may lie about, Ansible passes them by as well."""
    shown = sources.name(entry)
    sources.strays.update(path.stem for path in (entry, *entry.rglob("*")))
    if entry.is_dir():
        inside = next((path for path in sorted(entry.rglob("*")) if path.is_file()), None)
        if inside is None:
            return
        near = nearest(entry.name, expected)
        hint = f"did you mean `{near}`?" if near else f"put its files where they are read, or remove it: rm -r {shown}"
        _tell(sources, inside, f"nobody reads the folder `{entry.name}`", hint)
    elif entry.name.endswith(_BACKUPS):
        _tell(sources, entry, "this copy is not read, and may hold secrets", f"remove it: rm {shown}")
    elif entry.suffix not in _DOCUMENTS:
        stem = entry.name.removesuffix(entry.suffix) if entry.suffix in {".yaml", ".json", ".ini", ""} else entry.stem
        name = nearest(f"{stem}.yml", expected) or f"{stem}.yml"
        _tell(sources, entry, f"nobody reads the file `{entry.name}`", f"rename it: mv {shown} {_beside(shown, name)}")


def _tell(sources: Sources, path: Path, message: str, hint: str) -> None:
    sources.findings.append(Finding.at(Mark(sources.name(path), 1, 1), message, hint))


def _beside(shown: str, name: str) -> str:
    return f"{shown.rpartition('/')[0]}/{name}"
