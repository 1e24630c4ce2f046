"""Commands for temporary robots: `robot invite`, `robot dismiss`.

`provision robot invite`: add a future partner's robot to the inventory, give it VPN access until its last day, and
generate its profiles.

`provision robot dismiss`: revoke its VPN access, remove its entry and files, and verify that nothing is left.
"""

from __future__ import annotations

from contextlib import contextmanager, nullcontext
from typing import TYPE_CHECKING

from atlantis_netcfg.cli.base import syntax
from atlantis_netcfg.cli.base.passphrase import PASSPHRASE_FD
from atlantis_netcfg.cli.vpn._common import AUTHORITY, CLOCK, NO_PUSH
from atlantis_netcfg.core.language import translate
from atlantis_netcfg.core.messages import arg, join, msg

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from contextlib import AbstractContextManager

    from atlantis_netcfg.core.errors import ExitCode
    from atlantis_netcfg.inventory import Inventory
    from atlantis_netcfg.operations.guests import GuestEntry
    from atlantis_netcfg.operations.vpn.server import DeployResult
    from atlantis_netcfg.vpn.authority.authority import Authority
    from atlantis_netcfg.vpn.authority.model import EnrolmentRequest
    from atlantis_netcfg.vpn.identity import Member
    from atlantis_netcfg.vpn.requests import DeviceWords

_AGAIN = "recorded changes remain: run the same command again, or undo all with `provision robot dismiss name=NAME`"
_PLAN = syntax.Flag("plan", "only show the steps", harmless=True)

GUEST_ADD = syntax.CommandSpec(
    "robot invite",
    "add a visiting robot: inventory, checklist, VPN, DDS",
    words=(
        syntax.Word("name", "its name in the inventory and in the VPN", is_required=True, example="lauv"),
        syntax.Word("partner", "owner of the robot", is_required=True, example="iqua"),
        syntax.Word("kind", "type of robot", is_required=True, choices=("auv", "asv", "uav", "rov")),
        syntax.Word(
            "until",
            "last day of its visit and of its certificates",
            is_required=True,
            example="2026-12-31",
        ),
        syntax.Word("site", "test site", is_required=True, many=True, example="coastal"),
        syntax.Word(
            "cells",
            "its equipment",
            is_required=True,
            many=True,
            choices=("wifi", "acoustic", "satellite", "usbl", "rc_rf", "4g", "gps", "ethernet"),
        ),
        syntax.Word("title", "display name (default: its name)", example="LAUV"),
        syntax.Word("link", "slowest link: fibre (default), 4g, satellite", example="satellite"),
        syntax.Word("distribution", "ROS 2: foxy, humble or jazzy (default: the pilot's)", example="humble"),
        syntax.Word("openvpn", "OpenVPN: 2.4 to 2.7 (default: from its ROS 2)", example="2.6"),
        syntax.Word("recipient", "encrypt to this age key (or file), not with a passphrase"),
        syntax.Word("contact", "contact of the owner, for the instructions page", example="'Ana, +351 210 000 000'"),
        syntax.Word("to", "also copy the file to this folder", example="/media/usb"),
        CLOCK,
        AUTHORITY,
        syntax.INVENTORY,
    ),
    flags=(_PLAN, NO_PUSH, PASSPHRASE_FD, syntax.JSON),
    details=(
        "Writes only guests.yml of the inventory. A person confirms the equipment until `endpoints` are set. "
        "Repeating the command completes an interrupted run. Exit code 2: `--plan` found changes."
    ),
    changes=True,
    again=_AGAIN,
)


def run_guest_add(arguments: syntax.Arguments) -> ExitCode:
    """Run `robot invite`: validate, write, issue, generate, update the server. Raises SiteBusy if another one runs."""
    with _guest_lock(arguments):
        return _add(arguments)


def _add(arguments: syntax.Arguments) -> ExitCode:
    from atlantis_netcfg.cli.vpn import _common, members
    from atlantis_netcfg.operations import guests
    from atlantis_netcfg.operations.common import inventory_files
    from atlantis_netcfg.vpn.members import Onboarding, refuse_example_authority
    from atlantis_netcfg.vpn.recipients import recipients_of
    from atlantis_netcfg.vpn.requests import request_of

    before, entry = _common.load_inventory(arguments), _entry(arguments)
    text, inventory = _declared_with(before, entry)
    words = _device(arguments, entry)
    request = request_of(inventory, words)
    target = members.package_target(arguments, recipients_of([words], [request.name]))
    refuse_example_authority(inventory, is_explicit=arguments.optional("authority") is not None)
    authority = _common.open_authority(arguments)
    server = _common.server(arguments, inventory)
    onboarding = Onboarding(inventory, _common.operator(arguments, authority), target)
    packages = onboarding.find_existing([request])
    if arguments.flag("plan"):
        return _tell_plan(arguments, _steps_of_add(entry, request, is_declared=text is None, member=bool(packages)))
    if not packages:
        from atlantis_netcfg.cli.base.passphrase import passphrase_prompt

        passphrase = passphrase_prompt(arguments)
        members.hold(arguments, server, authority)
        with _declared_until_issued(before, entry.name, authority, text):
            packages = onboarding.issue([request], passphrase)
    elif text is not None:
        inventory_files.write(before.root, guests.FILE, text)
    _print_lines(arguments, _lines_of_add(entry, already=text is None))
    more = {"guest": entry.name, "declared": guests.FILE, "until": entry.until, "sites": list(entry.sites)}
    return members.close(arguments, inventory, packages, server, authority, more=more)


def _guest_lock(arguments: syntax.Arguments) -> AbstractContextManager[object]:
    """Return the lock for changes of guests on this computer, so that two commands do not overwrite each other."""
    if arguments.flag("plan"):
        return nullcontext()
    from atlantis_netcfg.core import paths
    from atlantis_netcfg.runs import SiteLock

    command = f"provision {arguments.command.name} name={arguments.word('name')}"
    return SiteLock(paths.state_dir() / "guests.lock", "the guest file", command)


def _entry(arguments: syntax.Arguments) -> GuestEntry:
    """Parse the arguments. Raises UsageError for an invalid name or day; the rest is validated with the inventory."""
    from datetime import date

    from atlantis_netcfg.core.errors import UsageError
    from atlantis_netcfg.operations.guests import GuestEntry
    from atlantis_netcfg.vpn.names import check_name

    name, until = check_name(arguments.word("name"), "name"), arguments.word("until")
    try:
        day = date.fromisoformat(until).isoformat()
    except ValueError:
        raise UsageError(
            f"`until={arg(until)}` is not a date", hint="year, month and day, for example `until=2026-12-31`"
        ) from None
    return GuestEntry(
        name=name,
        title=arguments.optional("title") or name,
        kind=arguments.word("kind"),
        partner=arguments.word("partner"),
        until=day,
        sites=tuple(dict.fromkeys(arguments.many("site"))),
        cells=tuple(dict.fromkeys(arguments.many("cells"))),
        distribution=arguments.optional("distribution"),
        openvpn=arguments.optional("openvpn"),
    )


def _declared_with(before: Inventory, entry: GuestEntry) -> tuple[str | None, Inventory]:
    """Return the file that adds the guest, and the inventory with it; no file if the guest is there already.

    Raises UsageError for another vehicle or guest of that name, InventoryInvalid for data that do not fit the
    inventory.
    """
    from atlantis_netcfg.core.errors import UsageError
    from atlantis_netcfg.operations import guests
    from atlantis_netcfg.operations.common import inventory_files

    there = guests.declared_guest(before, entry.name)
    if there is None:
        _refuse_unknown(before, entry)
        text = guests.with_guest(guests.text_of(before.root), entry)
        return text, inventory_files.validate_change(before.root, guests.FILE, text)
    if not entry.same(there):
        hint = msg(f"`provision robot dismiss name={arg(entry.name)}` removes it; or correct {arg(guests.FILE)}")
        raise UsageError(f"the guest `{arg(entry.name)}` is already in the inventory, with other values", hint=hint)
    return None, before


def _refuse_unknown(inventory: Inventory, entry: GuestEntry) -> None:
    """Raise an error for an unknown argument value, before it would be reported as a line of a file."""
    from atlantis_netcfg.core.errors import UsageError
    from atlantis_netcfg.inventory.findings import suggest

    for word, values, names in (
        ("partner", (entry.partner,), inventory.partners),
        ("site", entry.sites, inventory.sites),
    ):
        for each in values:
            if each not in names:
                hint = suggest(each, names, none=msg(f"add the {arg(word)} to the inventory first"))
                raise UsageError(f"`{arg(word)}={arg(each)}`: no such {arg(word)}", hint=hint)


def _device(arguments: syntax.Arguments, entry: GuestEntry) -> DeviceWords:
    """Return the same data as the arguments of `vpn onboard`."""
    from atlantis_netcfg.vpn.requests import DeviceWords

    return DeviceWords(
        partner=entry.partner,
        device=entry.name,
        kind="robot",
        vehicle=entry.name,
        link=arguments.optional("link"),
        distribution=entry.distribution,
        openvpn=entry.openvpn,
        recipient=arguments.optional("recipient"),
    )


@contextmanager
def _declared_until_issued(before: Inventory, name: str, authority: Authority, text: str | None) -> Iterator[None]:
    """Add the guest to the inventory; undo this if nothing was issued for it, as after a wrong passphrase."""
    from atlantis_netcfg.operations import guests
    from atlantis_netcfg.operations.common import inventory_files

    old = guests.text_of(before.root)
    if text is not None:
        inventory_files.write(before.root, guests.FILE, text)
    try:
        yield
    except BaseException:
        if text is not None and not any(member.good for member in guests.members_of(authority, name)):
            inventory_files.write(before.root, guests.FILE, old)
        raise


def _steps_of_add(entry: GuestEntry, request: EnrolmentRequest, *, is_declared: bool, member: bool) -> list[str]:
    from atlantis_netcfg.operations.guests import FILE

    steps = []
    if not is_declared:
        cells = join(", ", entry.cells)
        steps.append(
            msg(f"add {arg(entry.name)} to {arg(FILE)}: {arg(cells)}, tested at {arg(join(', ', entry.sites))}")
        )
    if not member:
        steps.append(
            msg(f"give {arg(request.name)} VPN access for {arg(request.days)} days: its last day is {arg(entry.until)}")
        )
        steps.append("create one encrypted file with its VPN and DDS profiles")
    return steps


def _tell_plan(arguments: syntax.Arguments, steps: Sequence[str]) -> ExitCode:
    """Print what would be done; nothing was changed."""
    from atlantis_netcfg.cli.vpn import _common
    from atlantis_netcfg.core.errors import ExitCode

    code = ExitCode.CHANGES if steps else ExitCode.DONE
    lines = [msg(f"would {arg(step)}") for step in steps] or ["nothing to do: already complete"]
    return _common.tell(arguments, code, {"plan": list(steps)}, lines)


def _lines_of_add(entry: GuestEntry, *, already: bool) -> list[str]:
    from atlantis_netcfg.operations.guests import FILE

    how = "already in" if already else "added to"
    checks = [
        msg(f"  its checklist: provision check site={arg(site)} vehicle={arg(entry.name)}") for site in entry.sites
    ]
    return [msg(f"{arg(entry.name)}: {arg(how)} {arg(FILE)}, a guest until {arg(entry.until)}"), *checks]


def _print_lines(arguments: syntax.Arguments, lines: Sequence[str]) -> None:
    from atlantis_netcfg.core import printable

    for line in () if arguments.flag("json") else lines:
        print(printable.line(translate(line)), flush=True)


GUEST_END = syntax.CommandSpec(
    "robot dismiss",
    "remove a visiting robot from VPN and inventory, and verify",
    words=(
        syntax.Word("name", "the guest", is_required=True, example="lauv"),
        syntax.Word("reason", "reason for the record (default: `its stay has ended`)"),
        CLOCK,
        AUTHORITY,
        syntax.INVENTORY,
    ),
    flags=(_PLAN, syntax.Flag("yes", "do not ask before revoking its access"), NO_PUSH, PASSPHRASE_FD, syntax.JSON),
    details=(
        "Signed checklists and the VPN record are kept. Exit code 5: all is recorded and removed here, but the "
        "server is not updated yet; connected devices stay connected until `provision vpn sync`."
    ),
    changes=True,
    again="recorded changes remain: run the same command again, or check with `provision vpn status`",
)


def run_guest_end(arguments: syntax.Arguments) -> ExitCode:
    """Run `robot dismiss`: ask, revoke, remove the entry, update the server, verify. Raises SiteBusy if locked."""
    with _guest_lock(arguments):
        return _end(arguments)


def _end(arguments: syntax.Arguments) -> ExitCode:
    from atlantis_netcfg.cli.vpn import _common
    from atlantis_netcfg.core.atomic_files import remove_orphans
    from atlantis_netcfg.operations import guests
    from atlantis_netcfg.operations.common import inventory_files
    from atlantis_netcfg.operations.vpn.server import DeployResult
    from atlantis_netcfg.vpn.members import reason_of

    before, name = _common.load_inventory(arguments), arguments.word("name")
    reason = reason_of(arguments.optional("reason") or "its stay has ended")
    guest, authority = guests.declared_guest(before, name), _common.open_authority(arguments)
    members = guests.members_of(authority, name)
    if not arguments.flag("plan"):
        remove_orphans(before.root / guests.FILE)
    if guest is None and not members:
        raise guests.unknown(before, name)
    text = guests.without_guest(guests.text_of(before.root) or "", name) if guest is not None else None
    after = inventory_files.validate_change(before.root, guests.FILE, text) if guest is not None else before
    due = _to_revoke(authority, members)
    steps = [msg(f"revoke the VPN access of {arg(member.name)} permanently") for member in due]
    steps += [msg(f"remove {arg(name)} from {arg(guests.FILE)}")] if guest is not None else []
    robot = guests.robot_file(before.root, name)
    steps += [msg(f"remove {arg(robot.parent.name)}/{arg(robot.name)}")] if robot.exists() else []
    if arguments.flag("plan"):
        return _tell_plan(arguments, steps)
    if steps:
        _agree(arguments, name, steps)
    deployment = _put_out(arguments, after, authority, due, reason) if due else DeployResult()
    if guest is not None:
        inventory_files.write(before.root, guests.FILE, text)
    robot.unlink(missing_ok=True)
    guests.remove_packages(authority, members)
    leftovers = guests.left_over(before.root, authority, name)
    return _tell_end(arguments, members, deployment, leftovers, already=not steps)


def _to_revoke(authority: Authority, members: Sequence[Member]) -> tuple[Member, ...]:
    """Return the members in the VPN, and those whose removal the server has not confirmed."""
    queued_names = set(authority.membership().queued_names)
    return tuple(
        member
        for member in members
        if member.good or any(certificate.common_name in queued_names for certificate in member.certificates)
    )


def _agree(arguments: syntax.Arguments, name: str, steps: Sequence[str]) -> None:
    """Show what will be done, and ask for consent. Raises ConsentRefusal, UsageError."""
    from atlantis_netcfg.cli.base.consent import require_agreement

    if not arguments.flag("yes"):
        _print_lines(arguments, [f"  {step}" for step in steps])
        require_agreement(msg(f"End the visit of {arg(name)} now?"))


def _put_out(
    arguments: syntax.Arguments, after: Inventory, authority: Authority, members: Sequence[Member], reason: str
) -> DeployResult:
    """Record the revocation, and make the server reject the members."""
    from atlantis_netcfg.cli.base.output import progress
    from atlantis_netcfg.cli.base.passphrase import passphrase_prompt
    from atlantis_netcfg.cli.vpn import _common
    from atlantis_netcfg.cli.vpn.members import hold
    from atlantis_netcfg.vpn.members import revoke

    server, passphrase = _common.server(arguments, after), passphrase_prompt(arguments)
    hold(arguments, server, authority)
    revocation = revoke(_common.operator(arguments, authority), members, reason, passphrase)
    with progress(quiet=arguments.flag("json")) as notify:
        return server.disconnect(authority, revocation, notify)


def _tell_end(
    arguments: syntax.Arguments,
    members: Sequence[Member],
    deployment: DeployResult,
    leftovers: Sequence[str],
    *,
    already: bool,
) -> ExitCode:
    """Report the members removed, with the evidence, and the leftovers that were searched for."""
    from atlantis_netcfg.cli.vpn import _common
    from atlantis_netcfg.core.errors import ExitCode
    from atlantis_netcfg.operations.guests import GuestLeftOver

    name, errors = arguments.word("name"), list(deployment.errors)
    errors += [
        GuestLeftOver(f"parts of {arg(name)} are left: {arg(words)}", hint="remove it by hand") for words in leftovers
    ]
    lines = [msg(f"{arg(member.name)}: revoked") for member in members]
    if not leftovers:
        is_deployed = deployment.is_deployed
        how = "unchanged" if already else "ended" if is_deployed else "ended here; the server is not updated yet"
        lines.append(msg(f"{arg(name)}: {arg(how)}; not in the inventory, no valid certificate, no file left here"))
    values = {
        "guest": name,
        "members": [member.name for member in members],
        "left": list(leftovers),
        **deployment.as_json(),
    }
    code = max((error.exit for error in errors), default=ExitCode.DONE)
    return _common.tell(arguments, code, values, [*lines, *deployment.lines], errors)
