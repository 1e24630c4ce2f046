"""Commands of first contact: `device adopt` a factory-fresh router, and `device trust` the certificate of a device.

`provision device adopt`: first contact with a router in factory state.

`provision device trust`: shows the identity of a site's devices to a person, who accepts or rejects it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from atlantis_netcfg.cli.base import syntax
from atlantis_netcfg.cli.base.output import json_text
from atlantis_netcfg.core.language import translate
from atlantis_netcfg.core.messages import arg, msg

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping
    from contextlib import AbstractContextManager

    from atlantis_netcfg.core.errors import ExitCode
    from atlantis_netcfg.core.events import Subscriber
    from atlantis_netcfg.core.secret import Secret
    from atlantis_netcfg.inventory import Host, Inventory
    from atlantis_netcfg.operations import Request
    from atlantis_netcfg.operations.adopt import Adoption, AdoptionResult
    from atlantis_netcfg.operations.trust import DeviceIdentity
    from atlantis_netcfg.routeros.first_contact.steps import AdoptionOutcome


ADOPT = syntax.CommandSpec(
    "device adopt",
    "prepare a factory-state router for `provision site=…`",
    words=(
        syntax.Word("site", "the site", is_required=True, example="coastal"),
        syntax.Word("device", "the router", is_required=True, example="coastal-router"),
        syntax.Word("via", "`ssh`, or the serial port of the router", example="serial:/dev/ttyUSB0"),
        syntax.Word("address", "current address, if not 192.168.88.1", example="192.168.88.1"),
        syntax.Word("password-file", "file (mode 0600) with the factory user's password", example="sticker.txt"),
        syntax.Word("wait", "seconds to wait for the laptop on the management port (600)", example="600"),
        syntax.INVENTORY,
    ),
    flags=(
        syntax.Flag("plan", "read the device and show the steps, change nothing", harmless=True),
        syntax.Flag("rehearse", "use an emulated router in factory state", harmless=True),
        syntax.Flag("take-over", "also a configured router; its export is saved first"),
        syntax.Flag("replaced", "replaced or reset device: forget its old certificate and host key"),
        syntax.Flag("yes", "do not ask before changing the router"),
        syntax.ASK_VAULT_PASS,
        syntax.JSON,
    ),
    details="If it is interrupted, run it again: it continues where it stopped.",
    changes=True,
    again="run the same command again: it checks the router's state and continues from there",
)


def run_adopt(arguments: syntax.Arguments) -> ExitCode:
    """Run `device adopt`: read the device, show the steps, ask for consent, adopt."""
    from contextlib import ExitStack

    from atlantis_netcfg.cli.base.output import progress

    inventory, host = _load_inventory(arguments)
    with ExitStack() as stack:
        notify = stack.enter_context(progress(quiet=arguments.flag("json")))
        adoption = _adoption(arguments, inventory, host, notify, stack.enter_context)
        if arguments.flag("plan"):
            return _print_result(arguments, adoption.plan())
        return _print_result(arguments, adoption.carry_out(_agreement_callback(arguments)))


def _load_inventory(arguments: syntax.Arguments) -> tuple[Inventory, Host]:

    from atlantis_netcfg.cli.base.passphrase import vault_of
    from atlantis_netcfg.core import paths
    from atlantis_netcfg.inventory import choose, load

    root = paths.inventory_folder(arguments.optional("inventory"))
    inventory = load(root, decrypt=vault_of(arguments).decrypt)
    (host,) = choose(inventory, arguments.word("site"), [arguments.word("device")])
    return inventory, host


def _adoption(
    arguments: syntax.Arguments,
    inventory: Inventory,
    host: Host,
    notify: Subscriber,
    enter: Callable[[AbstractContextManager[Any]], Any],
) -> Adoption:
    import shlex
    import sys

    from atlantis_netcfg.core import paths
    from atlantis_netcfg.operations.adopt import SSH, Adoption
    from atlantis_netcfg.routeros.first_contact.steps import FACTORY_ADDRESS

    adoption = Adoption(
        inventory,
        host,
        paths.state_dir(),
        shlex.join(["provision", *sys.argv[1:]]),
        notify,
        lambda: _passwords(arguments, host.name),
        via=_via(arguments.optional("via") or SSH),
        address=arguments.optional("address") or FACTORY_ADDRESS,
        is_rehearsal=arguments.flag("rehearse"),
        take_over=arguments.flag("take-over"),
        is_replacement=arguments.flag("replaced"),
        wait_s=_seconds(arguments.optional("wait")),
    )
    if adoption.is_rehearsal:
        from atlantis_netcfg.operations.common.rehearsal import rehearse_adoption

        enter(rehearse_adoption(adoption))
    return adoption


def _via(via: str) -> str:
    from atlantis_netcfg.core.errors import UsageError
    from atlantis_netcfg.operations.adopt import SERIAL, SSH

    if via != SSH and not (via.startswith(SERIAL) and via != SERIAL):
        raise UsageError(
            f"`via={arg(via)}` is not a valid way to reach a router", hint="type `via=ssh` or `via=serial:/dev/ttyUSB0`"
        )
    return via


def _seconds(text: str | None) -> float:
    from atlantis_netcfg.core.errors import UsageError

    if text is None:
        return 600.0
    if not text.isdecimal():
        raise UsageError(f"`wait={arg(text)}` is not a number of seconds", hint="type `wait=600`")
    return float(text)


def _passwords(arguments: syntax.Arguments, name: str) -> Iterator[Secret]:
    """Yield the factory user's password: from the file; or empty, and if that fails, one typed by the user."""
    import sys
    from getpass import getpass
    from pathlib import Path

    from atlantis_netcfg.core.secret import Secret

    file = arguments.optional("password-file")
    if file is not None:
        yield _read_secret_file(Path(file))
        return
    yield Secret("")
    if sys.stdin.isatty() and not arguments.flag("json"):
        yield Secret(getpass(msg(f"Password of the factory user on {arg(name)} (see its label): ")))


def _read_secret_file(path: Any) -> Secret:  # noqa: ANN401 - pathlib is imported by the command only
    from atlantis_netcfg.core.errors import UsageError
    from atlantis_netcfg.core.secret import Secret

    try:
        mode, text = path.stat().st_mode, path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise UsageError(f"cannot read the password file {arg(path)}", hint=getattr(error, "strerror", None)) from error
    if mode & 0o077:
        raise UsageError(f"other users can read the password file {arg(path)}", hint=f"type `chmod 600 {arg(path)}`")
    return Secret(text.rstrip("\r\n"))


def _agreement_callback(arguments: syntax.Arguments) -> Callable[[AdoptionOutcome], None]:
    def agree(adoption: AdoptionOutcome) -> None:
        from atlantis_netcfg.cli.base.consent import require_agreement

        if not arguments.flag("json"):
            _show(adoption.standing.value, adoption.steps)
        if not (arguments.flag("yes") or arguments.flag("rehearse")):
            require_agreement("Adopt the router now?")

    return agree


def _show(state: str, steps: tuple[str, ...]) -> None:
    from atlantis_netcfg.core import printable

    print(translate(f"the router is {arg(state)}; steps:"), flush=True)
    for number, step in enumerate(steps, start=1):
        print(translate(f"  {arg(number)}. {arg(printable.line(step))}"), flush=True)


def _print_result(arguments: syntax.Arguments, result: AdoptionResult) -> ExitCode:
    from atlantis_netcfg.core import printable

    if arguments.flag("json"):
        document: Mapping[str, Any] = {**result.as_json(), "errors": []}
        print(json_text(document))
        return result.exit
    if arguments.flag("plan") and result.steps:
        _show(result.standing, result.steps)
    print(f"  {result.device:<18} {printable.below(translate(result.message), 21)}")
    for note in result.notes:
        print(f"  {'':<18} {translate('note:')} {printable.below(translate(note), 27)}")
    if result.run:
        print(translate(f"  recorded as {arg(result.run)}"))
    if arguments.flag("rehearse"):
        print(translate("  rehearsed with an emulated router: no real device was contacted, no cable was moved"))
    return result.exit


TRUST = syntax.CommandSpec(
    "device trust",
    "review and pin the certificates and SSH host keys of a site",
    words=(syntax.Word("site", "the site", is_required=True, example="coastal"), syntax.DEVICES, syntax.INVENTORY),
    details=(
        "No password is sent: each device shows its certificate or SSH host key, and you compare it with what "
        "the device prints on its own console. This needs a terminal. For other computers and for AWX, put it "
        "into the inventory: `fingerprint` under `access`, `host_key` under `ssh` of a computer."
    ),
)


def run_trust(arguments: syntax.Arguments) -> ExitCode:
    """Run `device trust`: read each device, ask about new identities, and save the answers."""
    import sys

    from atlantis_netcfg.cli.vpn._common import load_inventory
    from atlantis_netcfg.core import paths
    from atlantis_netcfg.core.errors import NoMatchError, UsageError, worst
    from atlantis_netcfg.inventory import choose
    from atlantis_netcfg.operations import Request
    from atlantis_netcfg.operations.common.request import refuse_examples
    from atlantis_netcfg.operations.trust import has_identity

    inventory = load_inventory(arguments)
    site_hosts = choose(inventory, arguments.word("site"), arguments.many("device"))
    hosts = [host for host in site_hosts if has_identity(host)]
    if not hosts:
        raise NoMatchError("provision logs in to none of these devices: there is nothing to trust")
    refuse_examples(inventory, is_rehearsal=False)
    if not sys.stdin.isatty():
        raise UsageError(
            "no terminal to confirm an identity: nothing was trusted",
            hint="run the same command on a terminal; or set `fingerprint` under `access`, or `host_key` under `ssh`",
        )
    request = Request(state=paths.state_dir())
    return worst([_trust_device(inventory, host, request) for host in hosts])


def _trust_device(inventory: Inventory, host: Host, request: Request) -> ExitCode:
    """Handle one device; its errors do not stop the others."""
    from atlantis_netcfg.cli.base.output import tell
    from atlantis_netcfg.core.errors import ExitCode, NetcfgError, worst
    from atlantis_netcfg.operations.computers._access import is_computer
    from atlantis_netcfg.operations.trust import identities

    try:
        if is_computer(host):
            return _trust_computer(inventory, host, request)
        return worst([_trust_identity(identity, request) for identity in identities(inventory, host, request)])
    except NetcfgError as error:
        tell([error])
        return ExitCode.FAILED


def _trust_identity(identity: DeviceIdentity, request: Request) -> ExitCode:
    from atlantis_netcfg.cli.base.consent import require_agreement
    from atlantis_netcfg.core.errors import DeviceError, ExitCode
    from atlantis_netcfg.operations.trust import agree

    shows = msg(f"{arg(identity.device)}: its {arg(identity.service)} is {arg(identity.actual_key)}")
    if identity.is_known:
        print(
            translate(f"{arg(shows)}, as {'in the inventory' if identity.declared_key else 'accepted before'}"),
            flush=True,
        )
        return ExitCode.DONE
    field = "fingerprint" if identity.service == "certificate" else "host_key"
    if identity.declared_key:
        raise DeviceError(
            f"{arg(shows)}, but the inventory has {arg(identity.declared_key)}: nothing was trusted",
            hint=(
                "another device, a new certificate, or an intercepted connection; if the certificate was renewed, "
                f"change `{arg(field)}`"
            ),
        )
    print(
        translate(
            f"{arg(shows)}; "
            f"{f'accepted before: {arg(identity.pinned_key)}' if identity.pinned_key else 'not seen before'}"
        )
    )
    print(translate(f"  {arg(identity.compare)}"), flush=True)
    require_agreement(msg(f"Is this really {arg(identity.device)}?"))
    agree(identity, request)
    print(
        translate(
            f"stored on this computer; for all other computers, set `{arg(field)}: {arg(identity.actual_key)}` under "
            "its `access`"
        ),
        flush=True,
    )
    return ExitCode.DONE


def _trust_computer(inventory: Inventory, host: Host, request: Request) -> ExitCode:
    from atlantis_netcfg.core.errors import DeviceError, ExitCode
    from atlantis_netcfg.operations.trust import KeyState, TrustedComputer

    computer = TrustedComputer(inventory, host, request)
    state = computer.look()
    ssh = getattr(host.device, "ssh", None)
    if state is not KeyState.MATCH and ssh is not None and ssh.host_key is not None:
        raise DeviceError(
            f"{arg(host.name)} does not show the SSH host key that is in the inventory: nothing was trusted",
            hint="another computer, a new card, or an intercepted connection; if it was reinstalled, change `host_key`",
        )
    if state is KeyState.MISMATCH:
        raise DeviceError(
            f"{arg(host.name)} shows a different SSH host key than before: nothing was trusted",
            hint=(
                f"only if it is a new computer or a new card: run `ssh-keygen -R {arg(host.name)}`, then the same "
                "command again"
            ),
        )
    if state is KeyState.UNKNOWN:
        print(
            translate(
                f"{arg(host.name)}: OpenSSH shows its key; to compare, run on that computer: ssh-keygen -lf "
                "/etc/ssh/ssh_host_ed25519_key.pub"
            )
        )
        computer.ask()
        if computer.look() is not KeyState.MATCH:
            raise DeviceError(f"{arg(host.name)}: not confirmed, so nothing was trusted")
    print(translate(f"{arg(host.name)}: its SSH host key is known"), flush=True)
    return ExitCode.DONE
