"""Action `atlantis.netcfg.desired_state`: the desired state of a play's gateways, for the calling role.

It runs once for the whole play and contacts no device; `per_host` of its result holds one entry per gateway: final data
without templates and without secrets.
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
    """Ansible action that calls `atlantis_netcfg.operations.computers`; its argument `part` names the role."""

    _VALID_ARGS = frozenset({"request", "part"})

    @staticmethod
    def perform(task: TaskRequest) -> Mapping[str, Any]:
        """Compute the desired state from the inventory; raise an error for what this run may not do."""
        from atlantis_netcfg.operations.computers.desired_state import perform  # noqa: PLC0415 - Ansible imports every action plugin

        return perform(task.inventory, task.hosts, task.request, task.part, plan_only=task.plan_only)
