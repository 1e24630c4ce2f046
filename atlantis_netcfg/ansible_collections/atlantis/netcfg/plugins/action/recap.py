"""Action `atlantis.netcfg.recap`: one device's own result, for Ansible's host counters and for `--diff`.

`atlantis.netcfg.apply` runs once for the whole play, so Ansible would count its result for the first host only.
"""

from __future__ import annotations

from typing import Any

from ansible.plugins.action import ActionBase


class ActionModule(ActionBase):  # type: ignore[misc]  # ansible-core ships no type information
    """Repeats the result of `apply` for the host of this task; contacts no device."""

    TRANSFERS_FILES = False
    _requires_connection = False
    _supports_check_mode = True
    _supports_async = False
    _VALID_ARGS = frozenset({"result"})

    def run(self, tmp: Any = None, task_vars: dict[str, Any] | None = None) -> dict[str, Any]:  # noqa: ANN401
        """Return the message, the diff, and whether this device changed or failed."""
        values: dict[str, Any] = super().run(tmp, task_vars)
        device = self._task.args["result"]
        values.update(changed=device["changed"], failed=not device["ok"], msg=device["message"])
        if device["shown"]:
            values["diff"] = {"prepared": device["shown"]}
        return values
