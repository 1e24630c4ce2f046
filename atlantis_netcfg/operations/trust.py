"""Read the certificate or host key at a device's address without a login, and pin it once a person agrees."""

from __future__ import annotations

import asyncio
import shlex
import subprocess
from dataclasses import dataclass
from enum import Enum
from typing import TYPE_CHECKING, Final

from atlantis_netcfg.core.errors import DeviceFailed
from atlantis_netcfg.core.events import ignore
from atlantis_netcfg.inventory.model import LteDriver, LteRouter
from atlantis_netcfg.links.lte import rutos_client
from atlantis_netcfg.operations.common.jobs import endpoint_of
from atlantis_netcfg.operations.common.kinds import handled, managed
from atlantis_netcfg.operations.computers._access import is_computer
from atlantis_netcfg.operations.computers.parts import ACCESS, PARTS
from atlantis_netcfg.operations.lte.units import LteUnit
from atlantis_netcfg.routeros.api import certificate_of
from atlantis_netcfg.routeros.console.ssh import host_key_of
from atlantis_netcfg.runs import Store

if TYPE_CHECKING:
    from collections.abc import Sequence

    from atlantis_netcfg.inventory import Declaration, Host
    from atlantis_netcfg.operations.common.request import Request

_SSH: Final = 22
_COMPARE: Final = "compare it with `fingerprint` on its own console (cable, Winbox):  /certificate print detail"
_WAIT_S: Final = 150.0
"""A connection may begin in a gap of 70 s."""


@dataclass(frozen=True, slots=True)
class DeviceIdentity:
    """What one service of a device shows of itself, and what it is known by."""

    device: str
    service: str
    """`certificate` or `SSH host key`."""
    seen: str
    declared: str | None
    """In the inventory, which counts before what is kept on this computer."""
    pinned: str | None
    """On this computer."""
    compare: str = (
        "compare it where nobody can be in between: at the device itself, on a cable that leads to nothing else"
    )
    """Where the device itself says it."""

    @property
    def known(self) -> bool:
        """Whether it is what it should be."""
        return self.seen == (self.declared or self.pinned)


def has_identity(host: Host) -> bool:
    """Whether anybody logs in to it."""
    unit = isinstance(host.device, LteRouter) and host.device.driver is LteDriver.RUTOS
    return handled(host) or unit or is_computer(host)


def identities(declaration: Declaration, host: Host, request: Request) -> tuple[DeviceIdentity, ...]:
    """See what a device that is no computer shows: nothing is sent to it. Raises DeviceFailed, UsageError."""
    pins = Store(request.state).pins
    if handled(host):
        access = managed(declaration, host).access
        certificate = asyncio.run(certificate_of(endpoint_of(host, access, request)))
        found = [
            DeviceIdentity(host.name, "certificate", certificate, access.fingerprint, pins.get(host.name), _COMPARE)
        ]
        address, key = (str(access.address), _SSH), access.host_key
    else:
        assert isinstance(host.device, LteRouter)  # noqa: S101 - `has_identity` has said so
        assert host.device.access is not None  # noqa: S101 - inventory/rules/lte.py
        unit = LteUnit(host, host.device, Store(request.state), ignore)
        declared = host.device.access.fingerprint
        certificate = rutos_client.certificate_of(unit.endpoint)
        found = [DeviceIdentity(host.name, "certificate", certificate, declared, pins.get(host.name))]
        if not unit.may_set:
            return tuple(found)
        address, key = unit.ssh, host.device.access.host_key
    try:
        seen = host_key_of(*address)
    except DeviceFailed:
        return tuple(found)  # only safe mode of RouterOS below 7.18, files and settings of a 4G unit need it
    return (*found, DeviceIdentity(host.name, "SSH host key", seen, key, pins.host_key(host.name)))


def agree(identity: DeviceIdentity, request: Request) -> None:
    """Keep what a person has agreed to."""
    pins = Store(request.state).pins
    change = pins.change if identity.service == "certificate" else pins.change_host_key
    change(identity.device, identity.seen)


class KeyState(Enum):
    """What OpenSSH's `known_hosts` says of the key that a computer shows."""

    KNOWN = "known"
    UNKNOWN = "unknown"
    CHANGED = "changed"


@dataclass(frozen=True, slots=True)
class TrustedComputer:
    """A gateway, or the server of the VPN: OpenSSH itself shows its key, asks, and keeps the answer."""

    declaration: Declaration
    host: Host
    request: Request

    def look(self) -> KeyState:
        """Compare the key that it shows; nobody logs in. Raises DeviceFailed."""
        words = self._words("-o", "BatchMode=yes", "-o", "StrictHostKeyChecking=yes")
        try:
            done = subprocess.run(  # noqa: S603 - our own words
                words,
                stdin=subprocess.DEVNULL,
                capture_output=True,
                text=True,
                errors="replace",
                timeout=_WAIT_S,
                check=False,
            )
        except (OSError, subprocess.TimeoutExpired) as error:
            raise DeviceFailed(
                f"{self.host.name} was not reached: {error}", hint="is OpenSSH's client here?"
            ) from error
        if "IDENTIFICATION HAS CHANGED" in done.stderr:
            return KeyState.CHANGED
        if "Host key verification failed" in done.stderr:
            return KeyState.UNKNOWN
        if done.returncode and "Permission denied" not in done.stderr:
            last = (done.stderr.strip() or f"exit {done.returncode}").splitlines()[-1]
            raise DeviceFailed(
                f"{self.host.name} was not reached: {last}", hint="look at its power and its cable, then try again"
            )
        return KeyState.KNOWN

    def ask(self) -> None:
        """Let OpenSSH show the key to whoever is at the terminal, and ask."""
        subprocess.run(self._words("-o", "StrictHostKeyChecking=ask"), stdout=subprocess.DEVNULL, check=False)  # noqa: S603 - our own words

    def _words(self, *options: str) -> Sequence[str]:
        """OpenSSH takes the first value of an option."""
        access = PARTS[ACCESS](self.declaration, self.host, self.request)
        alone = ("ControlPath=none", "PreferredAuthentications=none", "LogLevel=ERROR", "ConnectTimeout=120")
        words = ["ssh", "-T", *options, *(word for option in alone for word in ("-o", option))]
        words += shlex.split(access["ssh_args"])
        return [*words, "-p", str(access["port"]), f"{access['user']}@{access['host']}", "true"]
