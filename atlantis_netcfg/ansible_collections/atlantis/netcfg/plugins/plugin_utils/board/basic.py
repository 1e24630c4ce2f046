"""Minimal replacement of `ansible.module_utils.basic` for our modules; the zipapp has it in its place.

Parameters arrive over standard input, already validated against the argument spec by the technician's computer. The
result is the last line of standard output that begins with `MARK`.
"""

from __future__ import annotations

import json
import sys
import syslog
import zlib
from typing import Any, NoReturn

from atlantis_netcfg.core.stored_messages import pack

MARK = "ATLANTIS-RESULT "


class AnsibleModule:
    """Subset of Ansible's class that our modules use: `params`, `check_mode`, and the two ways to end."""

    def __init__(self, argument_spec: dict[str, Any], **_rules: Any) -> None:  # noqa: ANN401, ARG002 - as Ansible has it
        request = json.loads(zlib.decompress(sys.stdin.buffer.read()).decode())
        self.params: dict[str, Any] = request["params"]
        self.check_mode: bool = request["check"]
        self._name: str = request["name"]
        if request["log"]:
            self._log_invocation()

    def _log_invocation(self) -> None:
        self.log("Invoked")

    def log(self, msg: str) -> None:
        """Write a line to the computer's system log."""
        syslog.openlog(f"ansible-{self._name}", 0, syslog.LOG_USER)
        syslog.syslog(syslog.LOG_INFO, msg)

    @staticmethod
    def exit_json(**result: Any) -> NoReturn:  # noqa: ANN401 - as Ansible has it
        """Print a successful result and exit."""
        tell_result(result)
        sys.exit(0)

    @staticmethod
    def fail_json(msg: str, **result: Any) -> NoReturn:  # noqa: ANN401 - as Ansible has it
        """Print a failure and exit."""
        tell_result({**result, "failed": True, "msg": msg})
        sys.exit(1)


def tell_result(result: dict[str, Any]) -> None:
    """Print the result as the last line of this program."""
    text = json.dumps(pack(result), ensure_ascii=False, separators=(",", ":"))
    sys.stdout.flush()
    sys.stdout.buffer.write(f"\n{MARK}{text}\n".encode("utf-8", "replace"))
    sys.stdout.buffer.flush()
