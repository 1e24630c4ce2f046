"""Action `atlantis.netcfg.wait_for_connection`: Ansible's own, with words that no terminal obeys."""

from __future__ import annotations

from ansible.plugins.action.wait_for_connection import ActionModule as Stock

from atlantis_netcfg.ansible_collections.atlantis.netcfg.plugins.plugin_utils.zipapp_action import CleanedAction


class ActionModule(CleanedAction, Stock):  # type: ignore[misc]  # ansible-core ships no type information
    """Wait until a computer answers."""
