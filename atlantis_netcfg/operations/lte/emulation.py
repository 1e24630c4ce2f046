"""Emulated 4G units for a rehearsal; ModemManager and units without a driver are not emulated."""

from __future__ import annotations

from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING

from atlantis_netcfg.declaration.model import LteDriver, LteRouter
from atlantis_netcfg.emulator import modem, rutos
from atlantis_netcfg.operations.request import Target

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence
    from pathlib import Path

    from atlantis_netcfg.declaration import Host


@dataclass(frozen=True, slots=True)
class EmulatedUnit:
    """A running unit."""

    target: Target
    export: Callable[[], str]
    """What it is set to, in its own words."""


@contextmanager
def emulated_units(hosts: Sequence[Host], folder: Path) -> Iterator[Mapping[str, EmulatedUnit]]:
    """Start those of these hosts that can be emulated; they end with the context."""
    with ExitStack() as stack:
        found = {}
        for host in hosts:
            device = host.device
            if not isinstance(device, LteRouter):
                continue
            if device.driver is LteDriver.RUTOS:
                found[host.name] = _rutos(stack, host.name, device, folder)
            elif device.driver is LteDriver.AT:
                found[host.name] = _modem(stack, device)
        yield found


def not_rehearsed(hosts: Sequence[Host]) -> tuple[str, ...]:
    """What a rehearsal of these units does not show."""
    drivers = {host.device.driver for host in hosts if isinstance(host.device, LteRouter)}
    reasons = {
        LteDriver.RUTOS: rutos.NOT_REHEARSED,
        LteDriver.AT: modem.NOT_REHEARSED,
        LteDriver.MODEMMANAGER: ("ModemManager and its modem: nothing of them is emulated, and nothing was looked at",),
        LteDriver.MANUAL: ("a 4G unit without a driver: only a person can look at it",),
    }
    return tuple(line for driver, lines in reasons.items() if driver in drivers for line in lines)


def _rutos(stack: ExitStack, name: str, device: LteRouter, folder: Path) -> EmulatedUnit:
    """As it comes from its box but for the declared users: nothing is set, and the SIM's PIN is the declared one."""
    access, sim = device.access, device.sim
    assert access is not None  # noqa: S101 - declaration/rules/lte.py
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
    return EmulatedUnit(target, running.unit.export)


def _modem(stack: ExitStack, device: LteRouter) -> EmulatedUnit:
    spec = modem.ModemSpec(apn=device.sim.apn or "internet")
    running = stack.enter_context(modem.RunningModem(spec))
    return EmulatedUnit(Target(host="", port=0, pin="", serial=running.path), lambda: "\n".join(running.forbidden))
