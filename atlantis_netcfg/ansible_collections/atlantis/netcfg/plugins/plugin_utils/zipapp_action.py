"""Local side of our remote modules: one round trip and a few kB per call, instead of 170 kB.

The arguments are validated here, by the module's own argument spec. The gateway gets them over standard input, and runs
the module from its installed zipapp. Only if the zipapp is missing or damaged is it sent, in one command that also runs
the module. Nothing else is created on the gateway: no session folder and no file with parameters.

Each call is one command on the persistent SSH connection: 3 round trips, to open its channel, to run it, and for its
standard input, since OpenSSH's server accepts none before it has started the command (seen with 9.2; sudo adds no
further round trip). On the command line the arguments would save the third, but other users of the gateway would see
them, and sudo would log them. Sending the zipapp adds one such command.
"""

from __future__ import annotations

import json
import shlex
import zlib
from importlib import import_module
from typing import TYPE_CHECKING, Any, ClassVar, Final

from ansible import constants
from ansible.errors import AnsibleConnectionFailure
from ansible.module_utils.common.arg_spec import ArgumentSpecValidator
from ansible.module_utils.common.parameters import remove_values
from ansible.module_utils.errors import UnsupportedError
from ansible.plugins.action import ActionBase

from atlantis_netcfg.ansible_collections.atlantis.netcfg.plugins.plugin_utils import prefetch
from atlantis_netcfg.ansible_collections.atlantis.netcfg.plugins.plugin_utils.board.basic import MARK
from atlantis_netcfg.core import printable, remote_messages
from atlantis_netcfg.core.messages import arg, msg
from atlantis_netcfg.core.processes.remote_bundle import INSTALL, build
from atlantis_netcfg.core.processes.worker import end_with_parent
from atlantis_netcfg.core.stored_messages import pack

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

FOLDER: Final = "/var/lib/atlantis/tool"
"""Folder of the tool on gateways, where it is stored under its SHA-256."""
PYTHON: Final = (3, 8)
"""Oldest Python version that the tool supports (Ubuntu 20.04)."""
MODULES: Final = "atlantis_netcfg.ansible_collections.atlantis.netcfg.plugins.modules"
_ASKS: Final = "ATLANTIS-PYTHON "
_VERSION: Final = f'import sys; print("\\n{_ASKS}%d %d" % sys.version_info[:2])'
_NOT_FOUND: Final = 127
"""Exit code of a shell if a program is not found (POSIX, Shell & Utilities 2.8.2)."""
_LAST_LINES: Final = 8
_ANSIBLES: Final = ("_ansible_", "ansible_", "warnings", "deprecations", "exception")
"""Result keys that no module of this collection sets, and that Ansible would act on or print as its own."""


class ZipappAction(ActionBase):  # type: ignore[misc]  # ansible-core ships no type information
    """An action that runs one of our modules, named by the subclass."""

    module: ClassVar[str]
    TRANSFERS_FILES = False
    _supports_check_mode = True
    _supports_async = False

    def run(self, tmp: Any = None, task_vars: dict[str, Any] | None = None) -> dict[str, Any]:  # noqa: ANN401
        """Run the module with the arguments of the task."""
        result: dict[str, Any] = super().run(tmp, task_vars)
        result.update(self.run_module(self.module, self._task.args, task_vars or {}))
        return result

    def run_module(self, name: str, arguments: Mapping[str, Any], variables: dict[str, Any]) -> dict[str, Any]:
        """Run a module on the host of the task and return its result; an unreachable host raises as in Ansible."""
        end_with_parent()
        parameters, secrets, wrong = validate_arguments(name, arguments)
        if wrong is not None:
            return mask_secrets({"failed": True, "msg": wrong}, secrets)
        request = self.request(name, parameters, variables)
        if (early_answer := prefetch.find_answer(variables, request)) is not None:
            return early_answer
        values = clean_result(self.call(name, request, variables), secrets)
        return values | prefetch.discard(variables)

    def request(self, name: str, parameters: Mapping[str, Any], variables: dict[str, Any]) -> dict[str, Any]:
        """Build the request that the gateway gets over standard input."""
        quiet = self._task.no_log or constants.config.get_config_value("DEFAULT_NO_TARGET_SYSLOG", variables=variables)
        return {"name": name, "params": parameters, "check": bool(self._task.check_mode), "log": not quiet}

    def call(self, name: str, request: object, variables: dict[str, Any]) -> dict[str, Any]:
        """Send a request and return the response unchanged."""
        try:
            data = zlib.compress(json.dumps(request, default=str).encode(), 9)
            return answer(self._run_tool(name, data, variables), name)
        except AnsibleConnectionFailure as error:
            raise _printable_error(error) from None

    def _run_tool(self, name: str, data: bytes, variables: dict[str, Any]) -> dict[str, Any]:
        tool, python = build(), self._python(variables)
        path = f"{FOLDER}/{tool.sha256}.pyz"
        sound = f"echo '{tool.sha256}  {path}' | sha256sum -c --status 2>/dev/null"
        # Whoever sends all of it before the far end has read it would be told of a broken connection.
        look = (
            f"if {sound}; then {python} -I {path} {name}; else cat >/dev/null; {python} -c {shlex.quote(_VERSION)}; fi"
        )
        values: dict[str, Any] = self._low_level_execute_command(look, in_data=data)
        version = next((line for line in values["stdout"].split("\n") if line.startswith(_ASKS)), None)
        if version is None:
            return values
        python_version = tuple(int(number) for number in version.split()[1:])
        if python_version < PYTHON:
            return {**values, "python": python_version}
        program, packed_tool = INSTALL.read_bytes(), tool.payload
        words = (FOLDER, tool.sha256, str(len(packed_tool)), MARK, name)
        read = f"import sys; exec(sys.stdin.buffer.read({len(program)}))"
        install = f"{python} -I -c {shlex.quote(read)} {shlex.join(words)}"
        reply: dict[str, Any] = self._low_level_execute_command(install, in_data=program + packed_tool + data)
        return reply

    def _python(self, variables: dict[str, Any]) -> str:
        """Return the Python command for the shell, with the task's environment; Python is never searched for."""
        delegate = self._task.delegate_to
        of = variables["ansible_delegated_vars"][delegate] if delegate else variables
        text = str(self._templar.template(constants.config.get_config_value("INTERPRETER_PYTHON", variables=of)))
        words = ["/usr/bin/python3"] if text.startswith("auto") else shlex.split(text)
        return f"{self._compute_environment_string()} {shlex.join(words)}".strip()


class CleanedAction(ActionBase):  # type: ignore[misc]  # as above
    """An action of Ansible's own whose output is cleaned of terminal control codes."""

    def run(self, tmp: Any = None, task_vars: dict[str, Any] | None = None) -> dict[str, Any]:  # noqa: ANN401
        """Run Ansible's action with cleaned output; an unreachable host raises as in Ansible."""
        try:
            result: dict[str, Any] = printable.clean(super().run(tmp, task_vars))
        except AnsibleConnectionFailure as error:
            raise _printable_error(error) from None
        return result


def _printable_error(error: AnsibleConnectionFailure) -> AnsibleConnectionFailure:
    """Clean a connection error, which quotes the remote host's output, of control codes, and drop its cause."""
    return AnsibleConnectionFailure(printable.lines(str(error).replace("\r\n", "\n")))


def validate_arguments(name: str, arguments: Mapping[str, Any]) -> tuple[dict[str, Any], set[str], str | None]:
    """Validate arguments against a module's spec: return complete parameters, secret values, and the error if any."""
    module = import_module(f"{MODULES}.{name}")
    validator = ArgumentSpecValidator(module.ARGUMENTS, **getattr(module, "RULES", {}))
    validation = validator.validate(dict(arguments))
    wrong = None
    if validation.error_messages:
        wrong = str(validation.errors.msg)
        if isinstance(validation.errors[0], UnsupportedError):
            wrong = f"Unsupported parameters for (atlantis.netcfg.{name}) module: {wrong}"
    return validation.validated_parameters, validation._no_log_values, wrong  # noqa: SLF001 - Ansible's own modules mask by it


def answer(values: Mapping[str, Any], name: str) -> dict[str, Any]:
    """Extract the result from a gateway's output; without one the module was interrupted: report its last output."""
    lines = str(values["stdout"]).split("\n")
    result = next((line.removeprefix(MARK) for line in reversed(lines) if line.startswith(MARK)), None)
    if result is not None:
        try:
            reply = json.loads(result)
        except ValueError:
            reply = None
        if isinstance(reply, dict):
            return without_ansible(reply)
    if "python" in values:
        is_there, required_version = (".".join(map(str, version)) for version in (values["python"], PYTHON))
        words = msg(f"this computer has Python {arg(is_there)}, and at least {arg(required_version)} is needed")
        return pack({"failed": True, "msg": words, "hint": "that comes with Ubuntu 20.04 and Debian 11"})
    if values["rc"] == _NOT_FOUND:
        last = _last_lines(str(values["stderr"]).split("\n"))
        words = msg(f"this computer has no Python where it is looked for: {arg(last)}")
        hint = "`apt-get install python3` on it; `ansible_python_interpreter` tells where it is otherwise"
        return pack({"failed": True, "msg": words, "hint": hint})
    last = _last_lines([*lines, *str(values["stderr"]).split("\n")])
    words = msg(
        f"{arg(name)} was cut off on this computer (exit {arg(values['rc'])})"
        + (f":\n{arg(last)}" if last else " without output")
    )
    return pack({"failed": True, "msg": words, "hint": "type the same again: it goes on from whatever was left"})


def without_ansible(result: Mapping[str, Any]) -> dict[str, Any]:
    """Remove the keys that Ansible would act on."""
    return {key: value for key, value in result.items() if not key.startswith(_ANSIBLES)}


def mask_secrets(result: Mapping[str, Any], secrets: Iterable[str]) -> dict[str, Any]:
    """Mask secrets as Ansible's own modules do; true, false and null are kept."""
    plain: dict[str, Any] = remove_values(dict(result), secrets)
    return plain | {key: value for key, value in result.items() if value is None or isinstance(value, bool)}


def clean_result(result: Mapping[str, Any], secrets: Iterable[str]) -> dict[str, Any]:
    """Mask secrets and escape control characters, also in the marked texts of messages."""
    values: dict[str, Any] = printable.clean(mask_secrets({**result, "texts": None}, secrets))
    del values["texts"]
    return values | remote_messages.checked_texts(result, lambda text: str(remove_values(text, secrets)))


def _last_lines(lines: list[str]) -> str:
    return "\n".join([line.rstrip() for line in lines if line.strip()][-_LAST_LINES:])
