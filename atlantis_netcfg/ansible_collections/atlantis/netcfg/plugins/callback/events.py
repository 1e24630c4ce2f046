"""Stdout callback `atlantis.netcfg.events`: only what went wrong, since `provision` shows progress itself."""

from __future__ import annotations

from importlib import import_module
from typing import Any

from ansible.plugins.callback import CallbackBase

DOCUMENTATION = """
name: events
type: stdout
short_description: Problems only
description:
  - Prints failed tasks and unreachable hosts in one line each and nothing else.
  - Used by C(provision), which shows progress and results from the engine's own events.
"""


_ENGINES = ("site", "lte", "terminals", "computers")
"""What the actions of the playbooks import of `atlantis_netcfg.operations`."""


class CallbackModule(CallbackBase):  # type: ignore[misc]  # ansible-core ships no type information
    """Failures only."""

    CALLBACK_VERSION = 2.0
    CALLBACK_TYPE = "stdout"
    CALLBACK_NAME = "atlantis.netcfg.events"

    def v2_playbook_on_start(self, playbook: Any) -> None:  # noqa: ANN401 - as Ansible has it
        """Import the engines once, here: each action runs in a process of its own, which inherits what is imported."""
        del playbook
        for name in _ENGINES:
            import_module(f"atlantis_netcfg.operations.{name}")

    def v2_runner_on_failed(self, result: Any, ignore_errors: bool = False) -> None:  # noqa: ANN401, FBT001, FBT002
        """One line a failed task."""
        if not ignore_errors:
            self._display.display(f"{result.host.get_name()}: {result.result.get('msg', 'failed')}", stderr=True)

    def v2_runner_on_unreachable(self, result: Any) -> None:  # noqa: ANN401
        """One line an unreachable host."""
        self._display.display(f"{result.host.get_name()}: {result.result.get('msg', 'unreachable')}", stderr=True)
