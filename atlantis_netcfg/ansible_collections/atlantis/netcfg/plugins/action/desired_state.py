"""Action `atlantis.netcfg.desired_state`: what the gateways of a play should hold, for the role that asks.

It runs once for the whole play and contacts nothing; `per_host` of its result holds one entry a gateway, final data
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
    """From a role to `atlantis_netcfg.operations.computers`; argument `part` names the role."""

    _VALID_ARGS = frozenset({"request", "part"})

    @staticmethod
    def perform(task: TaskRequest) -> Mapping[str, Any]:
        """Look it up in the declaration; refuse what this run may not do."""
        from atlantis_netcfg.operations.computers.desired_state import perform  # noqa: PLC0415 - Ansible imports every action plugin

        return perform(task.inventory, task.hosts, task.request, task.part, plan_only=task.plan_only)
