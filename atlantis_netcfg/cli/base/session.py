"""Shared by the commands that run a playbook: inventory, hosts, progress, and the final output."""

from __future__ import annotations

import hashlib
import json
import re
import shlex
import sys
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field, replace
from functools import partial
from importlib import import_module
from typing import TYPE_CHECKING, Any, TextIO

from atlantis_netcfg import inventory
from atlantis_netcfg.cli.base import consent, output, syntax
from atlantis_netcfg.cli.base.commands import DEFAULT
from atlantis_netcfg.cli.base.passphrase import vault_of
from atlantis_netcfg.cli.base.playbook import PlaybookRunner, PlayOutcome
from atlantis_netcfg.core import errors, paths, printable
from atlantis_netcfg.core.language import translate
from atlantis_netcfg.core.messages import arg, join, msg
from atlantis_netcfg.core.processes import stop_signals
from atlantis_netcfg.operations import Mode, Request
from atlantis_netcfg.operations.common.costs import preview_costs, require_consent
from atlantis_netcfg.operations.common.kinds import is_other_lte_unit, is_supported
from atlantis_netcfg.operations.common.session_link import site_link_of
from atlantis_netcfg.operations.common.terminals import is_terminal
from atlantis_netcfg.operations.computers._access import is_computer
from atlantis_netcfg.runs import Store
from atlantis_netcfg.runs.report.run import RunReport, consent_question

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence
    from pathlib import Path

    from atlantis_netcfg.inventory import Host, Inventory
    from atlantis_netcfg.operations.common.link_shapes import Replay
    from atlantis_netcfg.operations.common.rehearsal import Rehearsal
    from atlantis_netcfg.operations.common.request import LinkOrder
    from atlantis_netcfg.operations.common.vault import Vault


@dataclass(slots=True)
class CommandSession:
    """State of one command for a site while its playbook runs."""

    arguments: syntax.Arguments
    inventory: Inventory
    site: str
    hosts: tuple[Host, ...]
    rehearsal: Rehearsal | None
    state: Path
    vault: Vault
    """Vault that decrypted the secrets of the inventory."""
    via: str | None = None
    prepares: bool = False
    back_to: str | None = None
    """Rollback: the run before which the devices were in the state to be restored."""
    restore: str | None = None
    """Restore: the run that recorded the state to which the device is restored."""
    use: LinkOrder | None = None
    """Use: the order of the links that the router uses for a limited time."""
    offline: Path | None = None
    """Bundle from which gateways take everything."""
    remove_foreign: bool = False
    """Whether a person has agreed that hundreds of rows of others are removed."""
    changed_devices: list[str] = field(default_factory=list)
    """Devices that plays of this command have changed, confirmed by reading back."""
    _runner: PlaybookRunner | None = None

    @property
    def is_rehearsal(self) -> bool:
        """Whether the devices are emulated."""
        return self.rehearsal is not None

    @property
    def store(self) -> Store:
        """Store of the site's journals and saved states."""
        return Store(self.state, is_rehearsal=self.is_rehearsal)

    def narrow(self, names: Sequence[str]) -> None:
        """Restrict the session to these hosts. Raises NoMatchError if none is left."""
        self.hosts = tuple(host for host in self.hosts if host.name in names)
        if not self.hosts:
            raise errors.NoMatchError(
                "nothing to do for any device of that run", hint="`provision report runs` lists the runs"
            )

    @property
    def as_json(self) -> bool:
        """Whether a program reads the output."""
        return self.arguments.flag("json")

    @property
    def handled_hosts(self) -> tuple[Host, ...]:
        """Hosts for which there is a role."""
        return tuple(host for host in self.hosts if is_supported(host))

    def request(
        self,
        mode: Mode,
        *,
        plans: Mapping[str, str] | None = None,
        run: str | None = None,
        via: Mapping[str, str] | None = None,
    ) -> Request:
        """Build the engine's request from the command line; `via` names links other than the usual ones."""
        return Request(
            state=self.state,
            mode=mode,
            rehearsed=self.is_rehearsal,
            via={**({host.name: self.via for host in self.hosts} if self.via else {}), **(via or {})},
            plans=dict(plans) if plans is not None else None,
            run=run,
            prepares=self.prepares,
            back_to=self.back_to,
            restore=self.restore,
            use=self.use,
            offline=self.offline,
            unprotected=self.arguments.has_flag(syntax.WITHOUT_PROTECTION),
            accept_cost=self.arguments.has_flag(syntax.ACCEPT_COST),
            remove_foreign=self.arguments.has_flag(syntax.REMOVE_FOREIGN) or self.remove_foreign,
            **(self.rehearsal.request_fields if self.rehearsal else {}),
            command=shlex.join(["provision", *sys.argv[1:]]),
        )

    def perform(
        self,
        mode: Mode,
        *,
        plans: Mapping[str, str] | None = None,
        run: str | None = None,
        via: Mapping[str, str] | None = None,
        is_paid: bool = False,
    ) -> RunReport:
        """Run the playbook once for the supported hosts; `via` names links other than the usual ones.

        Asks for consent before the first byte over a metered link, unless `is_paid`.
        """
        request = self.request(mode, plans=plans, run=run, via=via)
        other_hosts = self._other_hosts(mode)
        # What their tasks need is imported before these, which are forked children, and only where they take part.
        if any(is_other_lte_unit(host) for host in other_hosts):
            import_module("atlantis_netcfg.operations.lte.run")
        if any(is_computer(host) for host in other_hosts):
            from atlantis_netcfg.operations.computers.parts import require_authority

            if not self.inventory.pilot.example_values:
                require_authority(other_hosts, request)
        request = request.model_copy(update={"accept_cost": True}) if is_paid else self.confirm_cost(request)
        names = [host.name for host in (*self.handled_hosts, *other_hosts)]
        self._refuse_early(request)
        self._runner = self._runner or PlaybookRunner(self.inventory, self.vault)
        with output.progress(quiet=self.as_json) as notify:
            on_result = partial(self._stream_result, sys.stdout)
            outcome = self._runner.play(names, request, notify, on_result=on_result) if names else PlayOutcome()
        if not mode.reads_only:
            self.changed_devices += [name for name, result in outcome.devices.items() if result["confirmed"]]
        return RunReport(
            site=self.site,
            is_rehearsal=self.is_rehearsal,
            devices={name: self._complete_hint(result) for name, result in outcome.devices.items()},
            not_handled={
                host.name: host.device.kind
                for host in self.hosts
                if not is_supported(host) and host.name not in outcome.devices and host.name not in self.left_out
            },
            left_out=self.left_out,
            not_rehearsed=self.rehearsal.not_rehearsed if self.rehearsal else (),
            runs=tuple(dict.fromkeys(run for runs in outcome.runs.values() for run in runs.values())),
            stopped_by=outcome.stopped_by,
            purpose=mode.value,
            verbose=self.arguments.has_flag(syntax.VERBOSE),
        )

    def configure_emulators(self, *, strict: bool = False) -> None:
        """Bring the emulated devices to the desired state: after `provision device adopt` they have none of it.

        A failed check is reported later, by the command that uses the devices, unless `strict`. Raises NetcfgError.
        """
        self.prepares = True
        try:
            report = self.perform(Mode.APPLY)
        finally:
            self.prepares = False
        if report.exit not in (
            {errors.ExitCode.DONE}
            if strict
            else {errors.ExitCode.DONE, errors.ExitCode.CHECKS_FAILED, errors.ExitCode.NOTHING}
        ):
            raise errors.NetcfgError(f"cannot configure the emulated devices:\n{arg(report.as_text())}")

    def _refuse_early(self, request: Request) -> None:
        """Raise errors that can be known before anything is started: a wrong link, a site that is locked."""
        for host in self.hosts:
            site_link_of(self.inventory, host, request.via.get(host.name))
        if not request.mode.reads_only:
            for site in sorted({host.site for host in self.hosts}):
                with self.store.lock(site, request.command):
                    pass

    def confirm_cost(self, request: Request) -> Request:
        """Return the request with consent to the cost, if it is needed. Raises CostRefusal.

        With example values nothing is contacted, and a rehearsal costs nothing: then there is no prompt.
        """
        if request.rehearsed or self.inventory.pilot.example_values:
            return request
        accepted_request = request.model_copy(update={"accept_cost": True})
        require_consent(self.inventory, self.hosts, accepted_request)
        words = [each.words for each in preview_costs(self.inventory, self.hosts, request)]
        consent.pay(words, is_accepted=request.accept_cost, as_json=self.as_json)
        return accepted_request if words else request

    def _other_hosts(self, mode: Mode) -> tuple[Host, ...]:
        """Return the hosts handled in addition to the engine's: 4G units of other makes, terminals, computers.

        Nothing is sent to a terminal: the evidence for its inventory data is checked.
        """
        if mode is Mode.BACKUP or self.back_to is not None or self.restore is not None:
            return ()
        computers = [host for host in self.hosts if is_computer(host) and host.name not in self.left_out]
        others = [
            host
            for host in self.hosts
            if (is_other_lte_unit(host) and mode is not Mode.DRIFT) or (is_terminal(host) and mode is not Mode.RESUME)
        ]
        return (*others, *computers)

    @property
    def contacted_hosts(self) -> tuple[Host, ...]:
        """Hosts of a rehearsal that are behind a link: those that the engine handles, and the computers."""
        return (
            *self.handled_hosts,
            *(host for host in self.hosts if is_computer(host) and host.name not in self.left_out),
        )

    @property
    def left_out(self) -> Mapping[str, str]:
        """Hosts of a rehearsal without an emulator, and why."""
        return self.rehearsal.left_out if self.rehearsal is not None else {}

    def _stream_result(self, out: TextIO, name: str, result: Mapping[str, Any]) -> None:
        """Print a device's result for a program that reads along, while other devices are still in progress."""
        if self.as_json and self.arguments.has_flag(syntax.STREAM):
            print(output.json_text({"device": name, **self._complete_hint(result)}), file=out, flush=True)

    def _complete_hint(self, result: Mapping[str, Any]) -> dict[str, Any]:
        """Complete the hint of a result with this command's arguments, which the engine does not know."""
        return {
            **result,
            "hint": result["hint"] and output.as_typed(result["hint"], output.carried_words(self.arguments)),
        }

    def plan(self) -> RunReport:
        """Plan, show it, and in a rehearsal prove that planning has changed nothing."""
        before = self._exports()
        report = self.perform(Mode.PLAN)
        self.show_plan(report)
        if self._exports() != before:
            raise errors.NetcfgError("internal error: planning changed an emulated device")
        if self.is_rehearsal and not self.as_json:
            print(translate("the emulated device is unchanged, byte for byte"))
        return report

    def change(self, *, ask: bool, saved_plans: Mapping[str, str] | None = None, again: str = "") -> RunReport:
        """Change the devices; the user agrees to the plan shown, and only that plan is applied.

        `saved_plans`: device name to the `planned_state` of a saved plan. The current plan must be equal, or already
        done; `again` is the command that makes a new plan. Raises OutdatedPlan.
        """
        if not ask and saved_plans is None:
            report = self.perform(Mode.APPLY)
            if self.arguments.flag("verbose"):
                self.show_plan(report)
            return report
        plan_report = self.plan()
        plans = {name: str(row["plan_hash"]) for name, row in plan_report.devices.items()}
        if saved_plans is not None:
            _refuse_outdated(plan_report, saved_plans, again)
        if errors.worst(self._plannable(plan_report)) is not errors.ExitCode.CHANGES:
            return plan_report
        if not ask:
            return self.perform(Mode.APPLY, plans=plans)
        self._agree(plan_report)
        return self.perform(Mode.APPLY, plans=plans, is_paid=bool(self._consent_questions(plan_report)))

    @staticmethod
    def _consent_questions(plan_report: RunReport) -> list[str]:
        return [
            consent_question(device["cost"])
            for device in plan_report.devices.values()
            if device["planned"] and "cost" in device
        ]

    def _agree(self, plan_report: RunReport) -> None:
        """Ask for consent to the plan, to its cost and to the removal of many rows. Raises ConsentRefusal."""
        dear = self._consent_questions(plan_report)
        if dear and not self.arguments.has_flag(syntax.ACCEPT_COST):
            consent.confirm_cost(dear, ask=not self.as_json)
        many = [
            msg(f"{arg(name)}: the plan {arg(change['foreign_words'])}")
            for name, change in plan_report.devices.items()
            if _foreign(change)
        ]
        if many and not self.arguments.has_flag(syntax.REMOVE_FOREIGN):
            consent.confirm_removal(many, ask=not self.as_json)
            self.remove_foreign = True
        changing = (
            name for name, item in plan_report.devices.items() if item["planned"] or item["status"] == "planned"
        )
        consent.require_agreement(msg(f"Change {arg(join(', ', changing))} now?"))

    @staticmethod
    def _plannable(plan_report: RunReport) -> Iterator[errors.ExitCode]:
        """Yield each device's exit code; failed checks of a device do not prevent changing it."""
        codes = (plan_report.exit, *(errors.ExitCode(device["exit"]) for device in plan_report.devices.values()))
        return (code for code in codes if code is not errors.ExitCode.CHECKS_FAILED)

    def _exports(self) -> dict[str, str]:
        """Return the exports of the emulated devices, without comment lines, which contain the time."""
        if self.rehearsal is None:
            return {}
        texts = {name: self.rehearsal.export(name) for name in self.rehearsal.targets}
        return {name: re.sub(r"(?m)^#.*\n", "", text) for name, text in texts.items()}

    def show_plan(self, report: RunReport) -> None:
        """Print the changes in the device's own syntax, and their cost; with `--summary` only the cost."""
        if not self.as_json:
            output.page(report.cost_rows() if self.arguments.has_flag(syntax.SUMMARY) else report.plan_rows())

    def close(self, report: RunReport, next_command: str = "") -> errors.ExitCode:
        """Print the result and store it beside the journal; `next_command` replaces the usual suggestion."""
        stop_signals.ignore()
        as_json = report.as_json()
        record = self._keep(report.runs, as_json)
        if self.as_json:
            print(output.json_text(as_json))
        else:
            final_report = replace(report, next_command=next_command or self._next_command(report), record=record)
            printable.show(final_report.rows(printable.width_of(sys.stdout)), sys.stdout)
        return report.exit

    def _keep(self, runs: Sequence[str], result: Mapping[str, Any]) -> str:
        """Store the result beside the journals of these runs; return a text with the runs and their place."""
        data = json.dumps(result, ensure_ascii=False, indent=1).encode()
        saved_runs, failure = list[str](), ""
        sites = sorted({host.site for host in self.hosts})
        for run in filter(None, runs):
            try:
                places = [site for site in sites if self.store.keep_result(site, run, data)]
                saved_runs += [run] if places else []
            except OSError as error:
                saved_runs.append(run)
                failure = msg(f"; its result could not be written: {arg(error.strerror)}")
        folder = self.store.root / (sites[0] if len(sites) == 1 else "*") / "runs"
        record = msg(f"{arg(join(', ', saved_runs))} in {arg(paths.shorten_home(folder))}{arg(failure)}")
        return translate(record) if saved_runs else ""

    def _next_command(self, report: RunReport) -> str:
        """Return the next command after success; after an error, the device has its own hint."""
        site = min(host.site for host in self.hosts)
        if report.exit is errors.ExitCode.CHANGES:
            return self._typed_without(*PLAN_ONLY)
        if report.exit is errors.ExitCode.DONE and not report.stopped_by:
            words = output.carried_words(self.arguments)
            vehicles = self.inventory.vehicles
            if self.is_rehearsal and vehicles:  # a small step first: the vehicle with the fewest items
                number = {name: len(vehicle.endpoints.model_fields_set) for name, vehicle in vehicles.items()}
                words = [f"vehicle={min(number, key=number.__getitem__)}", *words]
            rehearse_flag = ["--rehearse"] if self.is_rehearsal and "--rehearse" not in words else []
            return shlex.join(["provision", "check", f"site={site}", *words, *rehearse_flag])
        return ""

    def _typed_without(self, *flags: str) -> str:
        """Return this command line without these flags and their values."""
        arguments = self.arguments
        words = [f"{name}={','.join(values)}" for name, values in arguments.words.items()]
        kept_flags = [
            part
            for name, value in arguments.flags.items()
            if name not in flags
            for part in ([f"--{name}"] if value is None else [f"--{name}", value])
        ]
        command_words = [] if arguments.command.name in {DEFAULT, "plan"} else arguments.command.name.split()
        return shlex.join(["provision", *command_words, *words, *kept_flags])


PLAN_ONLY = ("plan", "summary", "save", "verbose", "json", "stream")
"""Flags that the command which applies a plan does not have, or that only change how it is shown."""


class OutdatedPlan(errors.DeviceError):
    """A saved plan differs from the current one: the devices have changed since, and none was changed now."""


def planned_state(result: Mapping[str, Any]) -> str:
    """Return a digest of a device's plan and its diff, so that the old values of rows count as well."""
    diff_digest = hashlib.sha256(str(result["diff"]).encode()).hexdigest()
    return f"{result['plan_hash']}:{diff_digest}"


def _refuse_outdated(plan_report: RunReport, saved_plans: Mapping[str, str], again: str) -> None:
    plans = {name: planned_state(row) for name, row in plan_report.devices.items()}
    # The inventory is that of the plan: where nothing is left to do, its plan was carried out.
    done_plans = {
        name: plans[name]
        for name in saved_plans.keys() & plans
        if plan_report.devices[name]["exit"] == errors.ExitCode.DONE
    }
    saved_plans = {**saved_plans, **done_plans}
    silent = [
        name
        for name, row in plan_report.devices.items()
        if row["exit"] not in (errors.ExitCode.DONE, errors.ExitCode.CHANGES)
    ]
    other = [name for name in dict.fromkeys((*saved_plans, *plans)) if saved_plans.get(name) != plans.get(name)]
    changed_names = [name for name in other if name not in silent]
    if changed_names:
        raise OutdatedPlan(
            f"nothing was changed: {arg(join(', ', changed_names))} changed since the plan was saved",
            hint=f"make a new plan and review it: `{arg(again)}`",
        )


def _foreign(result: Mapping[str, Any]) -> bool:
    """Return whether the plan removes many foreign rows; results of other engines never do."""
    return bool(result.get("foreign_words"))


@contextmanager
def session(  # noqa: PLR0913 - each is a choice of the command's
    arguments: syntax.Arguments,
    *,
    rehearse: bool = False,
    via: str | None = None,
    site: str | None = None,
    only: Sequence[str] | None = None,
    choose_hosts: Callable[[Inventory], tuple[Host, ...]] | None = None,
) -> Iterator[CommandSession]:
    """Load and validate the inventory, choose the hosts, and start emulators if requested; they end with the context.

    `site` and `only` come from the arguments, unless the command sets them otherwise. `choose_hosts` returns the hosts
    that take part, from the inventory and before anything is started, instead of `only`; it may return none. Between
    plays nothing is pending: a stop signal there leaves every device as in its last result. Raises CommandInterrupt.
    """
    changed_devices: list[str] = []
    try:
        # Whoever logs in to a device needs its password; emulated devices get those of the real ones.
        vault = vault_of(arguments)
        pilot_inventory = inventory.load(paths.inventory_folder(arguments.optional("inventory")), decrypt=vault.decrypt)
        if rehearse:
            pilot_inventory = replace(pilot_inventory, decrypt=None)  # emulated robots know no token that is vaulted
        if only is None:
            only = arguments.many("device") if arguments.command.word("device") else ()
        if site is None:
            site = arguments.word("site")
        if choose_hosts is None:
            hosts = inventory.choose(pilot_inventory, site, only)
            require_handled(hosts, only, arguments.command.name)
        else:
            hosts = choose_hosts(pilot_inventory)
        if not rehearse:
            _warn_of_damage(hosts)
        with ExitStack() as stack:
            emulators = None
            if rehearse:
                from atlantis_netcfg.operations.common.rehearsal import rehearsal

                replay = _replay(arguments, hosts)
                with output.progress(quiet=arguments.flag(syntax.JSON.name)) as notify:
                    emulators = stack.enter_context(rehearsal(pilot_inventory, hosts, via, notify, replay))
            elif arguments.has_flag(syntax.PROFILE):
                raise errors.UsageError(
                    "`--profile` applies to rehearsals only: a real link cannot be emulated", hint="add --rehearse"
                )
            yield CommandSession(
                arguments,
                pilot_inventory,
                site,
                hosts,
                emulators,
                paths.state_dir(),
                vault,
                via,
                changed_devices=changed_devices,
            )
    except KeyboardInterrupt as stop:
        if not arguments.command.plays:
            raise
        raise output.CommandInterrupt(stop, changed_devices) from stop


def _warn_of_damage(hosts: Sequence[Host]) -> None:
    """Warn about damaged journals on stderr: data that a command reads from earlier runs may be missing."""
    store = Store(paths.state_dir())
    for site in sorted({host.site for host in hosts} & {*store.sites()}):
        if damage := store.damage_since(site):
            print(translate(f"warning: {arg(damage)}"), file=sys.stderr, flush=True)


def _replay(arguments: syntax.Arguments, hosts: Sequence[Host]) -> Replay | None:
    """Return the run that is replayed instead of a link in the inventory, and print this. Raises UsageError."""
    if not arguments.has_flag(syntax.PROFILE):
        return None
    from atlantis_netcfg.operations.common.link_shapes import open_replay

    roots = [Store(paths.state_dir(), is_rehearsal=is_rehearsal).root for is_rehearsal in (False, True)]
    replay = open_replay(
        arguments.value(syntax.PROFILE.name) or "", roots, tuple(dict.fromkeys(host.site for host in hosts))
    )
    if not arguments.flag(syntax.JSON.name):
        print(translate(replay.words), flush=True)
    return replay


def require_handled(hosts: tuple[Host, ...], only: Sequence[str], command: str) -> None:
    """Raise an error if no host has a role, or if a host given by name would be skipped.

    Some commands also handle hosts that the engine does not.
    """
    also = [is_other_lte_unit] if command in {DEFAULT, "plan", "links"} else []
    if command in {DEFAULT, "plan", "links", "report drift"}:
        also.append(is_terminal)
    if command in {DEFAULT, "plan", "report drift"}:
        also.append(is_computer)
    passed_over = [host for host in hosts if not any(takes(host) for takes in (is_supported, *also))]
    named_hosts = [
        msg(f"{arg(host.name)} ({arg(host.device.kind.replace('_', ' '))})")
        for host in passed_over
        if host.name in only
    ]
    if named_hosts and len(passed_over) < len(hosts):
        raise errors.NoMatchError(
            f"`provision {arg(command)}` does not apply to {arg(join(', ', named_hosts))}",
            hint="remove it from `device=`",
        )
    if len(passed_over) == len(hosts):
        kinds = join(", ", sorted({host.device.kind.replace("_", " ") for host in hosts}))
        raise errors.NoMatchError(f"nothing to do: these devices are not supported yet ({arg(kinds)})")
