"""Module `atlantis.netcfg.elsewhere`: which other files of a computer set variables of the environment otherwise."""

# ruff: noqa: E402, TID252 - a module begins with its documentation, and Ansible ships what is imported relatively

from __future__ import annotations

DOCUMENTATION = r"""
module: elsewhere
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
  atlantis.netcfg.elsewhere:
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

from ansible.module_utils.basic import AnsibleModule

from ..module_utils.elsewhere import contradicting, note
from ..module_utils.refused import Refused
from ..module_utils.tree import Tree

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
        found = contradicting(Tree(), variables, frozenset(module.params["ours"]))
    except Refused as refused:
        module.fail_json(msg=refused.message, hint=refused.hint)
    module.exit_json(changed=False, changes=[], notes=[note(setting, module.params["why"]) for setting in found])


if __name__ == "__main__":
    main()
