"""A request from the command line to Ansible: one JSON file in the extra variable `atlantis_request`."""

from __future__ import annotations

import json
import os
from contextlib import contextmanager, suppress
from dataclasses import asdict
from datetime import datetime
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from pydantic import AfterValidator, BaseModel, ConfigDict, Field

from atlantis_netcfg.core import errors, stored_messages
from atlantis_netcfg.core.crash_report import report_crash
from atlantis_netcfg.core.messages import arg, msg
from atlantis_netcfg.core.paths import require_own, state_dir
from atlantis_netcfg.inventory import Inventory, load
from atlantis_netcfg.inventory.examples import by_line

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping

    from atlantis_netcfg.core.events import Event

ACCEPT_COST = "atlantis_accept_cost"
"""Ansible extra variable by which a person accepts the cost: `-e atlantis_accept_cost=true`."""
REMOVE_FOREIGN = "atlantis_remove_foreign"
"""Ansible extra variable by which a person accepts that foreign rows are removed in bulk."""
REHEARSE_VARIABLE = "atlantis_rehearse"
"""Ansible extra variable that replaces the real devices by emulated ones."""
PLAIN_ANSIBLE = "ansible-playbook"
"""Command name in the journal of a run that was not started by `provision`."""


_REQUEST = "atlantis_request"
_BOOLEANS = {"true": True, "yes": True, "false": False, "no": False}
_FIELDS = {ACCEPT_COST: "accept_cost", REMOVE_FOREIGN: "remove_foreign", REHEARSE_VARIABLE: "rehearsed"}


def of_variables(variables: Mapping[str, object]) -> dict[str, Any]:
    """Return the request fields set by Ansible variables; raise UsageError for unknown or invalid ones."""
    from atlantis_netcfg.inventory.new_inventory.questions import validation_error  # noqa: PLC0415 - plain Ansible alone asks it

    for name in variables:
        if name.startswith("atlantis_") and name not in {_REQUEST, *_FIELDS}:
            suggestion = errors.nearest(name, (_REQUEST, *_FIELDS)) or ACCEPT_COST
            raise errors.UsageError(f"unknown extra variable `{arg(name)}`", hint=f"did you mean `{arg(suggestion)}`?")
    request = variables.get(_REQUEST) or {}
    if not isinstance(request, dict):
        raise errors.UsageError(
            f"{arg(_REQUEST)} is not a mapping: {arg(request)}", hint=f"type `-e '{{\"{arg(_REQUEST)}\": {{…}}}}'`"
        )
    for key, value in request.items():
        if key not in Request.model_fields:
            suggestion = errors.nearest(str(key), Request.model_fields) or "mode"
            raise errors.UsageError(
                f"{arg(_REQUEST)}: unknown key `{arg(key)}`", hint=f"did you mean `{arg(suggestion)}`?"
            )
        if (why := validation_error(Request, str(key), value)) is not None:
            raise errors.UsageError(f"{arg(_REQUEST)}: {arg(why)}")
    options = {}
    for name, field in _FIELDS.items():
        text = str(variables.get(name, "false"))
        if text.lower() not in _BOOLEANS:
            raise errors.UsageError(
                f"{arg(name)} is neither true nor false: {arg(text)}", hint=f"type `-e {arg(name)}=true`, or remove it"
            )
        if name in variables:
            options[field] = _BOOLEANS[text.lower()]
    return {**request, **options}


class Mode(StrEnum):
    """The operation on every device of the request."""

    PLAN = "plan"
    APPLY = "apply"
    RESUME = "resume"
    BACKUP = "backup"
    DRIFT = "drift"

    @property
    def reads_only(self) -> bool:
        """Whether the mode changes nothing, so that it needs neither the site's lock nor a journal."""
        return self in (Mode.PLAN, Mode.DRIFT)


class _Data(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class Target(_Data):
    """The real address and port of an emulated device."""

    host: str
    port: int
    pin: str = ""
    """SHA-256 of the device's certificate in hex; a gateway has none."""
    ssh: int | None = None
    """SSH port of the device's console."""
    host_key: str | None = None
    """The device's SSH host key, as OpenSSH prints it."""
    serial: str | None = None
    """Path of the device's serial port, if it has no other access."""
    known_hosts: str | None = None
    """For a gateway: file with its SSH host key."""
    identity: str | None = None
    """For a gateway: file with the private key for its login."""


class StandIns(_Data):
    """Replacements, in a rehearsal, for the servers from which a gateway downloads."""

    archive: str
    """URL of a signed archive with packages that have the names of ROS packages."""
    key: str
    """Public key of the archive, base64."""
    fingerprint: str
    codename: str
    """Codename of the operating system that the archive is for, and that the rehearsed gateways have."""
    distribution: str
    repositories: str
    """Base URL below which the last part of each declared repository's URL is served."""


class LinkOrder(_Data):
    """The order of `provision links use`: one link carries the site's traffic for a time, or its order returns."""

    link: str | None = None
    """None: the order in the inventory."""
    since_uptime_s: int = 0
    """The router's uptime when it was read."""
    until_uptime_s: int = 0
    until: datetime | None = None
    """End by this computer's clock."""
    proved: bool = True
    """Whether the link must carry the traffic at once; otherwise the change is rolled back."""


def _private_state(state: Path) -> Path:
    if state.exists():
        require_own(state, "use a folder of the current user: `atlantis_request.state`, or ATLANTIS_STATE")
    return state


class Request(_Data):
    """The parameters of a run that are not in the inventory."""

    state: Annotated[Path, AfterValidator(_private_state)] = Field(default_factory=state_dir)
    """Folder of journals, backups and pins."""
    mode: Mode = Mode.APPLY
    rehearsed: bool = False
    targets: dict[str, Target] = {}
    """Rehearsal: emulated device by host name; a device without one is not contacted."""
    standins: StandIns | None = None
    images: dict[str, dict[str, str]] = {}
    """Rehearsal: SHA-256 of the archive that replaces a service's image, by host name and service."""
    authority: Path | None = None
    """Folder of the VPN authority; None: the technician's own, below `state`. A rehearsal has a separate one."""
    via: dict[str, str] = {}
    """Link in use by host name, if it differs from the one in the inventory."""
    plans: dict[str, str] | None = None
    """Hash of the plan that a person has accepted, by host name; a different plan is not applied."""
    run: str | None = None
    """Name of the run to resume."""
    back_to: str | None = None
    """Restore the devices to their state before this run, instead of the inventory."""
    restore: str | None = None
    """Apply the state that this run has read back, instead of the inventory; the device may be a replacement."""
    use: LinkOrder | None = None
    """Apply another order of the router's links for a limited time, instead of the inventory."""
    offline: Path | None = None
    """Bundle from which gateways take all packages and sources; no other source is used."""
    unprotected: bool = False
    """A person has accepted changes to devices without automatic rollback."""
    prepares: bool = False
    """Rehearsal: configure new emulated devices before the command itself begins."""
    accept_cost: bool = False
    """A person has accepted traffic over metered links."""
    remove_foreign: bool = False
    """A person has accepted that foreign rows are removed in bulk from menus that the toolkit owns entirely."""
    events_fd: int | None = None
    """File descriptor for events, one JSON object per line."""
    command: str = PLAIN_ANSIBLE
    """Command that the technician typed, for the journal and the site lock."""

    @property
    def vpn(self) -> Path:
        """Folder of the VPN's authority, which may be missing; on a laptop without one it has only `hosts/`."""
        return self.authority if self.authority is not None else self.state / "vpn"

    def identity_of(self, host: str) -> Path | None:
        """Return the file of a host's identity in the VPN; None if this computer has none."""
        path = self.vpn / "hosts" / f"{host}.identity"
        return path if path.is_file() else None


class EventStream:
    """A writer of whole event lines; a closed reader does not stop a run, since the journal has everything."""

    def __init__(self, descriptor: int | None) -> None:
        self._descriptor = descriptor

    def event(self, event: Event) -> None:
        """Send an event of a device."""
        self._send({"event": asdict(event)})

    def outcome(self, devices: Mapping[str, Mapping[str, Any]], runs: Mapping[str, Mapping[str, str]]) -> None:
        """Send the results of devices; `runs` maps site to device kind (each has its own runs) to run id."""
        self._send({"devices": devices, "runs": runs})

    def error(self, error: errors.NetcfgError) -> None:
        """Send the error that refused the whole request."""
        self._send({"error": {"message": str(error), "hint": error.hint, "exit": int(error.exit)}})

    def _send(self, data: Mapping[str, Any]) -> None:
        if self._descriptor is None:
            return
        line = json.dumps(stored_messages.pack(data), ensure_ascii=False) + "\n"  # bytes that are no text arrive as `?`
        rest = memoryview(line.encode(errors="replace"))
        with suppress(BrokenPipeError):
            while rest:
                rest = rest[os.write(self._descriptor, rest) :]


_shared_inventories: dict[Path, Inventory] = {}


@contextmanager
def share_inventory(inventory: Inventory) -> Iterator[None]:
    """Let tasks of this process and its forks use this inventory instead of loading it again."""
    folder = inventory.root.absolute()
    _shared_inventories[folder] = inventory
    try:
        yield
    finally:
        del _shared_inventories[folder]


def open_inventory(inventory: Path, decrypt: Callable[[str], str] | None = None) -> Inventory:
    """Return the inventory of a folder: the shared one, or loaded now. Raise the errors of `load`."""
    return _shared_inventories.get(inventory.absolute()) or load(inventory, decrypt=decrypt)


@contextmanager
def open_request(request: Mapping[str, Any] | None, *, plan_only: bool) -> Iterator[tuple[Request, EventStream]]:
    """Yield the request and its event stream; errors within are sent there, internal ones also logged."""
    run_request = Request.model_validate(request or {})
    if plan_only and not run_request.mode.reads_only:
        run_request = run_request.model_copy(update={"mode": Mode.PLAN})
    channel = EventStream(run_request.events_fd)
    try:
        yield run_request, channel
    except errors.NetcfgError as error:
        channel.error(error)
        raise
    except Exception as fault:
        problem = report_crash(fault, run_request.command, lambda: run_request.state)
        channel.error(problem)
        raise problem from fault


_MAX_LINES = 3
"""Maximum number of lines with example values that a refusal lists; it gives the number of values."""


def refuse_examples(inventory: Inventory, *, is_rehearsal: bool) -> None:
    """Raise UsageError if real devices would be contacted while the inventory has example values."""
    if not inventory.pilot.example_values or is_rehearsal:
        return
    hint = msg(f"replace them and set `example_values: false` in group_vars/all/pilot.yml, or {arg(errors.REHEARSE)}")
    if inventory.examples:
        first = "\n".join(f"  {line}" for line in by_line(inventory.examples)[:_MAX_LINES])
        hint += msg(
            f"\n{arg(len(inventory.examples))} values are examples; `provision inventory validate --examples` lists "
            f"them:\n{arg(first)}"
        )
    raise errors.UsageError(
        "the inventory still contains example values, which match no real device: it is for rehearsals only",
        hint=hint,
    )
