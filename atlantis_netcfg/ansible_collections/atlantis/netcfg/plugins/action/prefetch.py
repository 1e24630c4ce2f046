"""Action `atlantis.netcfg.prefetch`: runs the module calls of several roles' tasks in one request.

It reads the tasks of the roles and computes the arguments of our modules as Ansible will. The gateway runs the modules
in order until one of them has something to change. Each task then takes its prefetched result, or calls the gateway
itself (`plugin_utils/prefetch`). A call whose arguments cannot be computed is left to its task, as without a prefetch.

Arguments: `roles`, in their order, and `request`. Register the result as `computer_prefetch`.
"""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from ansible import constants
from ansible.errors import AnsibleError, AnsibleUndefinedVariable
from ansible.plugins.action import ActionBase

from atlantis_netcfg.ansible_collections.atlantis.netcfg.plugins.action.desired_state import (
    ActionModule as DesiredState,
)
from atlantis_netcfg.ansible_collections.atlantis.netcfg.plugins.plugin_utils import prefetch, zipapp_action
from atlantis_netcfg.ansible_collections.atlantis.netcfg.plugins.plugin_utils.engine_action import (
    TaskRequest,
    inventory_of,
)
from atlantis_netcfg.core import printable
from atlantis_netcfg.core.errors import NetcfgError
from atlantis_netcfg.core.messages import arg, msg
from atlantis_netcfg.core.processes.worker import end_with_parent

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

_COLLECTION: Final = "atlantis.netcfg."


class ActionModule(zipapp_action.ZipappAction):
    """Prefetches the module results of one host."""

    _VALID_ARGS = frozenset({"roles", "request"})

    def run(self, tmp: Any = None, task_vars: dict[str, Any] | None = None) -> dict[str, Any]:  # noqa: ANN401
        """Request the modules of the roles; if this is refused, leave the error to the task that would get it."""
        result: dict[str, Any] = ActionBase.run(self, tmp, task_vars)
        end_with_parent()
        variables = task_vars or {}
        requests, secrets = [], []
        try:
            for name, arguments in self._calls(variables):
                parameters, secret, wrong = zipapp_action.validate_arguments(name, arguments)
                if wrong is not None:
                    break
                requests.append(self.request(name, parameters, variables))
                secrets.append(secret)
        except (AnsibleError, NetcfgError, OSError) as error:
            self._display.vvv(printable.lines(msg(f"prefetch stopped: {arg(error)}")))
        answers = self.call("batch", requests, variables).get("answers", []) if requests else []
        clean_answers = [
            zipapp_action.clean_result(zipapp_action.without_ansible(answer), secret)
            for answer, secret in zip(answers, secrets, strict=False)
        ]
        return {**result, "changed": False, **prefetch.pack(requests, clean_answers)}

    def _calls(self, variables: dict[str, Any]) -> Iterator[tuple[str, dict[str, Any]]]:
        """Yield module and arguments of each task, in order. Raises AnsibleError, NetcfgError, OSError."""
        folders = [Path(folder) for folder in constants.config.get_config_value("DEFAULT_ROLES_PATH")]
        host_vars = dict(variables)
        for role in self._task.args["roles"]:
            paths = [folder / role / "tasks" / "main.yml" for folder in folders]
            for path in [path for path in paths if path.exists()][:1]:
                yield from self._file_calls(path, host_vars, {})

    def _file_calls(
        self, path: Path, host_vars: dict[str, Any], scope: dict[str, Any]
    ) -> Iterator[tuple[str, dict[str, Any]]]:
        tasks = self._loader.load_from_file(str(path), trusted_as_template=True)
        return self._block_calls({"block": tasks}, path.parent, host_vars, scope)

    def _block_calls(
        self, block: Mapping[str, Any], folder: Path, host_vars: dict[str, Any], scope: Mapping[str, Any]
    ) -> Iterator[tuple[str, dict[str, Any]]]:
        """Yield the calls of a block; put registered `desired_state` results in `host_vars`; `scope` has the `vars`."""
        defaults = block.get("module_defaults", {})
        for task in block["block"]:
            variables = {**scope, **task.get("vars", {})}
            templar = self._templar.copy_with_new_env(available_variables={**host_vars, **variables})
            if not _applies(task, templar):
                continue
            if "block" in task:
                yield from self._block_calls(task, folder, host_vars, variables)
            elif (file := task.get("ansible.builtin.include_tasks")) is not None:
                yield from self._file_calls(folder / file, host_vars, variables)
            for action in task:
                name = action.removeprefix(_COLLECTION)
                if name != action:
                    values = templar.template({"values": task[action] or {}})["values"]
                    arguments = {**templar.template(defaults.get(action, {})), **values}
                    yield from self._action_calls(name, arguments, task, host_vars)

    def _action_calls(
        self, name: str, arguments: Mapping[str, Any], task: Mapping[str, Any], host_vars: dict[str, Any]
    ) -> Iterator[tuple[str, dict[str, Any]]]:
        from atlantis_netcfg.operations.common.request import of_variables  # noqa: PLC0415 - as above
        from atlantis_netcfg.operations.computers.desired_state import bundle_of  # noqa: PLC0415 - Ansible imports every action plugin

        if name == "desired_state":
            # What it refuses, the task tells.
            request = {**of_variables({**host_vars, "atlantis_request": arguments.get("request")}), "events_fd": None}
            hosts, is_plan = (host_vars["inventory_hostname"],), bool(self._task.check_mode)
            task_request = TaskRequest(inventory_of(host_vars), hosts, request, is_plan, arguments["part"])
            host_vars[task["register"]] = DesiredState.perform(task_request)
        elif name == "bundle_copy":
            # It begins by calling the module `bundle`.
            yield name.removesuffix("_copy"), {"id": bundle_of(Path(arguments["bundle"]))}
        elif find_spec(f"{zipapp_action.MODULES}.{name}") is not None:
            yield name, dict(arguments)


def _applies(task: Mapping[str, Any], templar: Any) -> bool:  # noqa: ANN401 - ansible-core ships no type information
    """Return whether the task would run; False if its condition depends on a result that is not known yet."""
    conditions = task.get("when", [])
    try:
        return all(map(templar.evaluate_conditional, conditions if isinstance(conditions, list) else [conditions]))
    except AnsibleUndefinedVariable:
        return False
