"""Runs `playbooks/site.yml` in this process, and receives the engine's events while it runs.

Ansible is imported, configured and given the inventory at most once per command; each further play costs only the forks
of its tasks. Tasks report over a pipe, so that everything reported before a task died has been received.
"""

from __future__ import annotations

import contextlib
import io
import json
import os
import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from importlib import import_module
from typing import TYPE_CHECKING, Any, Self

from atlantis_netcfg.core import errors, events, paths, stored_messages
from atlantis_netcfg.core.messages import arg, msg
from atlantis_netcfg.operations.common import play_control
from atlantis_netcfg.operations.common.request import share_inventory
from atlantis_netcfg.operations.common.vault import Vault, import_ansible, load_used_plugins
from atlantis_netcfg.routeros.apply import Status

if TYPE_CHECKING:
    from pathlib import Path

    from atlantis_netcfg.inventory import Inventory
    from atlantis_netcfg.operations import Request


class EngineError(errors.NetcfgError):
    """An error reported by the engine, with its message and exit code."""

    def __init__(self, message: str, hint: str | None, code: int) -> None:
        super().__init__(message, hint=hint)
        self.exit = errors.ExitCode(code)


@dataclass(slots=True)
class PlayOutcome:
    """Result of the play: one entry per device, as written by the engine."""

    devices: dict[str, dict[str, Any]] = field(default_factory=dict)
    runs: dict[str, dict[str, str]] = field(default_factory=dict)
    """Site -> kind of device -> run id, as `provision report runs` lists it; empty: the report is not complete."""
    stopped_by: str = ""
    """Signal with which a person stopped it, such as `SIGINT`."""


ResultCallback = Callable[[str, Mapping[str, Any]], object]
"""Called with the name and the result of a device as soon as it has ended."""


_LEFT_AS_FOUND = Status.LEFT_AS_FOUND.value


class PlaybookRunner:
    """Runs Ansible in this process. The engine uses `inventory`: it does not read the inventory again."""

    def __init__(self, inventory: Inventory, vault: Vault) -> None:
        self._vault = vault
        self._inventory = inventory
        self._ansible: _Ansible | None = None

    def play(
        self,
        names: Sequence[str],
        request: Request,
        notify: events.Subscriber,
        *,
        on_result: ResultCallback = lambda _name, _result: None,
    ) -> PlayOutcome:
        """Run the playbook for these hosts to its end; then each has a result, whatever happened.

        The other end of a bridge also has one, because it is handled together with them.

        A stop signal is passed to the engine, which finishes cleanly: it is no KeyboardInterrupt here. Raises
        EngineError if the request was rejected, and no device was changed or compared.
        """
        self._ansible = self._ansible or _Ansible(self._inventory.root, self._vault)
        control = play_control.PlayControl()
        with _EventListener(notify, on_result) as listener, control.current(), share_inventory(self._inventory):
            play_request = request.model_copy(update={"events_fd": listener.writer})
            reason, output = self._ansible.play(names, play_request, control)
            if reason:
                control.cut_off(reason)
        outcome, refusal = listener.outcome, listener.refusal
        outcome.stopped_by = control.stopped_by
        hosts = dict.fromkeys((*names, *play_control.other_ends(names, self._inventory, request)))
        missing = [name for name in hosts if name not in outcome.devices]
        missing_results = play_control.results_from_journal(
            missing, names, self._inventory, request, outcome.runs, refusal or reason, output
        )
        results = {**outcome.devices, **missing_results}
        if refusal is not None and all(result["status"] == _LEFT_AS_FOUND for result in results.values()):
            raise refusal
        for name, result in missing_results.items():
            on_result(name, result)
        outcome.devices = {name: results[name] for name in (*names, *results)}
        return outcome


class _Ansible:
    """Ansible's objects that are reused between plays, without its command line, which would parse everything again."""

    def __init__(self, inventory: Path, vault: Vault) -> None:
        self._playbook = paths.resource("playbooks") / "site.yml"
        if not self._playbook.is_file():
            raise errors.UsageError(
                f"no such playbook: {arg(self._playbook)}", hint="run `provision` from a checkout of the toolkit"
            )
        self._inventory = str(inventory)
        import_ansible()
        from ansible.inventory.manager import InventoryManager
        from ansible.parsing.dataloader import DataLoader
        from ansible.parsing.vault import VaultSecretsContext
        from ansible.plugins.loader import add_all_plugin_dirs, init_plugin_loader
        from ansible.utils.collection_loader import AnsibleCollectionConfig

        self._set_options({}, ())
        if AnsibleCollectionConfig.collection_finder is None:
            init_plugin_loader()
        load_used_plugins()
        folder = str(self._playbook.parent)
        add_all_plugin_dirs(folder)
        AnsibleCollectionConfig.playbook_paths = [folder]
        self._loader = DataLoader()
        self._loader.set_vault_secrets(vault.known_secrets)
        if (secrets := VaultSecretsContext.current(optional=True)) is None:
            VaultSecretsContext.initialize(VaultSecretsContext(vault.known_secrets))
        else:
            secrets.secrets = vault.known_secrets
        self._hosts = InventoryManager(loader=self._loader, sources=[self._inventory])
        # Each task runs in a process of its own, which inherits what is imported.
        import_module("atlantis_netcfg.operations.apply")

    def play(self, names: Sequence[str], request: Request, control: play_control.PlayControl) -> tuple[str, str]:
        """Run the playbook; return why it was interrupted (if it was) and Ansible's output."""
        from ansible.errors import AnsibleError
        from ansible.executor.playbook_executor import PlaybookExecutor
        from ansible.vars.manager import VariableManager

        self._set_options({"atlantis_request": request.model_dump(mode="json")}, names, check=request.mode.reads_only)
        self._hosts.subset(",".join(names))
        output, reason = io.StringIO(), ""
        # Ansible closes them to whatever this process starts from now on, also after the play.
        inheritable = [number for number in (0, 1, 2) if os.get_inheritable(number)]
        executor = PlaybookExecutor(
            playbooks=[str(self._playbook)],
            inventory=self._hosts,
            variable_manager=VariableManager(loader=self._loader, inventory=self._hosts, version_info=_version()),
            loader=self._loader,
            passwords={},
        )
        manager = executor._tqm  # noqa: SLF001 - Ansible tells nobody else which tasks run
        control.workers = lambda: [task.pid for task in manager.get_workers() if task is not None and task.is_alive()]
        control.take_signals()
        with (
            contextlib.closing(manager._connection_lockfile),  # noqa: SLF001 - as above; Ansible leaves it to its end
            contextlib.redirect_stdout(output),
            contextlib.redirect_stderr(output),
        ):
            try:
                executor.run()
            except AnsibleError as error:
                reason = str(error)
            except KeyboardInterrupt:
                reason = msg(f"interrupted by {arg(control.stopped_by)}")
            finally:
                for number in inheritable:
                    os.set_inheritable(number, True)
        if control.stopped_by and reason:
            reason = msg(f"interrupted by {arg(control.stopped_by)}")
        elif "dead state" in reason:
            reason = "the process working on it was killed"
        return reason, output.getvalue().strip()

    def _set_options(self, variables: Mapping[str, Any], names: Sequence[str], *, check: bool = False) -> None:
        """Set what `ansible-playbook` takes from its command line, as Ansible's Python API has it done."""
        from ansible import constants, context
        from ansible.utils.context_objects import CLIArgs
        from ansible.utils.vars import load_extra_vars, load_options_vars

        # Both keep what they have read once; a command may run more than one play.
        load_extra_vars.extra_vars = load_options_vars.options_vars = None
        context.CLIARGS = CLIArgs(
            {
                "args": (str(self._playbook),),
                "become": False,
                "become_method": constants.DEFAULT_BECOME_METHOD,
                "check": check,
                "connection": constants.DEFAULT_TRANSPORT,
                "diff": check,
                "extra_vars": (json.dumps(variables),),
                "flush_cache": False,
                "force_handlers": constants.DEFAULT_FORCE_HANDLERS,
                "forks": constants.DEFAULT_FORKS,
                "inventory": (self._inventory,),
                "listhosts": False,
                "listtags": False,
                "listtasks": False,
                "skip_tags": ("recap",),
                "start_at_task": None,
                "step": False,
                "subset": ",".join(names),
                "syntax": False,
                "tags": ("all",),
                "verbosity": 0,
            }
        )


def _version() -> dict[str, Any]:
    """Return Ansible's version in the format of `ansible_version`."""
    from ansible.release import __version__ as version

    major, minor, revision = (int(part) if part.isdigit() else 0 for part in version.split(".")[:3])
    return {"string": version, "full": version, "major": major, "minor": minor, "revision": revision}


class _EventListener:
    """Receives events of tasks over a pipe, in its own thread, and forwards them at once."""

    def __init__(self, notify: events.Subscriber, on_result: ResultCallback) -> None:
        self.outcome = PlayOutcome()
        self.refusal: EngineError | None = None
        self._notify, self._ended = notify, on_result
        reader, self.writer = os.pipe()
        self._lines = os.fdopen(reader, encoding="utf-8")
        self._thread = threading.Thread(target=self._listen, name="events", daemon=True)
        self._failure: BaseException | None = None

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        """Read the rest: an empty line marks the end, also after an incomplete line of a task."""
        os.write(self.writer, b"\n\n")
        self._thread.join()
        os.close(self.writer)
        self._lines.close()
        if self._failure is not None:
            raise self._failure

    def _listen(self) -> None:
        for line in self._lines:
            if not line.strip():
                return
            try:
                message = stored_messages.unpack(json.loads(line))
            except ValueError:
                continue  # whoever wrote it was killed in the middle
            try:
                self._handle_message(message)
            except BaseException as failure:  # noqa: BLE001 - told in the main thread; results are still taken in
                self._failure = self._failure or failure

    def _handle_message(self, message: Mapping[str, Any]) -> None:
        if "event" in message:
            self._notify(events.Event(**{**message["event"], "stage": events.Stage(message["event"]["stage"])}))
        elif "error" in message:
            error = message["error"]
            self.refusal = self.refusal or EngineError(error["message"], error["hint"], error["exit"])
        else:
            for site, runs in message["runs"].items():
                self.outcome.runs.setdefault(site, {}).update(runs)
            self.outcome.devices.update(message["devices"])
            for name, result in message["devices"].items():
                self._ended(name, result)
