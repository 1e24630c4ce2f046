"""Action `atlantis.netcfg.wait_for_connection`: Ansible's own action; its messages are cleaned of control codes."""

from __future__ import annotations

from ansible.plugins.action.wait_for_connection import ActionModule as Stock

from atlantis_netcfg.ansible_collections.atlantis.netcfg.plugins.plugin_utils.zipapp_action import CleanedAction


class ActionModule(CleanedAction, Stock):  # type: ignore[misc]  # ansible-core ships no type information
    """Waits until a computer responds."""
