"""A 4G unit without RouterOS: its state as read by its driver, its result, its emulation."""

from __future__ import annotations

from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

from atlantis_netcfg.core import errors
from atlantis_netcfg.core.events import Subscriber, Verdict
from atlantis_netcfg.core.messages import arg, join, msg
from atlantis_netcfg.emulator import modem, rutos
from atlantis_netcfg.inventory import model
from atlantis_netcfg.links.lte import Registration, at, modemmanager, rutos_client, rutos_read, rutos_settings
from atlantis_netcfg.links.lte import judge as record
from atlantis_netcfg.links.lte.judge import LteSubscription, judge
from atlantis_netcfg.operations.common.request import Target
from atlantis_netcfg.operations.common.terminals import TriedPin
from atlantis_netcfg.routeros.console.ssh import Commands, open_commands

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence
    from pathlib import Path

    from atlantis_netcfg.emulator.coverage import PlaceTruth
    from atlantis_netcfg.inventory import Host
    from atlantis_netcfg.links import LinkFinding, Quality
    from atlantis_netcfg.links.lte import LteReading
    from atlantis_netcfg.links.lte.rutos_client import RutosEndpoint
    from atlantis_netcfg.links.lte.rutos_settings import LteSettings
    from atlantis_netcfg.routeros.apply import Status
    from atlantis_netcfg.runs import Pins, Store


_HTTPS, _SSH = 443, 22


_SERIAL = "serial number of "
"""Prefix of the device name under which a serial number is stored among the pins; names have no spaces."""


class EmulationUnavailable(errors.NetcfgError):
    """There is no emulator for the driver's device."""


@dataclass(frozen=True, slots=True)
class UnitStatus:
    """The result of reading a unit once."""

    reading: LteReading
    findings: tuple[LinkFinding, ...]
    requests: int = 0
    sent_bytes: int = 0
    received_bytes: int = 0
    serial: str | None = None
    identities: Mapping[str, str] = field(default_factory=dict, repr=False)
    """Unmasked `imei` and `iccid`, for a record that masks them."""


@dataclass(frozen=True, slots=True)
class LteUnit:
    """A unit with its access and what earlier runs recorded about it."""

    host: Host
    device: model.LteRouter
    store: Store
    """Store with the unit's pinned certificates, and whether its SIM's PIN was tried."""
    notify: Subscriber
    is_rehearsal: bool = False
    target: Target | None = None
    """Rehearsal: address of its emulator; None: there is none."""

    @property
    def name(self) -> str:
        """The unit's name in the inventory."""
        return self.host.name

    @property
    def may_set(self) -> bool:
        """Whether the inventory has credentials that may change settings."""
        access = self.device.access
        admin = access is not None and access.admin_user is not None and access.admin_password is not None
        return self.device.driver is model.LteDriver.RUTOS and admin

    @property
    def settings(self) -> LteSettings:
        """The SIM settings of the inventory, to be set."""
        sim = self.device.sim
        return rutos_settings.LteSettings(
            apn=sim.apn, user=sim.user, password=sim.password, pin=sim.pin, roaming=sim.roaming
        )

    @property
    def expectation(self) -> LteSubscription:
        """The SIM settings of the inventory, to be checked."""
        sim = self.device.sim
        return LteSubscription(
            apn=sim.apn,
            roaming=sim.roaming,
            pin_declared=sim.pin is not None,
            apn_required=sim.user is not None or sim.password is not None,
            bands=sim.bands,
        )

    def look(self) -> UnitStatus:
        """Read and judge the unit without changes; raise DeviceError or EmulationUnavailable."""
        if self.is_rehearsal and self.target is None and self.device.driver is not model.LteDriver.MANUAL:
            raise EmulationUnavailable(f"not checked: driver {arg(self.device.driver)} has no emulator")
        readers: dict[model.LteDriver, Callable[[], UnitStatus]] = {
            model.LteDriver.RUTOS: self._rutos,
            model.LteDriver.AT: self._at,
            model.LteDriver.MODEMMANAGER: self._modemmanager,
            model.LteDriver.MANUAL: self._manual,
        }
        return readers[self.device.driver]()

    def shell(self) -> Commands:
        """Log in to change settings; raise DeviceError, before sending the password if the host key is unknown."""
        access = self._access
        assert access.admin_user is not None  # noqa: S101 - `may_set` has said so
        assert access.admin_password is not None  # noqa: S101 - as above
        (host, port), key = self.ssh, access.host_key or self.pins.host_key(self.name)
        key = key if self.target is None else self.target.host_key
        return open_commands(host, port, access.admin_user, access.admin_password, pin=key)

    @property
    def _access(self) -> model.LteAccess:
        assert self.device.access is not None  # noqa: S101 - inventory/rules/lte.py
        return self.device.access

    @property
    def endpoint(self) -> RutosEndpoint:
        """The web interface's address and certificate pin (driver `rutos`)."""
        access, target = self._access, self.target
        host, port = str(self.device.address), access.port or _HTTPS
        pin = access.fingerprint or self.pins.get(self.name)
        if target is not None:
            host, port, pin = target.host, target.port, target.pin
        return rutos_client.RutosEndpoint(host, port, access.user, access.password, pin)

    @property
    def ssh(self) -> tuple[str, int]:
        """The SSH server's address and port (driver `rutos`)."""
        return (str(self.device.address), _SSH) if self.target is None else (self.target.host, self.target.ssh or _SSH)

    @property
    def pins(self) -> Pins:
        """The pinned identities of devices."""
        return self.store.pins

    @property
    def pin_attempt(self) -> TriedPin:
        """The record of a PIN that the unit's SIM has not accepted."""
        return TriedPin(self.store.root, self.host.site, self.name)

    @property
    def pin_tried(self) -> bool:
        """Whether a run has tried a PIN on the unit's SIM since the SIM was last unlocked."""
        return bool(self.pin_attempt.why_not)

    def _rutos(self) -> UnitStatus:
        result = rutos_read.read(self.endpoint)
        self._identify(result.serial)
        reading = result.reading
        if reading.state is Registration.SIM_PIN_REQUIRED and self.pin_tried:
            # RutOS does not say that a PIN was wrong, only that one is asked for: that one was tried is known here.
            reading = replace(reading, pin_refused=True)
        usage = (result.requests, result.sent_bytes, result.received_bytes)
        return UnitStatus(reading, judge(reading, self.expectation), *usage, result.serial, result.identities)

    def _identify(self, serial: str | None) -> None:
        """Pin the unit's serial number, if it reports one; raise DeviceError if it differs."""
        if serial is None:
            return
        saved_serial = self.pins.pin(f"{_SERIAL}{self.name}", serial)
        if saved_serial != serial:
            raise errors.DeviceError(
                f"{arg(self.name)}: another unit responds here: serial number {arg(serial)}, expected "
                f"{arg(saved_serial)}",
                hint="if the unit was replaced on purpose, remove its lines from pins.json in the state folder",
            )

    def _at(self) -> UnitStatus:
        port = self.target.serial if self.target is not None else self.device.serial
        assert port is not None  # noqa: S101 - inventory/rules/lte.py; each emulated modem has one
        result = at.read(port)
        return UnitStatus(result.reading, judge(result.reading, self.expectation), result.commands)

    def _modemmanager(self) -> UnitStatus:
        result = modemmanager.read()
        return UnitStatus(result.reading, (*judge(result.reading, self.expectation), *result.findings), result.calls)

    def _manual(self) -> UnitStatus:
        return UnitStatus(record.unmanaged_reading(), (record.manual_check_finding(str(self.device.address)),))


FINE = (errors.ExitCode.DONE, errors.ExitCode.CHANGES, errors.ExitCode.NOTHING)
"""Exit codes that do not fail a play: a unit that only a person can check was not checked, but has not failed."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LteResult:
    """The result of a unit: the settings made, and its state afterwards."""

    name: str
    status: Status
    exit: errors.ExitCode
    message: str
    hint: str | None = None
    planned_actions: int = 0
    confirmed_actions: int = 0
    diff: str = ""
    notes: tuple[str, ...] = ()
    plan_hash: str = ""
    findings: tuple[LinkFinding, ...] = ()
    quality: Quality = field(default_factory=dict)
    requests: int = 0
    sent_bytes: int = 0
    """Bytes sent, without headers, TLS and SSH; the same holds for `received_bytes`."""
    received_bytes: int = 0
    seconds: float = 0.0
    serial: str | None = None
    """The unit's serial number, which identifies it."""

    def as_dict(self) -> Mapping[str, Any]:
        """Return JSON-able data with every key of a device's result."""
        return {
            "status": self.status.value,
            "exit": int(self.exit),
            "message": self.message,
            "hint": self.hint,
            "busy": "",
            "planned": self.planned_actions,
            "confirmed": self.confirmed_actions,
            "diff": self.diff,
            "drift": [],
            "comparison": None,
            "notes": list(self.notes),
            "estimate": None,
            "plan_hash": self.plan_hash,
            "protection": "none",
            "protection_words": "none: the settings of a 4G unit are written directly and read back",
            "round_trips": self.requests,
            "bytes": {"sent": self.sent_bytes, "received": self.received_bytes},
            "seconds": round(self.seconds, 3),
            "version": None,
            "board": None,
            "findings": [finding.as_dict() for finding in self.findings],
            "quality": self.quality,
            "serial": self.serial,
        }


def words(finding: LinkFinding) -> str:
    """Format a finding as a note: `WARN: ... (...)`; without verdict if it passes."""
    verdict = "" if finding.verdict is Verdict.PASS else f"{finding.verdict}: "
    hint = msg(f" ({arg(finding.hint)})" if finding.hint else "")
    return join("", (verdict, finding.message, hint))


@dataclass(frozen=True, slots=True)
class EmulatedUnit:
    """A running emulated unit."""

    target: Target
    export: Callable[[], str]
    """Returns the unit's settings in its own format."""
    tune: Callable[[PlaceTruth], None] | None = None
    """Sets the signals received at another place; None: the emulated unit receives the same everywhere."""


@contextmanager
def emulated_units(hosts: Sequence[Host], folder: Path) -> Iterator[Mapping[str, EmulatedUnit]]:
    """Start the units that can be emulated; they end with the context."""
    with ExitStack() as stack:
        units = {}
        for host in hosts:
            device = host.device
            if not isinstance(device, model.LteRouter):
                continue
            if device.driver is model.LteDriver.RUTOS:
                units[host.name] = _rutos(stack, host.name, device, folder)
            elif device.driver is model.LteDriver.AT:
                units[host.name] = _modem(stack, device)
        yield units


def not_rehearsed(hosts: Sequence[Host]) -> tuple[str, ...]:
    """Return the limits of a rehearsal of these units."""
    drivers = {host.device.driver for host in hosts if isinstance(host.device, model.LteRouter)}
    reasons = {
        model.LteDriver.RUTOS: rutos.NOT_REHEARSED,
        model.LteDriver.AT: modem.NOT_REHEARSED,
        model.LteDriver.MODEMMANAGER: ("ModemManager and its modem are not emulated and were not checked",),
        model.LteDriver.MANUAL: ("a 4G unit without a driver must be checked by hand",),
    }
    return tuple(line for driver, lines in reasons.items() if driver in drivers for line in lines)


def _rutos(stack: ExitStack, name: str, device: model.LteRouter, folder: Path) -> EmulatedUnit:
    """Start a unit in factory state with the inventory's users and SIM PIN."""
    access, sim = device.access, device.sim
    assert access is not None  # noqa: S101 - inventory/rules/lte.py
    spec = rutos.RutosSpec(
        name=name,
        reader=access.user,
        reader_password=access.password.reveal(),
        admin=access.admin_user or "root",
        admin_password=access.admin_password.reveal() if access.admin_password is not None else "",
        sim=rutos.RutosSim(pin=None if sim.pin is None else sim.pin.reveal(), apn=sim.apn),
    )
    running = stack.enter_context(rutos.RunningRutos(spec, folder / name))
    ready = running.ready
    target = Target(
        host=ready["host"], port=ready["https"], pin=ready["pin"], ssh=ready["ssh"], host_key=ready["host_key"]
    )
    emulator = running.unit.modem

    def tune(truth: PlaceTruth) -> None:
        levels = {"rsrp_dbm": truth.rsrp_dbm, "rsrq_db": truth.rsrq_db, "sinr_db": truth.sinr_db}
        emulator.set_network(rutos.RutosNetwork(silent=not truth.has_service, cell_id=truth.cell_id, **levels))

    return EmulatedUnit(target, running.unit.export, tune)


def _modem(stack: ExitStack, device: model.LteRouter) -> EmulatedUnit:
    spec = modem.AtModemSpec(apn=device.sim.apn or "internet")
    running = stack.enter_context(modem.RunningModem(spec))
    return EmulatedUnit(Target(host="", port=0, pin="", serial=running.path), lambda: "\n".join(running.forbidden))
