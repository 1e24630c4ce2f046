"""Module `atlantis.netcfg.connection_test`: the report's last step of setting up a gateway (4.6.2).

It starts the partners' example robot for a while, and reports only what can be seen from the gateway.
"""

# ruff: noqa: E402, TID252 - a module begins with its documentation, and Ansible ships what is imported relatively
# ruff: noqa: PTH119, PTH120 - paths are text here

from __future__ import annotations

DOCUMENTATION = r"""
module: connection_test
short_description: Start the example robot once per build, and tell what can be seen of it from the gateway
description:
  - Starts the program with its configuration for a while. It fails where the program ends with an error.
  - Otherwise the verdict is C(INCONCLUSIVE). The step is done when TEST_ROBOT is connected at the SCC, which nothing on
    the gateway can tell. A person at the SCC confirms it.
  - It is done once for each build, configuration and environment, and not as long as the VPN has no address.
options:
  program: {description: From the root., type: str, required: true}
  config: {description: From the root., type: str, required: true}
  sourced: {description: The file that a shell sources first., type: str, required: true}
  environment: {description: "A file of variables, as C(EnvironmentFile=) has it.", type: str, required: true}
  built: {description: The marker of the build in use., type: str, required: true}
  user: {description: The account that it runs under., type: str, required: true}
  interface: {description: The VPN's., type: str, required: true}
  seconds: {description: How long it runs., type: int, required: true}
author: ATLANTIS pilot team
"""

EXAMPLES = r"""
- name: Start the example robot
  atlantis.netcfg.connection_test:
    program: /opt/atlantis/interop/current/examples/build/example-robot
    config: /opt/atlantis/interop/current/examples/config/robot-config.yml
    sourced: /usr/local/lib/atlantis/interop.sh
    environment: /etc/atlantis/ros.env
    built: /opt/atlantis/interop/current/build.json
    user: atlantis-interop
    interface: tun0
    seconds: 15
"""

RETURN = r"""
verdict:
  description: C(INCONCLUSIVE), or C(SKIP) where it was not started.
  type: str
  returned: on success
notes:
  description: The same in words, where there is something to know.
  type: list
  elements: str
  returned: on success
hint:
  description: What to do about a failure.
  type: str
  returned: on failure
"""


import hashlib
import os
from dataclasses import dataclass
from typing import Any, Callable

from ansible.module_utils.basic import AnsibleModule

from atlantis_netcfg.core.messages import arg, msg

from ..module_utils.build_messages import error_lines
from ..module_utils.errors import ModuleError
from ..module_utils.filesystem import FileSystem, Stamps
from ..module_utils.programs import ProgramResult, run

_STAMP = "connection test"
_STILL_RUNS = 124
"""Exit code of timeout(1) if it had to stop the program."""
_COMMAND = '. "$1" && cd "$2" && exec timeout --kill-after=5 "$3" "$4" "$5"'


@dataclass(frozen=True)
class TestVerdict:
    """Result of the test; `worth`: it should be shown to the user."""

    verdict: str
    words: str
    worth: bool


@dataclass(frozen=True)
class SmokeTest:
    """One run of `program` with `config` as `user`, with `environment` and files `sourced`, for `seconds`."""

    program: str
    config: str
    sourced: str
    environment: str
    built: str
    """Marker file of the build in use; another build is tested again."""
    user: str
    interface: str
    """Interface of the VPN; without an address on it no connection is possible."""
    seconds: int

    def judge(self, tree: FileSystem, *, check: bool, run: Callable[[list[str]], ProgramResult] = run) -> TestVerdict:
        """Run the test: INCONCLUSIVE, or SKIP with its reason. Raises ModuleError if the program fails."""
        name = os.path.basename(self.program)
        stamps, digests = Stamps(tree), self._digests(tree)
        if stamps.holds(_STAMP, digests):
            return TestVerdict(
                "SKIP", msg(f"{arg(name)} has already been started with this build and this configuration"), worth=False
            )
        if check:
            return TestVerdict("SKIP", msg(f"{arg(name)} is not started in a plan run"), worth=False)
        result = run(["ip", "-4", "-oneline", "address", "show", "dev", self.interface])
        if result.code != 0 or " inet " not in result.output:
            words = msg(f"{arg(name)} was not started: {arg(self.interface)}, the VPN's interface, has no address yet")
            return TestVerdict("SKIP", words, worth=True)
        for path in (self.program, self.config):
            if tree.find(path) is None:
                raise ModuleError(
                    f"the build does not contain {arg(path)}", "compare `connection_test:` with the partner's examples"
                )
        result = run(self._command(tree))
        if result.code not in (0, _STILL_RUNS):
            raise ModuleError(
                f"FAIL: {arg(name)} exited with {arg(result.code)} after its start:\n{arg(error_lines(result.output))}",
                "the server C4i and its ROS interface must run at the SCC; send this output to the partner who made "
                "the example",
            )
        stamps.note(_STAMP, digests)
        ran = msg(f"ran for {arg(self.seconds)} s") if result.code == _STILL_RUNS else "ran, and ended by itself,"
        remark = "only a person at the SCC can see whether TEST_ROBOT is connected there"
        return TestVerdict(
            "INCONCLUSIVE", msg(f"INCONCLUSIVE: {arg(name)} {arg(ran)} without an error; {arg(remark)}"), worth=True
        )

    def _command(self, tree: FileSystem) -> list[str]:
        command = ["systemd-run", "--quiet", "--collect", "--wait", "--pipe", f"--uid={self.user}"]
        if tree.find(self.environment) is not None:
            command += [f"--property=EnvironmentFile={self.environment}"]
        words = [self.sourced, os.path.dirname(self.program), str(self.seconds), self.program, self.config]
        return [*command, "/bin/sh", "-c", _COMMAND, "sh", *words]

    def _digests(self, tree: FileSystem) -> dict[str, str]:
        paths = (self.program, self.config, self.environment, self.built)
        return {path: hashlib.sha256(tree.read(path) or b"").hexdigest() for path in paths}


_TEXT = {"type": "str", "required": True}
_NAMES = ("program", "config", "sourced", "environment", "built", "user", "interface")
ARGUMENTS: dict[str, Any] = {**dict.fromkeys(_NAMES, _TEXT), "seconds": {"type": "int", "required": True}}


def main() -> None:
    """Run the module."""
    module = AnsibleModule(ARGUMENTS, supports_check_mode=True)
    try:
        result = SmokeTest(**module.params).judge(FileSystem(), check=module.check_mode)
    except ModuleError as refused:
        module.fail_json(msg=refused.message, hint=refused.hint)
    notes = [result.words] if result.worth else []
    module.exit_json(changed=False, changes=[], verdict=result.verdict, msg=result.words, notes=notes)


if __name__ == "__main__":
    main()
