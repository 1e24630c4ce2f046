"""Commands that change the members of the VPN: `vpn onboard`, `vpn renew`, `vpn revoke`, `vpn accept`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from atlantis_netcfg.cli.base import syntax
from atlantis_netcfg.cli.base.passphrase import PASSPHRASE_FD
from atlantis_netcfg.cli.vpn._common import AGAIN, AUTHORITY, CLOCK, NO_PUSH
from atlantis_netcfg.core.language import translate
from atlantis_netcfg.core.messages import arg, join, msg

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence
    from pathlib import Path

    from atlantis_netcfg.core.errors import ExitCode
    from atlantis_netcfg.core.secret import Secret
    from atlantis_netcfg.inventory import Inventory
    from atlantis_netcfg.operations.vpn.server import DeployResult, Server
    from atlantis_netcfg.vpn.authority.authority import Authority
    from atlantis_netcfg.vpn.authority.model import RevocationResult
    from atlantis_netcfg.vpn.identity import Member, MembershipList
    from atlantis_netcfg.vpn.members import DeliveredMember, PackageTarget
    from atlantis_netcfg.vpn.requests import DeviceWords


_CLIENT = (
    syntax.Word(
        "system",
        "laptop: linux, ubuntu-desktop, windows, macos, android, ios (default: all); router: routeros",
        example="windows",
    ),
    syntax.Word(
        "distribution",
        "ROS 2: foxy, humble or jazzy (default: from the inventory)",
        example="foxy",
    ),
    syntax.Word(
        "openvpn",
        "2.4, 2.5, 2.6 or 2.7 (default: inventory, or from ROS 2)",
        example="2.4",
    ),
)

VPN_ONBOARD = syntax.CommandSpec(
    "vpn onboard",
    "add a device: address, certificate, enrolment package",
    words=(
        syntax.Word("partner", "owner of the device", example="iqua"),
        syntax.Word(
            "device",
            "its name; without `partner=`: a computer of the inventory",
            example="sparus2",
        ),
        syntax.Word("kind", "robot, laptop or router", example="robot"),
        syntax.Word("batch", "list of devices, .yml or .csv, with these argument names", example="iqua.yml"),
        syntax.Word("vehicle", "key in vehicles.yml (default: the device name)"),
        syntax.Word("link", "slowest link: fibre (default), 4g, satellite", example="satellite"),
        *_CLIENT,
        syntax.Word("wrap", "tls-crypt-v2, or tls-crypt for 2.4 (default: by OpenVPN)"),
        syntax.Word("key", "ec (default) or rsa; routers get rsa", example="rsa"),
        syntax.Word("days", "validity of the certificate (default: 397)", example="90"),
        syntax.Word("address", "fixed address in the partner's pool (default: next free)"),
        syntax.Word("recipient", "encrypt to this age key (or file), not with a passphrase"),
        syntax.Word("contact", "contact of the owner, for the instructions page", example="'Ana, +351 210 000 000'"),
        syntax.Word("to", "also copy the file to this folder", example="/media/usb"),
        CLOCK,
        AUTHORITY,
        syntax.INVENTORY,
    ),
    flags=(NO_PUSH, PASSPHRASE_FD, syntax.JSON),
    details=("Exit code 5: the server is not updated yet: run `provision vpn sync`."),
    changes=True,
    again=AGAIN,
)


def run_vpn_onboard(arguments: syntax.Arguments) -> ExitCode:
    """Run `vpn onboard`: validate, issue, hand over the enrolment packages, update the server."""
    from atlantis_netcfg.cli.base.passphrase import passphrase_prompt
    from atlantis_netcfg.cli.vpn import _common
    from atlantis_netcfg.vpn.members import Onboarding, refuse_example_authority
    from atlantis_netcfg.vpn.recipients import recipients_of
    from atlantis_netcfg.vpn.requests import requests_of

    inventory, device_words = _common.load_inventory(arguments), _device_words(arguments)
    requests = requests_of(inventory, device_words)
    target = package_target(arguments, recipients_of(device_words, [request.name for request in requests]))
    refuse_example_authority(inventory, is_explicit=arguments.optional("authority") is not None)
    authority = _common.open_authority(arguments)
    server = _common.server(arguments, inventory)
    onboarding = Onboarding(inventory, _common.operator(arguments, authority), target)
    packages = onboarding.find_existing(requests)
    passphrase = passphrase_prompt(arguments) if not packages else None
    hold(arguments, server, authority)
    if passphrase is not None:
        packages = onboarding.issue(requests, passphrase)
    return close(arguments, inventory, packages, server, authority)


def _device_words(arguments: syntax.Arguments) -> Sequence[DeviceWords]:
    """Return the requested devices, from the arguments or from a file. Raises UsageError, ListInvalid."""
    from pathlib import Path

    from atlantis_netcfg.core.errors import UsageError
    from atlantis_netcfg.inventory.lists import read
    from atlantis_netcfg.vpn.requests import KEYS, DeviceWords

    words = {key: arguments.optional(key) for key in KEYS}
    batch = arguments.optional("batch")
    if batch is None:
        return [DeviceWords("", **words)]
    if extra_words := [key for key, value in words.items() if value is not None and key != "recipient"]:
        raise UsageError(
            f"`{arg(extra_words[0])}=` cannot be used with `batch=`", hint="write it into the file, for each device"
        )
    common = {key: value for key, value in words.items() if value is not None}
    rows = read(Path(batch), KEYS)
    return [DeviceWords(**{**common, **row.values, "place": row.place}) for row in rows]


VPN_RENEW = syntax.CommandSpec(
    "vpn renew",
    "renew certificates; the old one works until the new is used",
    words=(
        syntax.Word("name", "the member", example="iqua-sparus2"),
        syntax.Word("all", "every member whose certificate expires within this time", example="30d"),
        syntax.Word("days", "validity of the new certificate (default: 397)", example="90"),
        *_CLIENT,
        syntax.Word("wrap", "tls-crypt-v2 or tls-crypt (default: as before if possible)"),
        syntax.Word("key", "ec or rsa (default: as before)"),
        syntax.Word("link", "slowest link of its tunnel (default: as before)"),
        syntax.Word("recipient", "encrypt to this age key (or file), not with a passphrase"),
        syntax.Word("contact", "contact of the owner, for the instructions page", example="'Ana, +351 210 000 000'"),
        syntax.Word("to", "also copy the file to this folder", example="/media/usb"),
        CLOCK,
        AUTHORITY,
        syntax.INVENTORY,
    ),
    flags=(NO_PUSH, PASSPHRASE_FD, syntax.JSON),
    details="An earlier renewal that was delivered but never used is revoked: only one can be pending.",
    changes=True,
    again=AGAIN,
)


def run_vpn_renew(arguments: syntax.Arguments) -> ExitCode:
    """Run `vpn renew`: choose the members, issue, hand over the enrolment packages, update the server."""
    from atlantis_netcfg.cli.base.passphrase import passphrase_prompt
    from atlantis_netcfg.cli.vpn import _common
    from atlantis_netcfg.vpn.members import Onboarding, refuse_example_authority
    from atlantis_netcfg.vpn.recipients import recipient_of
    from atlantis_netcfg.vpn.requests import change_for, change_of

    inventory = _common.load_inventory(arguments)
    words = ("days", "wrap", "key", "link", "system", "distribution", "openvpn")
    change = change_of(**{key: arguments.optional(key) for key in words})
    recipient_text = arguments.optional("recipient")
    recipient = recipient_of(recipient_text) if recipient_text is not None else None
    refuse_example_authority(inventory, is_explicit=arguments.optional("authority") is not None)
    authority = _common.open_authority(arguments)
    members = _members_to_renew(arguments, authority.membership())
    openvpn = arguments.optional("openvpn")
    renewals = [(member, change_for(inventory, member, change, openvpn)) for member in members]
    target = package_target(arguments, {} if recipient is None else {member.name: recipient for member in members})
    server = _common.server(arguments, inventory)
    onboarding = Onboarding(inventory, _common.operator(arguments, authority), target)
    passphrase = passphrase_prompt(arguments)
    hold(arguments, server, authority)
    packages = onboarding.renew(renewals, passphrase)
    return close(arguments, inventory, packages, server, authority)


def _members_to_renew(arguments: syntax.Arguments, membership: MembershipList) -> tuple[Member, ...]:
    from datetime import UTC, datetime

    from atlantis_netcfg.core.errors import NoMatchError, UsageError
    from atlantis_netcfg.vpn.reports import expires, find, period

    name, within = arguments.optional("name"), arguments.optional("all")
    if (name is None) == (within is None):
        raise UsageError("no member to renew", hint="add `name=iqua-sparus2`, or `all=30d`")
    if name is not None:
        return (find(membership, name),)
    end = datetime.now(UTC) + period(str(within), "all")
    due = tuple(
        member for member in membership.members.values() if (last := expires(member)) is not None and last <= end
    )
    if not due:
        raise NoMatchError(
            f"no certificate expires within {arg(within)}", hint="`provision vpn list` shows the expiry dates"
        )
    return due


VPN_REVOKE = syntax.CommandSpec(
    "vpn revoke",
    "revoke members permanently and end their sessions",
    words=(
        syntax.Word("name", "the member", example="iqua-sparus2"),
        syntax.Word("partner", "every device of this partner", example="iqua"),
        syntax.Word("reason", "reason for the record, one line", example="stolen"),
        CLOCK,
        AUTHORITY,
        syntax.INVENTORY,
    ),
    flags=(syntax.Flag("yes", "do not ask before revoking access"), NO_PUSH, PASSPHRASE_FD, syntax.JSON),
    details=(
        "A name cannot be used again. Exit code 5: recorded, but the server did not respond; connected devices stay "
        "connected until `provision vpn sync` has updated it."
    ),
    changes=True,
    again=AGAIN,
)


def run_vpn_revoke(arguments: syntax.Arguments) -> ExitCode:
    """Run `vpn revoke`: ask, record, publish the CRL, end the sessions, verify."""
    from atlantis_netcfg.cli.base.output import progress
    from atlantis_netcfg.cli.base.passphrase import passphrase_prompt
    from atlantis_netcfg.cli.vpn import _common
    from atlantis_netcfg.vpn.members import reason_of, revoke

    inventory = _common.load_inventory(arguments)
    reason = reason_of(arguments.optional("reason"))
    authority = _common.open_authority(arguments)
    members = _members_to_revoke(arguments, authority.membership())
    server = _common.server(arguments, inventory)
    passphrase = passphrase_prompt(arguments)
    hold(arguments, server, authority)
    _agree(arguments, members)
    revocation = revoke(_common.operator(arguments, authority), members, reason, passphrase)
    with progress(quiet=arguments.flag("json")) as notify:
        cut = server.disconnect(authority, revocation, notify)
    return close_revoked(arguments, revocation, cut)


def _members_to_revoke(arguments: syntax.Arguments, membership: MembershipList) -> tuple[Member, ...]:
    from atlantis_netcfg.core.errors import UsageError
    from atlantis_netcfg.vpn.reports import find, of_partner

    name, partner = arguments.optional("name"), arguments.optional("partner")
    if (name is None) == (partner is None):
        raise UsageError("no member to revoke", hint="add `name=iqua-sparus2`, or `partner=iqua` for all its devices")
    return (find(membership, name),) if name is not None else of_partner(membership, partner)


def _agree(arguments: syntax.Arguments, members: tuple[Member, ...]) -> None:
    """Show what will be revoked, and ask for consent. Raises ConsentRefusal, UsageError."""
    from atlantis_netcfg.cli.base.consent import require_agreement
    from atlantis_netcfg.vpn.reports import when

    if arguments.flag("yes") or not any(member.good for member in members):
        return
    if not arguments.flag("json"):
        for member in members:
            last_seen = max(
                (certificate.seen for certificate in member.certificates if certificate.seen is not None), default=None
            )
            print(
                translate(
                    f"  {arg(member.name)}: {arg(member.kind)}, {arg(member.address)}, last seen {arg(when(last_seen))}"
                ),
                flush=True,
            )
    require_agreement(
        msg("Revoke them permanently now?" if len(members) > 1 else f"Revoke {arg(members[0].name)} permanently now?")
    )


VPN_ACCEPT = syntax.CommandSpec(
    "vpn accept",
    "store a computer's identity from its enrolment package",
    words=(
        syntax.Word("file", "the encrypted enrolment package", is_required=True, example="coastal-gateway.tar.age"),
        syntax.Word("key", "file (mode 0600) with your age key, if encrypted to it", example="age.key"),
        AUTHORITY,
        syntax.INVENTORY,
    ),
    flags=(PASSPHRASE_FD, syntax.JSON),
    details=(
        "For a laptop without the authority: the identity is stored in the authority folder, in `hosts`, mode 0600."
    ),
)
_LARGEST = 1_000_000


def run_vpn_accept(arguments: syntax.Arguments) -> ExitCode:
    """Run `vpn accept`: open an enrolment package, verify it, store it."""
    from datetime import UTC, datetime
    from pathlib import Path

    from atlantis_netcfg.cli.vpn import _common
    from atlantis_netcfg.core.errors import ExitCode
    from atlantis_netcfg.vpn.enrolment_package import accept

    inventory = _common.load_inventory(arguments)
    data = _read_limited(Path(arguments.word("file")), "the enrolment package")
    acceptance = accept(inventory, data, _opener(arguments), _common.folder(arguments), now=datetime.now(UTC))
    member, certificate = acceptance.identity.member, acceptance.identity.certificate
    values = {
        "name": member.name,
        "common_name": certificate.common_name,
        "address": str(member.address),
        "not_after": certificate.not_after.isoformat(timespec="seconds"),
        "file": str(acceptance.path),
        "already": acceptance.already,
    }
    how = "unchanged" if acceptance.already else "accepted"
    lines = [
        msg(
            f"{arg(member.name)}: {arg(how)}, address {arg(member.address)}, valid until "
            f"{arg(certificate.not_after):%Y-%m-%d}"
        ),
        msg(
            f"  saved in {arg(acceptance.path)}; `{arg(install_command(inventory, member))}` installs it on the device"
        ),
    ]
    return _common.tell(arguments, ExitCode.DONE, values, lines)


def _opener(arguments: syntax.Arguments) -> Secret:
    """Return the key from its file, or the passphrase."""
    from pathlib import Path

    from atlantis_netcfg.cli.base.passphrase import passphrase_prompt
    from atlantis_netcfg.core.errors import UsageError
    from atlantis_netcfg.core.secret import Secret

    key_name = arguments.optional("key")
    if key_name is None:
        return passphrase_prompt(arguments, "the passphrase of the hand-out")()
    path = Path(key_name)
    text = _read_limited(path, "the key").decode(errors="replace")
    if path.stat().st_mode & 0o077:
        raise UsageError(f"other users can read the key {arg(path)}", hint=f"type `chmod 600 {arg(path)}`")
    lines = [line.strip() for line in text.splitlines() if line.startswith("AGE-SECRET-KEY-")]
    if len(lines) != 1:
        raise UsageError(f"{arg(path)} contains {arg(len(lines))} age keys", hint="give the file created by age-keygen")
    return Secret(lines[0])


def _read_limited(path: Path, what: str) -> bytes:
    from atlantis_netcfg.core.errors import UsageError

    try:
        with path.open("rb") as file:
            data = file.read(_LARGEST + 1)
    except (OSError, ValueError) as error:
        raise UsageError(f"cannot read {arg(what)}: {arg(path)}", hint=getattr(error, "strerror", None)) from error
    if len(data) > _LARGEST:
        raise UsageError(f"{arg(path)} is too large for {arg(what)}")
    return data


def package_target(arguments: syntax.Arguments, recipients: Mapping[str, str]) -> PackageTarget:
    """Return where enrolment packages are written. Raises UsageError for an invalid folder or contact line."""
    from pathlib import Path

    from atlantis_netcfg.vpn.members import CONTACT, PackageTarget

    to, contact = arguments.optional("to"), arguments.optional("contact")
    return PackageTarget(recipients, Path(to) if to is not None else None, contact if contact is not None else CONTACT)


def hold(arguments: syntax.Arguments, server: Server, authority: Authority) -> None:
    """Check the record against the server, before anything is signed. Raises RecordOlder."""
    from atlantis_netcfg.cli.base.output import progress

    with progress(quiet=arguments.flag("json")) as notify:
        server.require_current_record(authority, notify)


def close(  # noqa: PLR0913 - one end of three commands
    arguments: syntax.Arguments,
    inventory: Inventory,
    packages: Sequence[DeliveredMember],
    server: Server,
    authority: Authority,
    *,
    more: Mapping[str, Any] | None = None,
) -> ExitCode:
    """Report what was issued, including one-time passphrases, then update the server and report that.

    A passphrase is printed before the server is contacted, so that it is not lost when the user stops the command.
    `more`: additional values for programs.
    """
    from atlantis_netcfg.cli.vpn import _common

    if not arguments.flag("json"):
        for line in (line for entry in packages for line in _lines(inventory, entry)):
            print(translate(line), flush=True)
    deployment = _deploy(arguments, server, authority)
    values = {**(more or {}), "members": [_row(item) for item in packages], **deployment.as_json()}
    return _common.tell(arguments, deployment.exit, values, deployment.lines, deployment.errors)


def _deploy(arguments: syntax.Arguments, server: Server, authority: Authority) -> DeployResult:
    from atlantis_netcfg.cli.base.output import progress
    from atlantis_netcfg.cli.vpn._common import AGAIN
    from atlantis_netcfg.core.errors import OutcomeUnknown
    from atlantis_netcfg.operations.vpn.server import DeployResult

    try:
        with progress(quiet=arguments.flag("json")) as notify:
            return server.deploy(authority, notify)
    except KeyboardInterrupt:
        error = OutcomeUnknown("interrupted by Ctrl-C before the server confirmed the update", hint=AGAIN)
        return DeployResult(errors=(error,), is_deployed=False)


def _row(package: DeliveredMember) -> dict[str, Any]:
    """Return a member for programs; `passphrase` is the only secret printed, and only this once."""
    from datetime import UTC, datetime

    from atlantis_netcfg.vpn.reports import member_row

    return {
        **member_row(package.result.member, datetime.now(UTC)),
        "common_name": package.result.certificate.common_name,
        "already": package.result.already,
        "replaced": list(package.result.replaced_names),
        "file": str(package.file),
        "copy": str(package.copy) if package.copy is not None else None,
        "cover_note": str(package.cover_note) if package.cover_note is not None else None,
        "sha256": package.result.file.sha256,
        "passphrase": package.passphrase.reveal() if package.passphrase is not None else None,
    }


def _lines(inventory: Inventory, package: DeliveredMember) -> Iterator[str]:
    member, certificate = package.result.member, package.result.certificate
    what = "unchanged" if package.result.already else certificate.common_name
    yield msg(
        f"{arg(member.name)}: {arg(what)}, address {arg(member.address)}, valid until "
        f"{arg(certificate.not_after):%Y-%m-%d}"
    )
    yield f"  file        {package.copy or package.file}"
    if package.result.already:
        yield msg(
            f"              created earlier; if its passphrase is lost: provision vpn renew name={arg(member.name)}"
        )
        return
    if package.cover_note is not None:
        yield msg(f"  cover note  {arg(package.cover_note)}")
        yield "              send it with the file; it contains no secrets"
    if package.passphrase is not None:
        yield f"  passphrase  {package.passphrase.reveal()}"
        yield "              shown only once: tell it by telephone, never in the message that carries the file"
    for old_name in package.result.replaced_names:
        yield msg(f"  revoked     {arg(old_name)}, which was delivered earlier and never used")
    if member.partner is None:
        yield msg(f"              `{arg(install_command(inventory, member))}` installs it on the device")
    else:
        yield "              the partner opens it with age and follows the enclosed README.txt"


def install_command(inventory: Inventory, member: Member) -> str:
    """Return the command that installs a member's identity on a computer in the inventory."""
    from atlantis_netcfg.vpn.identity import MemberKind

    if member.kind is MemberKind.ROUTER:
        return f"provision vpn install device={member.name}"
    return f"provision site={inventory.hosts[member.name].site} device={member.name}"


def close_revoked(arguments: syntax.Arguments, revocation: RevocationResult, deployment: DeployResult) -> ExitCode:
    """Report the revoked members, with the evidence."""
    from atlantis_netcfg.cli.vpn import _common

    values = {
        "members": list(revocation.members),
        "common_names": list(revocation.common_names),
        "already": list(revocation.already),
        **deployment.as_json(),
    }
    lines = [
        msg(f"{arg(name)}: {'unchanged' if name in revocation.already else 'revoked'}") for name in revocation.members
    ]
    return _common.tell(arguments, deployment.exit, values, [*lines, *deployment.lines], deployment.errors)


def close_synced(
    arguments: syntax.Arguments, deployment: DeployResult, site: str | None, taken_names: Sequence[str] | None = None
) -> ExitCode:
    """Report the server's update; `site` is the server's site, if its new certificate still has to be installed.

    `taken_names`: members revoked because the server's CRL was adopted.
    """
    from atlantis_netcfg.cli.vpn import _common

    values = {**deployment.as_json(), "server_certificate": site is not None, "taken": list(taken_names or ())}
    lines = (
        []
        if taken_names is None
        else [msg(f"imported from the server's list: {arg(join(', ', taken_names) or 'no member of the record')}")]
    )
    if site is not None:
        lines.append(msg(f"the server has a new certificate: `provision site={arg(site)}` installs it"))
    return _common.tell(arguments, deployment.exit, values, (*lines, *deployment.lines), deployment.errors)
