"""Base of the actions that handle a whole play in one process, from Ansible to our `operations`."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ansible.errors import AnsibleActionFail
from ansible.parsing.vault import VaultLib, VaultSecretsContext
from ansible.plugins.action import ActionBase

from atlantis_netcfg.core import stored_messages
from atlantis_netcfg.core.errors import REHEARSE, NetcfgError
from atlantis_netcfg.core.processes.worker import end_if_orphaned, end_with_parent

if TYPE_CHECKING:
    from collections.abc import Mapping


@dataclass(frozen=True, slots=True)
class TaskRequest:
    """Request of a task for all hosts of its play."""

    inventory: Path
    hosts: tuple[str, ...]
    request: dict[str, Any]
    plan_only: bool
    """Check mode."""
    part: str = ""
    """Part of the desired state that the task requests, named after its role; empty: none."""

    @staticmethod
    def decrypt(text: str) -> str:
        """Decrypt an ansible-vault text with the secrets of this run."""
        secrets = VaultSecretsContext.current().secrets
        return str(VaultLib(secrets).decrypt(text.encode()).decode())


class EngineAction(ActionBase):  # type: ignore[misc]  # ansible-core ships no type information
    """An action that runs once for the whole play; its only argument is `request`, unless a subclass has others."""

    BYPASS_HOST_LOOP = True
    TRANSFERS_FILES = False
    _requires_connection = False
    _supports_check_mode = True
    _supports_async = False
    _VALID_ARGS = frozenset({"request"})

    @staticmethod
    @abstractmethod
    def perform(task: TaskRequest) -> Mapping[str, Any]:
        """Run the action; return one Ansible result per host in `per_host`. Raises NetcfgError."""

    def run(self, tmp: Any = None, task_vars: dict[str, Any] | None = None) -> dict[str, Any]:  # noqa: ANN401
        """Run the request; report a NetcfgError with its message and hint."""
        from atlantis_netcfg.core.printable import lines  # noqa: PLC0415 - as above
        from atlantis_netcfg.operations.common import request  # noqa: PLC0415 - Ansible imports every action plugin

        end_with_parent()
        result: dict[str, Any] = super().run(tmp, task_vars)
        variables = task_vars or {}
        try:
            task = TaskRequest(
                inventory_of(variables),
                tuple(variables["ansible_play_hosts"]),
                request.of_variables({**variables, "atlantis_request": self._task.args.get("request")}),
                bool(self._task.check_mode),
                str(self._task.args.get("part") or ""),
            )
            result.update(stored_messages.pack(self.perform(task)))
        except NetcfgError as error:
            hint = (
                f"\n{error.hint}".replace(REHEARSE, f"add `-e {request.REHEARSE_VARIABLE}=true`") if error.hint else ""
            )
            raise AnsibleActionFail(lines(f"{error}{hint}")) from None  # Ansible would tell the cause again
        finally:
            end_if_orphaned()
        return result


def inventory_of(variables: Mapping[str, Any]) -> Path:
    """Return the folder of the inventory: the one given, or the one beside the playbooks.

    AWX passes the hosts to a job in a separate file; their configuration is in the project.
    """
    inventory_folder = Path(str(variables.get("inventory_dir") or "."))
    return (
        inventory_folder
        if (inventory_folder / "group_vars").is_dir()
        else Path(str(variables["playbook_dir"])).parent / "inventory"
    )
