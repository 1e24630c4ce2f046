"""Module `atlantis.netcfg.clock`: a clock that is far off is set before anything that depends on it."""

# ruff: noqa: E402, TID252 - a module begins with its documentation, and Ansible ships what is imported relatively

from __future__ import annotations

DOCUMENTATION = r"""
module: clock
short_description: Set a clock that is far off to the time of the technician's computer
description:
  - A board without a battery wakes up years ago, and then no signature of an archive and no certificate holds.
  - Nothing is done where the clock is near, or follows a time server; the rest is chrony's.
options:
  now: {description: The time of the technician's computer in seconds since 1970., type: float, required: true}
  tolerance_s:
    description: So far off a clock may be. More than a link may be silent, because C(now) is older then.
    type: float
    default: 300
author: ATLANTIS pilot team
"""

EXAMPLES = r"""
- name: Set a clock that is far off
  atlantis.netcfg.clock:
    now: "{{ now().timestamp() }}"
"""

RETURN = r"""
changes:
  description: By how much the clock was off.
  type: list
  elements: str
  returned: always
notes:
  description: Where the clock follows a time server, by how much the technician's computer differs from it.
  type: list
  elements: str
  returned: success
"""

from ansible.module_utils.basic import AnsibleModule

from ..module_utils.clock import TOLERANCE_S, Clock
from ..module_utils.refused import Refused

ARGUMENTS = {"now": {"type": "float", "required": True}, "tolerance_s": {"type": "float", "default": TOLERANCE_S}}


def main() -> None:
    """Run the module."""
    module = AnsibleModule(ARGUMENTS, supports_check_mode=True)
    clock = Clock(check=module.check_mode)
    try:
        clock.converge(module.params["now"], module.params["tolerance_s"])
    except Refused as refused:
        module.fail_json(msg=refused.message, hint=refused.hint, changes=[])
    module.exit_json(changed=bool(clock.changes), changes=clock.changes, notes=clock.notes)


if __name__ == "__main__":
    main()
