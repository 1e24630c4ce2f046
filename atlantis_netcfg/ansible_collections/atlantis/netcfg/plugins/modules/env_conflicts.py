"""Module `atlantis.netcfg.env_conflicts`: find other files that set environment variables to conflicting values."""

# ruff: noqa: E402, TID252 - a module begins with its documentation, and Ansible ships what is imported relatively

from __future__ import annotations

DOCUMENTATION = r"""
module: env_conflicts
short_description: Tell where else variables of the environment are set, and to what
description:
  - Reads the files from which logins and services have their environment, of the system and of every account.
  - Changes nothing; each place that sets one of the variables to another value becomes a note of the run.
options:
  variables:
    description: Names and the values that they have in our own files.
    type: dict
    required: true
  ours:
    description: Our own files, which are not looked at.
    type: list
    elements: str
    default: []
  why:
    description: What happens where one of them is set otherwise; closes each note.
    type: str
    required: true
author: ATLANTIS pilot team
"""

EXAMPLES = r"""
- name: Look for what would keep ROS 2 on this computer
  atlantis.netcfg.env_conflicts:
    variables: {ROS_LOCALHOST_ONLY: "0"}
    ours: [/etc/atlantis/ros.env]
    why: with it ROS 2 does not leave this computer
"""

RETURN = r"""
notes:
  description: One sentence for each place, with what to do about it.
  type: list
  elements: str
  returned: always
"""

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Iterator, Mapping

from ansible.module_utils.basic import AnsibleModule

from atlantis_netcfg.core.messages import arg, msg

from ..module_utils.errors import ModuleError
from ..module_utils.filesystem import FileSystem

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
"""Index of the home directory in a line of passwd(5)."""


@dataclass(frozen=True)
class Setting:
    """One variable, set in one line of a file."""

    path: str
    line: int
    name: str
    value: str


def contradicting(tree: FileSystem, variables: Mapping[str, str], ours: frozenset[str]) -> list[Setting]:
    """Return the settings, outside our own files `ours`, of these variables to a value other than the desired one."""
    return [
        setting
        for path in (_places(tree) if variables else ())
        if path not in ours
        for setting in settings(path, (tree.read(path) or b"").decode(errors="replace"), variables)
        if setting.value != variables[setting.name]
    ]


def note(setting: Setting, why: str) -> str:
    """Describe a setting, why it is a problem, and how to remove it."""
    place = msg(f"line {arg(setting.line)} of {arg(setting.path)}")
    return msg(
        f"{arg(place)} sets {arg(setting.name)}={arg(setting.value)}: {arg(why)}; remove that line and log in again"
    )


def _places(tree: FileSystem) -> Iterator[str]:
    """Yield existing files that may set variables; symbolic links are followed, as shells do."""
    accounts = (tree.read("/etc/passwd") or b"").decode(errors="replace").splitlines()
    homes = {fields[_HOME] for fields in (line.split(":") for line in accounts) if len(fields) > _HOME}
    local = [f"{home}/{name}" for home in sorted(homes) if home.strip("/") for name in OF_AN_ACCOUNT]
    root = Path(tree.root)
    for pattern in (*OF_ALL, *OF_SYSTEMD):
        yield from (f"/{path.relative_to(root)}" for path in sorted(root.glob(pattern[1:])))
    yield from (path for path in local if tree.read(path) is not None)


def settings(path: str, text: str, names: Mapping[str, str]) -> Iterator[Setting]:
    """Yield settings of these names in the syntax of shells, pam_env and systemd; `#` and `;` start comments."""
    pattern = re.compile(rf"(?:^|[\s;&\"'=])({'|'.join(map(re.escape, names))})(?:=|\s+DEFAULT=)[\"']?([^\s;&\"']*)")
    for number, line in enumerate(text.splitlines(), 1):
        if not line.lstrip().startswith(("#", ";")):
            for name, value in pattern.findall(line):
                yield Setting(path, number, name, value)


ARGUMENTS = {
    "variables": {"type": "dict", "required": True},
    "ours": {"type": "list", "elements": "str", "default": []},
    "why": {"type": "str", "required": True},
}


def main() -> None:
    """Run the module."""
    module = AnsibleModule(ARGUMENTS, supports_check_mode=True)
    variables = {name: str(value) for name, value in module.params["variables"].items()}
    try:
        conflicts = contradicting(FileSystem(), variables, frozenset(module.params["ours"]))
    except ModuleError as refused:
        module.fail_json(msg=refused.message, hint=refused.hint)
    module.exit_json(changed=False, changes=[], notes=[note(setting, module.params["why"]) for setting in conflicts])


if __name__ == "__main__":
    main()
