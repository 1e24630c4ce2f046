"""Callback `atlantis.netcfg.computers`: lock, journal and results of a play over computers.

A computer is any host reached by SSH. Ordinary roles report to Ansible how each task ended; this callback forwards it
to `atlantis_netcfg.operations.computers`, which holds the lock of the site for the duration of the play. It is enabled
in ansible.cfg, so that plain `ansible-playbook` is protected in the same way.
"""

from __future__ import annotations

import atexit
from contextlib import ExitStack
from typing import TYPE_CHECKING, Any

from ansible import context
from ansible.plugins.callback import CallbackBase

from atlantis_netcfg.ansible_collections.atlantis.netcfg.plugins.plugin_utils.engine_action import inventory_of

if TYPE_CHECKING:
    from collections.abc import Sequence

    from atlantis_netcfg.inventory import Host, Inventory
    from atlantis_netcfg.operations.computers._watch import Watch

DOCUMENTATION = """
name: computers
type: notification
short_description: Lock, journal and results of computers
description:
  - Holds the lock of each site while the roles of its computers run, and writes its journal.
  - Hands the result of every computer to C(provision), if that is who asked.
requirements:
  - enabled in C(callbacks_enabled) of ansible.cfg
"""
GROUPS = ("vpn_servers", "gateways", "control_centres", "operator_stations")


class CallbackModule(CallbackBase):  # type: ignore[misc]  # ansible-core ships no type information
    """Receives Ansible's events only; `operations.computers` contains the logic."""

    CALLBACK_VERSION = 2.0
    CALLBACK_TYPE = "notification"
    CALLBACK_NAME = "atlantis.netcfg.computers"
    CALLBACK_NEEDS_ENABLED = True

    def __init__(self) -> None:
        super().__init__()
        self._watch: Watch | None = None
        self._emulators = ExitStack()

    def v2_playbook_on_start(self, playbook: Any) -> None:  # noqa: ANN401
        """Read the inventory, and start emulated devices if the user has requested a rehearsal.

        Ansible turns an exception of a callback into a warning and continues; SystemExit is not caught.
        """
        from atlantis_netcfg.core.errors import NetcfgError  # noqa: PLC0415 - Ansible imports every plugin

        play = playbook.get_plays()[0]
        try:
            self._begin(play.get_variable_manager(), play)
        except NetcfgError as error:
            self._display.error("\n".join(filter(None, (str(error), error.hint))), wrap_text=False)
            raise SystemExit(int(error.exit)) from error

    def v2_playbook_on_play_start(self, play: Any) -> None:  # noqa: ANN401
        """Start watching a play over computers, until the end of the playbook."""
        manager = play.get_variable_manager()
        hosts = manager._inventory.get_hosts(play.hosts)  # noqa: SLF001 - a callback is not told in another way
        over = {name for pattern in play.hosts for name in pattern.split(":")}
        if self._watch is not None or not over.intersection(GROUPS) or not hosts:
            return
        from atlantis_netcfg.operations.common.play_control import on_interrupt  # noqa: PLC0415 - as above
        from atlantis_netcfg.operations.common.request import Request, of_variables  # noqa: PLC0415 - as above
        from atlantis_netcfg.operations.computers._watch import Watch  # noqa: PLC0415 - Ansible imports every plugin

        variables = manager.get_vars(play=play, host=hosts[0])
        request = Request.model_validate(of_variables(variables))
        self._watch = Watch(inventory_of(variables), request, plan_only=bool(context.CLIARGS.get("check")))
        on_interrupt(self._watch.cut_off)
        self._watch.begin([host.name for host in hosts])

    def _begin(self, manager: Any, play: Any) -> None:  # noqa: ANN401
        """Reject an invalid inventory, such as a template in a connection variable, before the first task.

        For each task Ansible evaluates the variables of the connection first, and only then starts our action, which
        would have rejected them.
        """
        hosts = manager._inventory.get_hosts()  # noqa: SLF001 - a callback is not told in another way
        variables = manager.get_vars(play=play, host=hosts[0]) if hosts else {}
        if not hosts or not inventory_of(variables).is_dir():
            return
        from atlantis_netcfg.operations.common.request import REHEARSE_VARIABLE, of_variables, open_inventory  # noqa: PLC0415 - as above

        inventory = open_inventory(inventory_of(variables))
        if (
            REHEARSE_VARIABLE in variables
            and not variables.get("atlantis_request")
            and of_variables(variables)["rehearsed"]
        ):
            self._rehearse(manager, inventory, [inventory.hosts[host.name] for host in hosts])

    def _rehearse(self, manager: Any, inventory: Inventory, hosts: Sequence[Host]) -> None:  # noqa: ANN401
        """Start emulated devices until the playbook ends, and leave out hosts that have no emulator."""
        from atlantis_netcfg.operations.common.rehearsal import rehearsal  # noqa: PLC0415 - as above
        from atlantis_netcfg.operations.common.request import Request  # noqa: PLC0415 - as above

        emulators = self._emulators.enter_context(rehearsal(inventory, hosts))
        atexit.register(self._emulators.close)
        for name, why in emulators.left_out.items():
            self._display.warning(f"not rehearsed: {name}: {why}")
        manager._inventory.subset(",".join(host.name for host in hosts if host.name not in emulators.left_out))  # noqa: SLF001
        request = Request(rehearsed=True, **emulators.request_fields)
        manager.extra_vars["atlantis_request"] = request.model_dump(mode="json", exclude_defaults=True)

    def v2_runner_on_start(self, host: Any, task: Any) -> None:  # noqa: ANN401
        """Report the start of a task, as one line of progress."""
        if self._watch is not None:
            self._watch.start_task(host.name, task.get_name())

    def v2_runner_on_ok(self, result: Any) -> None:  # noqa: ANN401
        """Report the changes of a task that succeeded."""
        if self._watch is not None:
            self._watch.ok(result.host.name, result.task.get_name(), result.result)

    def v2_runner_on_failed(self, result: Any, ignore_errors: bool = False) -> None:  # noqa: ANN401, FBT001, FBT002
        """Report why a task failed, unless its errors are ignored."""
        if self._watch is not None and not ignore_errors:
            self._watch.fail_task(result.host.name, result.task.get_name(), result.result)

    def v2_runner_on_unreachable(self, result: Any) -> None:  # noqa: ANN401
        """Report why a host is unreachable."""
        if self._watch is not None:
            self._watch.unreachable(result.host.name, result.task.get_name(), result.result)

    def v2_playbook_on_stats(self, stats: Any) -> None:  # noqa: ANN401
        """Finish the watch with the hosts that failed at the end; a failure rescued by a role does not count."""
        if self._watch is not None:
            self._watch.end({*stats.failures, *stats.dark})
            self._watch = None
        self._emulators.close()
