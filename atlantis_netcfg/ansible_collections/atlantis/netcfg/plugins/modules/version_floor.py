"""Module `atlantis.netcfg.version_floor`: a program that is too old for what it is trusted with is not started."""

# ruff: noqa: E402, TID252 - a module begins with its documentation, and Ansible ships what is imported relatively

from __future__ import annotations

DOCUMENTATION = r"""
module: version_floor
short_description: Refuse a program whose version is known to be unsafe
description:
  - Reads the version of the program that is installed, and that of its Debian package, and changes nothing.
  - A distribution mends an old version without giving it a new number; such packages are named one by one.
  - In check mode a program that is not installed yet passes.
options:
  program: {description: Path of the program; it is asked with C(--version)., type: str, required: true}
  package: {description: Its Debian package., type: str, required: true}
  branches:
    description: The branches that are still mended; a later branch than all of them passes.
    type: list
    elements: dict
    required: true
    suboptions:
      branch: {description: Its first two numbers., type: str, required: true}
      upstream: {description: The first version of it that passes., type: str, required: true}
      packages:
        description: Debian packages of older versions that pass, with what comes after them for the same release.
        type: list
        elements: str
        default: []
author: ATLANTIS pilot team
"""

EXAMPLES = r"""
- name: Refuse an OpenVPN with known holes
  atlantis.netcfg.version_floor:
    program: /usr/sbin/openvpn
    package: openvpn
    branches: [{branch: "2.6", upstream: "2.6.21", packages: ["2.6.14-0+deb12u2"]}]
"""

RETURN = r"""
version:
  description: What is installed; empty where nothing is, in check mode.
  type: str
  returned: success
hint:
  description: What to do about a failure.
  type: str
  returned: on failure
"""

from typing import Any

from ansible.module_utils.basic import AnsibleModule

from ..module_utils.floor import Branch, Floor, hold
from ..module_utils.refused import Refused

_TEXT = {"type": "str", "required": True}
ARGUMENTS: dict[str, Any] = {
    "program": _TEXT,
    "package": _TEXT,
    "branches": {
        "type": "list",
        "elements": "dict",
        "required": True,
        "options": {
            "branch": _TEXT,
            "upstream": _TEXT,
            "packages": {"type": "list", "elements": "str", "default": []},
        },
    },
}


def main() -> None:
    """Run the module."""
    module = AnsibleModule(ARGUMENTS, supports_check_mode=True)
    result = module.params
    branches = tuple(Branch(item["branch"], item["upstream"], tuple(item["packages"])) for item in result["branches"])
    try:
        version = hold(Floor(result["program"], result["package"], branches), absent_passes=module.check_mode)
    except Refused as refused:
        module.fail_json(msg=refused.message, hint=refused.hint)
    module.exit_json(changed=False, version=version)


if __name__ == "__main__":
    main()
