"""Action `atlantis.netcfg.apply`: all network devices of the play in one process, one task for the whole play.

It runs once for the whole play (`BYPASS_HOST_LOOP`), because a device's session, its safe mode and its verification
must live in one process. `per_host` of its result holds one entry a device. `changed` and `failed` are left to the
action `recap`, which runs on each host, so that one dead device does not stop the play for the others.
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
    """Ansible action that passes the play to `atlantis_netcfg.operations`."""

    @staticmethod
    def perform(task: TaskRequest) -> Mapping[str, Any]:
        """Converge the hosts of the play; in check mode, only plan."""
        from atlantis_netcfg.core.printable import clean  # noqa: PLC0415 - as above
        from atlantis_netcfg.operations.apply import perform  # noqa: PLC0415 - Ansible imports every action plugin

        values: dict[str, Any] = clean(
            perform(
                task.inventory,
                task.hosts,
                task.request,
                plan_only=task.plan_only,
                decrypt=task.decrypt,
            )
        )
        return values
