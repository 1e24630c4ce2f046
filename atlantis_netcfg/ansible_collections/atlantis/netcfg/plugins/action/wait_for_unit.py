"""Action `atlantis.netcfg.wait_for_unit`: wait for at most one minute until a systemd unit is no longer active.

It runs one shell command: two round trips and a hundred bytes, where a module would send some kB. `rc` of its result is
0 once the unit has ended.
"""

from __future__ import annotations

import shlex
from typing import Any

from ansible.plugins.action import ActionBase

from atlantis_netcfg.ansible_collections.atlantis.netcfg.plugins.plugin_utils.zipapp_action import CleanedAction

_WAIT = 'while systemctl --quiet is-active "$0"; do sleep 1; done'


class _Wait(ActionBase):  # type: ignore[misc]  # ansible-core ships no type information
    TRANSFERS_FILES = False

    def run(self, tmp: Any = None, task_vars: dict[str, Any] | None = None) -> dict[str, Any]:  # noqa: ANN401
        """Wait for the unit that the argument `unit` names."""
        result: dict[str, Any] = super().run(tmp, task_vars)
        words = ("timeout", "60", "sh", "-c", _WAIT, self._task.args["unit"])
        return {**result, **self._low_level_execute_command(shlex.join(words))}


class ActionModule(CleanedAction, _Wait):
    """Waits for a systemd unit to end; its messages are cleaned of control codes."""
