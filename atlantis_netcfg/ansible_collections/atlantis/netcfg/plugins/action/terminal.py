"""Action `atlantis.netcfg.terminal`: compares the play's satellite terminals in the inventory with the evidence.

It runs once for the whole play and contacts no device; `per_host` of its result holds one entry per terminal.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from atlantis_netcfg.ansible_collections.atlantis.netcfg.plugins.plugin_utils.engine_action import (
    EngineAction,
    TaskRequest,
)

if TYPE_CHECKING:
    from collections.abc import Mapping


class ActionModule(EngineAction):
    """Ansible action that passes the play to `atlantis_netcfg.operations.common.terminals`."""

    @staticmethod
    def perform(task: TaskRequest) -> Mapping[str, Any]:
        """Judge the terminals of the play; in check mode, record nothing."""
        from atlantis_netcfg.operations.common.terminals import perform  # noqa: PLC0415 - Ansible imports every action plugin

        return perform(task.inventory, task.hosts, task.request, plan_only=task.plan_only)
