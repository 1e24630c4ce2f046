"""A modem in this computer that ModemManager owns: its properties are read over D-Bus, and nothing is set."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from atlantis_netcfg.bearers.lte.modemmanager._bus import TIMEOUT_S, Bus, MmUnreachable
from atlantis_netcfg.bearers.lte.modemmanager._words import MODEM, reading_of, signal_is_set_up
from atlantis_netcfg.bearers.status import Finding
from atlantis_netcfg.core.verdicts import Verdict

if TYPE_CHECKING:
    from atlantis_netcfg.bearers.lte.record import LteReading

__all__ = ["NO_SIGNAL", "TIMEOUT_S", "MmLook", "MmUnreachable", "read", "reading_of", "signal_is_set_up"]

_BEARER = "org.freedesktop.ModemManager1.Bearer"

NO_SIGNAL = Finding(
    Verdict.INCONCLUSIVE,
    "signal-not-set-up",
    "ModemManager gives no signal figures, because nobody has told it to ask for them",
    "that is a setting, which a look does not make: type `mmcli -m any --signal-setup=30` once, then look again",
)


@dataclass(frozen=True, slots=True)
class MmLook:
    """What one look at ModemManager has given."""

    reading: LteReading
    findings: tuple[Finding, ...]
    """What the record has no place for: signal figures that nobody asks for."""
    calls: int


def read(address: str | None = None, *, timeout_s: float = TIMEOUT_S) -> MmLook:
    """Look at the only modem of this computer. `address`: of the bus; None: the system's. Raises MmUnreachable."""
    with Bus(address, timeout_s=timeout_s) as bus:
        modems = {path: found for path, found in bus.objects().items() if MODEM in found}
        if len(modems) != 1:
            told = "no modem" if not modems else f"{len(modems)} modems, and the declaration does not tell which"
            raise MmUnreachable(
                f"ModemManager has {told}",
                hint="look at `mmcli -L`: is the modem plugged in, and only the one of this site?",
            )
        (interfaces,) = modems.values()
        paths = interfaces[MODEM].get("Bearers") or []
        bearers = [bus.properties(str(path), _BEARER) for path in paths]
        findings = () if signal_is_set_up(interfaces) else (NO_SIGNAL,)
        return MmLook(reading_of(interfaces, bearers), findings, bus.calls)
