"""Module `atlantis.netcfg.network`: change the configuration of an interface, with a timer that rolls it back."""

# ruff: noqa: E402, TID252 - a module begins with its documentation, and Ansible ships what is imported relatively

from __future__ import annotations

DOCUMENTATION = r"""
module: network
short_description: Change the network of a computer under a timer that takes the change back
description:
  - C(stage) writes nothing if the configuration is there and in effect. Otherwise it has the tool check the new one,
    saves the previous one, arms a timer and a unit for the next start that both bring it back, and only then has
    systemd apply the new one, two seconds after this module has ended.
  - C(confirm) belongs to a connection that was made after that. It keeps the change if address, default route and
    gateway are as declared. What nobody confirms within C(rollback_s) is taken back by the computer itself.
  - C(look) waits for the end of a change, and fails unless it was confirmed.
  - Other files that configure the same interface are refused, unless C(replaces) lets them go.
options:
  action: {description: See above., type: str, required: true, choices: [stage, confirm, look]}
  name: {description: The change that C(stage) has named., type: str}
  by: {description: The tool., type: str, required: true, choices: [netplan, ifupdown, networkd]}
  interface: {description: As C(ip link) shows it., type: str, required: true}
  address: {description: With its prefix length; with DHCP the one that is reserved., type: str, required: true}
  gateway: {description: Of the default route., type: str, required: true}
  path: {description: The file of the tool that is ours., type: str, required: true}
  content: {description: Its text., type: str, required: true}
  mode: {description: Its mode, four octal digits in quotes., type: str, default: "0644"}
  resolver:
    description: Text of C(/etc/resolv.conf), where nothing on the computer writes that file by itself.
    type: str
  replaces: {description: Files that go with the change., type: list, elements: str, default: []}
  rollback_s: {description: Seconds that a change waits for its confirmation., type: int, default: 180}
author: ATLANTIS pilot team
"""

EXAMPLES = r"""
- name: Stage what differs
  atlantis.netcfg.network:
    action: stage
    by: networkd
    interface: eth0
    address: 192.0.2.10/24
    gateway: 192.0.2.1
    path: /etc/systemd/network/05-atlantis.network
    content: "{{ eth0_network }}"
  register: change
"""

RETURN = r"""
changes:
  description: One line for each change.
  type: list
  elements: str
  returned: always
  sample: [file /etc/systemd/network/05-atlantis.network]
name:
  description: Of the staged change; null if there is nothing to change.
  type: str
  returned: with stage
state:
  description: pending, confirmed, rolled back or unknown.
  type: str
  returned: with confirm and look
rolled_back:
  description: Whether everything is as before.
  type: bool
  returned: when look fails
why:
  description: What is behind that state.
  type: str
  returned: with confirm and look
again:
  description: This connection is older than the change; confirm once more over a new one.
  type: bool
  returned: with confirm
hint:
  description: What to do about a failure.
  type: str
  returned: on failure
"""

from typing import Any

from ansible.module_utils.basic import AnsibleModule

from atlantis_netcfg.core.messages import arg, msg

from ..module_utils.errors import ModuleError
from ..module_utils.network_change import BACK, NetworkChange
from ..module_utils.network_desired import DesiredNetwork
from ..module_utils.network_files import NetworkComputer

_TEXT = {"type": "str", "required": True}
ARGUMENTS = {
    "action": {**_TEXT, "choices": ["stage", "confirm", "look"]},
    "name": {"type": "str"},
    "by": {**_TEXT, "choices": ["netplan", "ifupdown", "networkd"]},
    "interface": _TEXT,
    "address": _TEXT,
    "gateway": _TEXT,
    "path": _TEXT,
    "content": _TEXT,
    "mode": {"type": "str", "default": "0644"},
    "resolver": {"type": "str"},
    "replaces": {"type": "list", "elements": "str", "default": []},
    "rollback_s": {"type": "int", "default": 180},
}
RULES = {"required_if": [("action", "confirm", ["name"]), ("action", "look", ["name"])]}
_BACK_S = 60.0
"""Seconds beyond the rollback window that rolling back a change may take."""
_AGAIN = "correct `network` of the host or `lan` of its site, then run the same command again"
_UNKNOWN = (
    f"`systemctl status {BACK}` there shows more; switching the computer's power off and on restores the "
    "previous network"
)


def _result(parameters: dict[str, Any], *, check: bool) -> dict[str, Any]:
    request = DesiredNetwork.of(parameters)
    change = NetworkChange(NetworkComputer(), request)
    values: dict[str, Any] = {}
    if parameters["action"] == "stage":
        values["name"] = change.stage(check=check)
    elif parameters["action"] == "confirm":
        values = change.confirm(parameters["name"])
    else:
        values = _describe_outcome(change.look(parameters["name"], request.rollback_s + _BACK_S))
    return {"changed": bool(change.changes), "changes": change.changes, "diff": change.diff, **values}


def _describe_outcome(values: dict[str, Any]) -> dict[str, Any]:
    """Describe the outcome of a change; `msg` is set if it was not confirmed."""
    if values["state"] == "confirmed":
        return values
    if values["state"] == "rolled back":
        text = msg(f"the network change was rolled back, and everything is as before: {arg(values['why'])}")
        return {**values, "rolled_back": True, "msg": text, "hint": _AGAIN}
    text = msg(f"outcome of the network change unknown: {arg(values['why'])}")
    return {**values, "rolled_back": False, "msg": text, "hint": _UNKNOWN}


def main() -> None:
    """Run the module."""
    module = AnsibleModule(ARGUMENTS, **RULES, supports_check_mode=True)
    try:
        result = _result(module.params, check=module.check_mode)
    except ModuleError as refused:
        module.fail_json(msg=refused.message, hint=refused.hint)
    if "msg" in result:
        module.fail_json(**result)
    module.exit_json(**result)


if __name__ == "__main__":
    main()
