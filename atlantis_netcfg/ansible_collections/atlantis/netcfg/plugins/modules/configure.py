"""Module `atlantis.netcfg.configure`: files, steps and units of a computer in one round trip."""

# ruff: noqa: E402, TID252 - a module begins with its documentation, and Ansible ships what is imported relatively

from __future__ import annotations

DOCUMENTATION = r"""
module: configure
short_description: Bring files, steps and units of a computer to what is declared, in one round trip
description:
  - Writes files atomically, all of them validated before the first one takes its place.
  - Runs steps, and restarts units, when what is in the files that they depend on is not what they last succeeded with.
    That is noted in C(/var/lib/atlantis/applied), so that the next run completes one that was killed at any moment.
  - In check mode it tells exactly what it would do; programs that are not installed yet validate nothing then.
options:
  directories:
    description: Directories with a mode or an owner of their own. Those above a file are made without being listed.
    type: list
    elements: dict
    default: []
    suboptions:
      path: {description: From the root., type: str, required: true}
      mode: {description: Four octal digits in quotes., type: str, default: "0755"}
      owner: {description: Name or number of an account., type: str, default: root}
      group: {description: Name or number of a group., type: str, default: root}
  files:
    description: Files, whole. A symbolic link in the place of one is replaced; a directory is refused.
    type: list
    elements: dict
    default: []
    suboptions:
      path: {description: From the root., type: str, required: true}
      content: {description: The text., type: str}
      secret_content: {description: The text, where it holds a secret; it is shown nowhere., type: str}
      mode: {description: Four octal digits in quotes., type: str, default: "0644"}
      owner: {description: Name or number of an account., type: str, default: root}
      group: {description: Name or number of a group., type: str, default: root}
      validate:
        description: A program and its arguments, C(%s) for the file's name; nothing is changed unless it succeeds.
        type: list
        elements: str
        default: []
      hint: {description: What to do where it is not accepted., type: str, default: ""}
      finding:
        description:
          - What is told where it is not accepted. The file, and the steps and units that come after it, stay as they
            are then, and everything else is done; without it nothing is changed at all.
        type: str
        default: ""
  secrets:
    description:
      - Words that stand in C(content) in the place of secrets, each with its secret. A file with such a word is
        shown nowhere.
    type: dict
    default: {}
  links:
    description: Symbolic links.
    type: list
    elements: dict
    default: []
    suboptions:
      path: {description: From the root., type: str, required: true}
      target: {description: What it holds., type: str, required: true}
  absent:
    description: Files and links that are removed.
    type: list
    elements: str
    default: []
  only:
    description: Folders that are ours alone. Files and links in them, at any depth, that are not declared are removed.
    type: list
    elements: str
    default: []
  steps:
    description: Programs to be run, in this order, after the files.
    type: list
    elements: dict
    default: []
    suboptions:
      name: {description: What it does; its note is kept under this name., type: str, required: true}
      run: {description: The program and its arguments., type: list, elements: str, required: true}
      after:
        description: It is run when these files, or C(run), are not what it last succeeded with; without any, once.
        type: list
        elements: str
        default: []
  units:
    description: Units of systemd, in this order, after the steps.
    type: list
    elements: dict
    default: []
    suboptions:
      name: {description: As systemctl takes it., type: str, required: true}
      enabled: {description: Whether it starts with the computer; left alone if omitted., type: bool}
      active: {description: Whether it runs; if omitted, it is restarted only where it runs., type: bool}
      after:
        description: It is restarted when these files are not what it last started with.
        type: list
        elements: str
        default: []
      reload: {description: Reload it instead of restarting it, where it can., type: bool, default: false}
      wait:
        description: Wait until it is up, and read that back; without, a unit that waits for something itself may go on.
        type: bool
        default: true
  brought:
    description: Files that a person brings some day. What is missing of them is told in C(notes), and changes nothing.
    type: list
    elements: dict
    default: []
    suboptions:
      path: {description: From the root., type: str, required: true}
      note: {description: What is told as long as it is missing., type: str, required: true}
  checks:
    description: Programs that only look, in every run and also in check mode.
    type: list
    elements: dict
    default: []
    suboptions:
      run: {description: The program and its arguments., type: list, elements: str, required: true}
      finding: {description: What is told where it does not succeed., type: str, required: true}
      hint: {description: What to do about it., type: str, default: ""}
  way_in:
    description: What must hold of the SSH session that asks; if it does not, nothing is changed.
    type: dict
    suboptions:
      admit: {description: Networks from which SSH is admitted afterwards., type: list, elements: str, default: []}
      port: {description: Port on which SSH is admitted afterwards., type: int}
      key: {description: Only a key opens a session afterwards., type: bool, default: false}
      hint: {description: What to do where it does not hold., type: str, default: ""}
author: ATLANTIS pilot team
"""

EXAMPLES = r"""
- name: Let chrony serve the LAN
  atlantis.netcfg.configure:
    files:
      - path: /etc/chrony/chrony.conf
        content: "{{ chrony_conf }}"
        validate: [chronyd, -p, -f, "%s"]
    units:
      - name: chrony
        enabled: true
        active: true
        after: [/etc/chrony/chrony.conf]
"""

RETURN = r"""
changes:
  description: One line for each change, in the order in which they were made.
  type: list
  elements: str
  returned: always
  sample: [file /etc/chrony/chrony.conf, unit chrony restarted]
notes:
  description: What steps have told in lines that begin with C(note:), and what C(brought) tells of missing files.
  type: list
  elements: str
  returned: success
findings:
  description: What is not as declared and stopped nothing else; told in every run.
  type: list
  elements: str
  returned: success
hint:
  description: What to do about a failure, or about the first finding.
  type: str
  returned: on failure, or with findings
"""

import os
from dataclasses import MISSING, fields
from typing import Any

from ansible.module_utils.basic import AnsibleModule

from ..module_utils.configure import Configure
from ..module_utils.desired_state import ROWS, DesiredState, File, SshRequirements
from ..module_utils.errors import ModuleError
from ..module_utils.filesystem import FileSystem

_STRINGS: dict[str, Any] = {"type": "list", "elements": "str"}
_TYPES: dict[Any, dict[str, Any]] = {
    "str": {"type": "str"},
    "bool": {"type": "bool"},
    "bool | None": {"type": "bool"},
    "int | None": {"type": "int"},
    "tuple[str, ...]": _STRINGS,
}


def _options(row: type[Any]) -> dict[str, Any]:
    return {item.name: {**_TYPES[item.type], **_default(item.default)} for item in fields(row)}


def _default(value: object) -> dict[str, Any]:
    if value is MISSING:
        return {"required": True}
    return {} if value is None else {"default": [] if value == () else value}


_FILE = {**_options(File), "content": {"type": "str"}, "secret_content": {"type": "str", "no_log": True}}
_ONE_CONTENT = [("content", "secret_content")]
ARGUMENTS: dict[str, Any] = {
    **{
        name: {"type": "list", "elements": "dict", "default": [], "options": _options(row)}
        for name, row in ROWS.items()
    },
    "files": {
        "type": "list",
        "elements": "dict",
        "default": [],
        "options": _FILE,
        "mutually_exclusive": _ONE_CONTENT,
        "required_one_of": _ONE_CONTENT,
    },
    "secrets": {"type": "dict", "default": {}, "no_log": True},
    "absent": {**_STRINGS, "default": []},
    "only": {**_STRINGS, "default": []},
    "way_in": {
        "type": "dict",
        "options": {**_options(SshRequirements), "key": {"type": "bool", "default": False, "no_log": False}},
    },
}


class Module(AnsibleModule):  # type: ignore[misc]  # ansible-core ships no type information
    """Writes no contents of files to the computer's journal: Ansible masks no secret of more than one line there."""

    def _log_invocation(self) -> None:
        self.log("Invoked for " + ", ".join(file["path"] for file in self.params["files"]))


def main() -> None:
    """Run the module."""
    module = Module(ARGUMENTS, supports_check_mode=True)
    changes: list[str] = []
    try:
        configure = Configure(FileSystem(), DesiredState.of(module.params), check=module.check_mode)
        changes = configure.changes
        configure.converge(os.environ)
    except ModuleError as refused:
        module.fail_json(msg=refused.message, hint=refused.hint, changes=changes, changed=bool(changes))
    module.exit_json(
        changed=bool(changes),
        changes=changes,
        notes=configure.notes,
        findings=[finding for finding, _ in configure.findings],
        hint=next((hint for _, hint in configure.findings if hint), None),
        diff=configure.diff,
    )


if __name__ == "__main__":
    main()
