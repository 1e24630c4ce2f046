"""Module `atlantis.netcfg.connection_test`: the report's last step of setting up a gateway (4.6.2)."""

# ruff: noqa: E402, TID252 - a module begins with its documentation, and Ansible ships what is imported relatively

from __future__ import annotations

DOCUMENTATION = r"""
module: connection_test
short_description: Start the example robot once per build, and tell what can be seen of it from the gateway
description:
  - Starts the program with its configuration for a while. It fails where the program ends with an error.
  - Otherwise the verdict is C(INCONCLUSIVE). The step is done when TEST_ROBOT is connected at the SCC, which nothing on
    the gateway can tell. A person at the SCC confirms it.
  - It is done once for each build, configuration and environment, and not as long as the VPN has no address.
options:
  program: {description: From the root., type: str, required: true}
  config: {description: From the root., type: str, required: true}
  sourced: {description: The file that a shell sources first., type: str, required: true}
  environment: {description: "A file of variables, as C(EnvironmentFile=) has it.", type: str, required: true}
  built: {description: The marker of the build in use., type: str, required: true}
  user: {description: The account that it runs under., type: str, required: true}
  interface: {description: The VPN's., type: str, required: true}
  seconds: {description: How long it runs., type: int, required: true}
author: ATLANTIS pilot team
"""

EXAMPLES = r"""
- name: Start the example robot
  atlantis.netcfg.connection_test:
    program: /opt/atlantis/interop/current/examples/build/example-robot
    config: /opt/atlantis/interop/current/examples/config/robot-config.yml
    sourced: /usr/local/lib/atlantis/interop.sh
    environment: /etc/atlantis/ros.env
    built: /opt/atlantis/interop/current/build.json
    user: atlantis-interop
    interface: tun0
    seconds: 15
"""

RETURN = r"""
verdict:
  description: C(INCONCLUSIVE), or C(SKIP) where it was not started.
  type: str
  returned: on success
notes:
  description: The same in words, where there is something to know.
  type: list
  elements: str
  returned: on success
hint:
  description: What to do about a failure.
  type: str
  returned: on failure
"""

from typing import Any

from ansible.module_utils.basic import AnsibleModule

from ..module_utils.refused import Refused
from ..module_utils.tree import Tree
from ..module_utils.trial import SmokeTest

_TEXT = {"type": "str", "required": True}
_NAMES = ("program", "config", "sourced", "environment", "built", "user", "interface")
ARGUMENTS: dict[str, Any] = {**dict.fromkeys(_NAMES, _TEXT), "seconds": {"type": "int", "required": True}}


def main() -> None:
    """Run the module."""
    module = AnsibleModule(ARGUMENTS, supports_check_mode=True)
    try:
        result = SmokeTest(**module.params).judge(Tree(), check=module.check_mode)
    except Refused as refused:
        module.fail_json(msg=refused.message, hint=refused.hint)
    notes = [result.words] if result.worth else []
    module.exit_json(changed=False, changes=[], verdict=result.verdict, msg=result.words, notes=notes)


if __name__ == "__main__":
    main()
