"""Stdout callback `atlantis.netcfg.events`: prints failures only, since `provision` shows progress itself."""

from __future__ import annotations

from typing import Any

from ansible.plugins.callback import CallbackBase

from atlantis_netcfg.core import printable
from atlantis_netcfg.operations.common.play_control import refuse_after_stop

DOCUMENTATION = """
name: events
type: stdout
short_description: Problems only
description:
  - Prints failed tasks and unreachable hosts in one line each and nothing else.
  - Used by C(provision), which shows progress and results from the engine's own events.
"""


class CallbackModule(CallbackBase):  # type: ignore[misc]  # ansible-core ships no type information
    """Prints failures only; starts no further task after the user has stopped the run."""

    CALLBACK_VERSION = 2.0
    CALLBACK_TYPE = "stdout"
    CALLBACK_NAME = "atlantis.netcfg.events"

    def v2_playbook_on_play_start(self, play: Any) -> None:  # noqa: ANN401 - as Ansible has it
        """Begin no play after Ctrl-C."""
        del play
        refuse_after_stop()

    def v2_playbook_on_task_start(self, task: Any, is_conditional: bool) -> None:  # noqa: ANN401, FBT001
        """Begin no task after Ctrl-C."""
        del task, is_conditional
        refuse_after_stop()

    def v2_runner_on_failed(self, result: Any, ignore_errors: bool = False) -> None:  # noqa: ANN401, FBT001, FBT002
        """Print one line for a failed task, unless its errors are ignored."""
        if not ignore_errors:
            self._display_message(result, "failed")

    def v2_runner_on_unreachable(self, result: Any) -> None:  # noqa: ANN401
        """Print one line for an unreachable host."""
        self._display_message(result, "unreachable")

    def _display_message(self, result: Any, otherwise: str) -> None:  # noqa: ANN401
        words = printable.below(str(result.result.get("msg", otherwise)), 2)
        self._display.display(f"{result.host.get_name()}: {words}", stderr=True)
