"""Read the certificate or host key at a device's address without a login, and pin it once a person agrees."""

from __future__ import annotations

import asyncio
import shlex
import subprocess
from dataclasses import dataclass
from enum import Enum
from typing import TYPE_CHECKING, Final

from atlantis_netcfg.core.errors import DeviceError
from atlantis_netcfg.core.events import ignore
from atlantis_netcfg.core.messages import arg, msg
from atlantis_netcfg.inventory.model import LteDriver, LteRouter
from atlantis_netcfg.links.lte import rutos_client
from atlantis_netcfg.operations.common.jobs import endpoint_of
from atlantis_netcfg.operations.common.kinds import get_managed_device, is_supported
from atlantis_netcfg.operations.computers._access import is_computer
from atlantis_netcfg.operations.computers.parts import ACCESS, PARTS
from atlantis_netcfg.operations.lte.units import LteUnit
from atlantis_netcfg.routeros.api import certificate_of
from atlantis_netcfg.routeros.console.ssh import host_key_of
from atlantis_netcfg.runs import Store

if TYPE_CHECKING:
    from collections.abc import Sequence

    from atlantis_netcfg.inventory import Host, Inventory
    from atlantis_netcfg.operations.common.request import Request

_SSH: Final = 22
_COMPARE: Final = "compare it with `fingerprint` on its own console (cable, Winbox):  /certificate print detail"
_WAIT_S: Final = 150.0
"""Timeout in seconds: a connection may begin in a gap of 70 s."""


@dataclass(frozen=True, slots=True)
class DeviceIdentity:
    """The identity presented by one service of a device, and the expected one."""

    device: str
    service: str
    """`certificate` or `SSH host key`."""
    actual_key: str
    declared_key: str | None
    """Key in the inventory; it takes precedence over the one stored on this computer."""
    pinned_key: str | None
    """Key stored on this computer."""
    compare: str = "compare it where no interception is possible: at the device, over a cable that leads nowhere else"
    """How to compare the key at the device itself."""

    @property
    def is_known(self) -> bool:
        """Whether the presented key is the expected one."""
        return self.actual_key == (self.declared_key or self.pinned_key)


def has_identity(host: Host) -> bool:
    """Return whether the toolkit logs in to the host."""
    unit = isinstance(host.device, LteRouter) and host.device.driver is LteDriver.RUTOS
    return is_supported(host) or unit or is_computer(host)


def identities(inventory: Inventory, host: Host, request: Request) -> tuple[DeviceIdentity, ...]:
    """Read the identities of a device that is no computer, without a login; raise DeviceError or UsageError."""
    pins = Store(request.state).pins
    if is_supported(host):
        access = get_managed_device(inventory, host).access
        certificate = asyncio.run(certificate_of(endpoint_of(host, access, request)))
        result = [
            DeviceIdentity(host.name, "certificate", certificate, access.fingerprint, pins.get(host.name), _COMPARE)
        ]
        address, key = (str(access.address), _SSH), access.host_key
    else:
        assert isinstance(host.device, LteRouter)  # noqa: S101 - `has_identity` has said so
        assert host.device.access is not None  # noqa: S101 - inventory/rules/lte.py
        unit = LteUnit(host, host.device, Store(request.state), ignore)
        fingerprint = host.device.access.fingerprint
        certificate = rutos_client.certificate_of(unit.endpoint)
        result = [DeviceIdentity(host.name, "certificate", certificate, fingerprint, pins.get(host.name))]
        if not unit.may_set:
            return tuple(result)
        address, key = unit.ssh, host.device.access.host_key
    try:
        host_key = host_key_of(*address)
    except DeviceError:
        return tuple(result)  # only safe mode of RouterOS below 7.18, files and settings of a 4G unit need it
    return (*result, DeviceIdentity(host.name, "SSH host key", host_key, key, pins.host_key(host.name)))


def agree(identity: DeviceIdentity, request: Request) -> None:
    """Pin the identity that a person accepted."""
    pins = Store(request.state).pins
    change = pins.change if identity.service == "certificate" else pins.change_host_key
    change(identity.device, identity.actual_key)


class KeyState(Enum):
    """The result of OpenSSH's `known_hosts` for a computer's key."""

    MATCH = "known"
    UNKNOWN = "unknown"
    MISMATCH = "changed"


@dataclass(frozen=True, slots=True)
class TrustedComputer:
    """A gateway or the VPN server: OpenSSH itself shows its key, asks, and records the answer."""

    inventory: Inventory
    host: Host
    request: Request

    def look(self) -> KeyState:
        """Check the key that the computer presents, without a login; raise DeviceError."""
        words = self._words("-o", "BatchMode=yes", "-o", "StrictHostKeyChecking=yes")
        try:
            process = subprocess.run(  # noqa: S603 - our own words
                words,
                stdin=subprocess.DEVNULL,
                capture_output=True,
                text=True,
                errors="replace",
                timeout=_WAIT_S,
                check=False,
            )
        except (OSError, subprocess.TimeoutExpired) as error:
            raise DeviceError(
                f"{arg(self.host.name)} is unreachable: {arg(error)}", hint="is the OpenSSH client installed here?"
            ) from error
        if "IDENTIFICATION HAS CHANGED" in process.stderr:
            return KeyState.MISMATCH
        if "Host key verification failed" in process.stderr:
            return KeyState.UNKNOWN
        if process.returncode and "Permission denied" not in process.stderr:
            last = (process.stderr.strip() or msg(f"exit {arg(process.returncode)}")).splitlines()[-1]
            raise DeviceError(
                f"{arg(self.host.name)} was not reached: {arg(last)}",
                hint="check its power and its cable, then try again",
            )
        return KeyState.MATCH

    def ask(self) -> None:
        """Let OpenSSH show the key on the terminal and ask the person."""
        subprocess.run(self._words("-o", "StrictHostKeyChecking=ask"), stdout=subprocess.DEVNULL, check=False)  # noqa: S603 - our own words

    def _words(self, *options: str) -> Sequence[str]:
        """Return the ssh command; `options` come first, as OpenSSH uses the first value of each option."""
        access = PARTS[ACCESS](self.inventory, self.host, self.request)
        alone = ("ControlPath=none", "PreferredAuthentications=none", "LogLevel=ERROR", "ConnectTimeout=120")
        words = ["ssh", "-T", *options, *(word for option in alone for word in ("-o", option))]
        words += shlex.split(access["ssh_args"])
        return [*words, "-p", str(access["port"]), f"{access['user']}@{access['host']}", "true"]
