"""Action `atlantis.netcfg.lte`: the 4G units of a play that are no RouterOS devices, in one process.

It runs once for the whole play; `per_host` of its result holds one entry for each unit that it handles. `changed` and
`failed` are left to the action `recap`.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from ansible.errors import AnsibleActionFail
from ansible.parsing.vault import VaultLib, VaultSecretsContext
from ansible.plugins.action import ActionBase

from atlantis_netcfg.errors import NetcfgError


def _decrypt(text: str) -> str:
    secrets = VaultSecretsContext.current().secrets
    return str(VaultLib(secrets).decrypt(text.encode()).decode())


class ActionModule(ActionBase):  # type: ignore[misc]  # ansible-core ships no type information
    """Door from a play to `atlantis_netcfg.operations.lte`."""

    BYPASS_HOST_LOOP = True
    TRANSFERS_FILES = False
    _requires_connection = False
    _supports_check_mode = True
    _supports_async = False
    _VALID_ARGS = frozenset({"request"})

    def run(self, tmp: Any = None, task_vars: dict[str, Any] | None = None) -> dict[str, Any]:  # noqa: ANN401
        """Converge or check the units of the play; in check mode, only plan."""
        from atlantis_netcfg.operations.lte import perform  # noqa: PLC0415 - Ansible imports every action plugin
        from atlantis_netcfg.operations.request import consent  # noqa: PLC0415 - as above

        result: dict[str, Any] = super().run(tmp, task_vars)
        variables = task_vars or {}
        given = Path(str(variables.get("inventory_dir") or "."))
        beside = Path(str(variables["playbook_dir"])).parent / "inventory"
        try:
            outcome = perform(
                given if (given / "group_vars").is_dir() else beside,
                tuple(variables["ansible_play_hosts"]),
                {**(self._task.args.get("request") or {}), **consent(variables)},
                plan_only=bool(self._task.check_mode),
                decrypt=_decrypt,
            )
        except NetcfgError as error:
            hint = f"\n{error.hint}" if error.hint else ""
            raise AnsibleActionFail(f"{error}{hint}") from error
        result.update(outcome)
        return result
