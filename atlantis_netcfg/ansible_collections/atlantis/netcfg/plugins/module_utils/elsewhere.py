"""Where else on the computer variables of the environment are set, besides our own files."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from typing import Iterator, Mapping

    from .tree import Tree

__all__ = ["OF_ALL", "OF_AN_ACCOUNT", "OF_SYSTEMD", "Setting", "contradicting", "note", "settings"]

OF_ALL = (
    "/etc/environment",
    "/etc/environment.d/*.conf",
    "/etc/profile",
    "/etc/profile.d/*.sh",
    "/etc/bash.bashrc",
    "/etc/zsh/zshenv",
    "/etc/zsh/zshrc",
)
OF_SYSTEMD = (
    "/etc/systemd/system.conf",
    "/etc/systemd/system.conf.d/*.conf",
    "/etc/systemd/system/*.service",
    "/etc/systemd/system/*.service.d/*.conf",
)
OF_AN_ACCOUNT = (".profile", ".bash_profile", ".bash_login", ".bashrc", ".zshenv", ".zshrc", ".pam_environment")
_HOME = 5
"""Field of passwd(5)."""


@dataclass(frozen=True)
class Setting:
    """One variable, set in one line of a file."""

    path: str
    line: int
    name: str
    value: str


def contradicting(tree: Tree, desired: Mapping[str, str], ours: frozenset[str]) -> list[Setting]:
    """Every place outside the files `ours` that sets one of these variables to another value than the wanted one."""
    return [
        setting
        for path in (_places(tree) if desired else ())
        if path not in ours
        for setting in settings(path, (tree.read(path) or b"").decode(errors="replace"), desired)
        if setting.value != desired[setting.name]
    ]


def note(setting: Setting, why: str) -> str:
    """What a person has to know of it."""
    place = f"line {setting.line} of {setting.path}"
    return f"{place} sets {setting.name}={setting.value}: {why}; take that line out, and log in anew"


def _places(tree: Tree) -> Iterator[str]:
    """Files that are there; links among them are read, since a shell reads them too."""
    accounts = (tree.read("/etc/passwd") or b"").decode(errors="replace").splitlines()
    homes = {fields[_HOME] for fields in (line.split(":") for line in accounts) if len(fields) > _HOME}
    local = [f"{home}/{name}" for home in sorted(homes) if home.strip("/") for name in OF_AN_ACCOUNT]
    root = Path(tree.root)
    for pattern in (*OF_ALL, *OF_SYSTEMD):
        yield from (f"/{path.relative_to(root)}" for path in sorted(root.glob(pattern[1:])))
    yield from (path for path in local if tree.read(path) is not None)


def settings(path: str, text: str, names: Mapping[str, str]) -> Iterator[Setting]:
    """What a text sets of these, as shells, pam_env and systemd write it; lines with `#` or `;` first are comments."""
    pattern = re.compile(rf"(?:^|[\s;&\"'=])({'|'.join(map(re.escape, names))})(?:=|\s+DEFAULT=)[\"']?([^\s;&\"']*)")
    for number, line in enumerate(text.splitlines(), 1):
        if not line.lstrip().startswith(("#", ";")):
            for name, value in pattern.findall(line):
                yield Setting(path, number, name, value)
