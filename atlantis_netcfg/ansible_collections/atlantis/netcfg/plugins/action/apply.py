"""Action `atlantis.netcfg.apply`: all network devices of the play in one process, one task for the whole play.

It runs once for the whole play (`BYPASS_HOST_LOOP`), because a device's session, its safe mode and its verification
must live in one process. `per_host` of its result holds one entry a device. `changed` and `failed` are left to the
action `recap`, which runs on each host, so that one dead device does not stop the play for the others.
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


def _inventory(variables: dict[str, Any]) -> Path:
    """The folder of the declaration: the inventory that was given, or the one beside the playbooks.

    AWX hands the hosts to a job in a file of its own; what they are to be stands in the project.
    """
    given = Path(str(variables.get("inventory_dir") or "."))
    return given if (given / "group_vars").is_dir() else Path(str(variables["playbook_dir"])).parent / "inventory"


class ActionModule(ActionBase):  # type: ignore[misc]  # ansible-core ships no type information
    """Door from a play to `atlantis_netcfg.operations`."""

    BYPASS_HOST_LOOP = True
    TRANSFERS_FILES = False
    _requires_connection = False
    _supports_check_mode = True
    _supports_async = False
    _VALID_ARGS = frozenset({"request"})

    def run(self, tmp: Any = None, task_vars: dict[str, Any] | None = None) -> dict[str, Any]:  # noqa: ANN401
        """Converge the hosts of the play; in check mode, only plan."""
        from atlantis_netcfg.operations.request import consent  # noqa: PLC0415 - Ansible imports every action plugin
        from atlantis_netcfg.operations.site import perform  # noqa: PLC0415 - Ansible imports every action plugin

        result: dict[str, Any] = super().run(tmp, task_vars)
        variables = task_vars or {}
        try:
            outcome = perform(
                _inventory(variables),
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
