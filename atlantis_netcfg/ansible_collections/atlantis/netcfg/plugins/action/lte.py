"""Action `atlantis.netcfg.lte`: handles the play's 4G units that are not RouterOS devices, in one process.

It runs once for the whole play; `per_host` of its result holds one entry for each unit that it handles. `changed` and
`failed` are left to the action `recap`.
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
    """Ansible action that passes the play to `atlantis_netcfg.operations.lte`."""

    @staticmethod
    def perform(task: TaskRequest) -> Mapping[str, Any]:
        """Converge or check the units of the play; in check mode, only plan."""
        from atlantis_netcfg.core.printable import clean  # noqa: PLC0415 - as above
        from atlantis_netcfg.operations.lte.run import perform  # noqa: PLC0415 - Ansible imports every action plugin

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
