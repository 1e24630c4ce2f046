"""`provision vpn onboard`: let a partner's device, or a declared computer, into the VPN."""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.cli._arguments import JSON, Command, Word
from atlantis_netcfg.cli._passphrase import PASSPHRASE_FD
from atlantis_netcfg.cli._vpn import AGAIN, AUTHORITY, CLOCK, INVENTORY, NO_PUSH

if TYPE_CHECKING:
    from collections.abc import Sequence

    from atlantis_netcfg.cli._arguments import Arguments
    from atlantis_netcfg.core.errors import ExitCode
    from atlantis_netcfg.operations.vpn.requests import DeviceWords

COMMAND = Command(
    "vpn onboard",
    "let a device into the VPN: a fixed address, a certificate, and one sealed file to hand out",
    words=(
        Word("partner", "whose device it is", example="iqua"),
        Word("device", "what it is called; the member is then PARTNER-DEVICE", example="sparus2"),
        Word("kind", "what it is", example="robot"),
        Word("host", "a declared computer instead, by its name in the inventory", example="coastal-gateway"),
        Word("batch", "a list of many, .yml or .csv, with these words for keys or columns", example="iqua.yml"),
        Word("vehicle", "the robot's key in vehicles.yml; by default the vehicle of the device's name"),
        Word("link", "what carries its tunnel at worst: fibre (if left out), 4g, satellite", example="satellite"),
        Word("wrap", "tls-crypt-v2 (if left out); tls-crypt for OpenVPN before 2.5", example="tls-crypt"),
        Word("key", "ec (if left out) or rsa; routers get rsa", example="rsa"),
        Word("days", "how long the certificate is good; 397 if left out", example="90"),
        Word("address", "a fixed address of the partner's pool; the next free one if left out"),
        Word("recipient", "seal the file to this age key, or to the one in this file, not with a passphrase"),
        Word("contact", "whom its owner calls, for the page of instructions", example="'Ana, +351 210 000 000'"),
        Word("to", "also put the file into this folder", example="/media/usb"),
        CLOCK,
        AUTHORITY,
        INVENTORY,
    ),
    flags=(NO_PUSH, PASSPHRASE_FD, JSON),
    details=(
        "Repeating it makes nothing new; a different request for the same name is refused. Exit code 5: all is "
        "recorded and handed out, but the server does not have it yet: `provision vpn sync` goes on."
    ),
    changes=True,
    again=AGAIN,
)


def run(arguments: Arguments) -> ExitCode:
    """Check everything, issue, hand out, tell the server."""
    from atlantis_netcfg.cli import _members, _vpn
    from atlantis_netcfg.cli._passphrase import passphrase_prompt
    from atlantis_netcfg.operations.vpn.members import Onboarding, refuse_example_authority
    from atlantis_netcfg.operations.vpn.requests import recipients_of, requests_of

    declaration, requested = _vpn.declared(arguments), _device_words(arguments)
    requests = requests_of(declaration, requested)
    outlet = _members.outlet(arguments, recipients_of(requested, [request.name for request in requests]))
    refuse_example_authority(declaration, named=arguments.optional("authority") is not None)
    authority = _vpn.opened(arguments)
    server = _vpn.server(arguments, declaration)
    onboarding = Onboarding(declaration, _vpn.operator(arguments, authority), outlet)
    handed = onboarding.finished(requests)
    passphrase = passphrase_prompt(arguments) if not handed else None
    _members.hold(arguments, server, authority)
    if passphrase is not None:
        handed = onboarding.issue(requests, passphrase)
    return _members.close(arguments, declaration, handed, server, authority)


def _device_words(arguments: Arguments) -> Sequence[DeviceWords]:
    """What was asked for: the words, or the records of a file. Raises UsageError, ListInvalid."""
    from pathlib import Path

    from atlantis_netcfg.core.errors import UsageError
    from atlantis_netcfg.declaration.lists import read
    from atlantis_netcfg.operations.vpn.requests import KEYS, DeviceWords

    words = {key: arguments.optional(key) for key in KEYS}
    batch = arguments.optional("batch")
    if batch is None:
        return [DeviceWords("", **words)]
    if given := [key for key, value in words.items() if value is not None and key != "recipient"]:
        raise UsageError(f"`{given[0]}=` does not go with `batch=`", hint="write it into the file, for each device")
    common = {key: value for key, value in words.items() if value is not None}
    rows = read(Path(batch), KEYS)
    return [DeviceWords(**{**common, **row.values, "place": row.place}) for row in rows]
