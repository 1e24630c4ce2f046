"""A SIM's PIN: sent only while the SIM asks for it, and only once.

A RouterOS device stores the PIN of `/interface/lte` and enters it whenever the modem starts. A SIM counts wrong PINs,
and the third one locks it (3GPP TS 31.101, 9.5). So a PIN is an ordinary secret of the desired state with additional
conditions:

- the SIM asks for none: nothing is sent, whatever the inventory contains; a PIN on the device is kept;
- it asks, and the device has none: the PIN of the inventory is sent. Safe mode undoes it unless a new session
  reads that the SIM has accepted it, so that a wrong PIN is not entered again;
- it has refused one, asks for its PUK, or asks although the device has a PIN: the plan is refused;
- an earlier run has sent a wrong one (`DesiredState.pin_refusal`): the plan is refused until the user has cleared that.

The texts of `pin-status` come from the modem's driver; with any other text than those known here the state is unknown,
and nothing is sent.

Assumption: lte-pin-words
Assumption: lte-pin-once
"""

from __future__ import annotations

import re
from enum import Enum, auto
from typing import TYPE_CHECKING

from atlantis_netcfg.routeros.api import Command

if TYPE_CHECKING:
    from collections.abc import Iterable

    from atlantis_netcfg.routeros._items import DesiredState
    from atlantis_netcfg.routeros._types import Observation, Row

LTE = "/interface/lte"
MODEMS = Command(f"{LTE}/print", ((".proplist", "default-name,name"),))
"""Reads the names that `monitor_of` needs."""
_MODEM = "lte1"
"""Default name of the first modem: the only one that can be declared."""


def monitor_of(modems: Iterable[Row] = ()) -> Command:
    """Return the command that reads the modem, by its name in these rows, else by its default name."""
    name = next((row["name"] for row in modems if row.get("default-name") == _MODEM and row.get("name")), _MODEM)
    return Command(f"{LTE}/monitor", (("numbers", name), ("once", "")))


MONITOR = monitor_of()
"""Sent with the menus of a text that declares the modem; repeated if they show that it was renamed."""
STATUS_FIELDS = ("pin-status", "status", "registration-status")
"""Fields of the reply that are kept: none that identifies the SIM."""
_FIELD = "pin"

_PUK = re.compile(r"\bpuk2?\b")
_WRONG_PIN = re.compile(r"\bwrong\b|\bincorrect\b|\binvalid\b|\brejected\b")
_FREE = re.compile(r"\bno password\b|\bnot required\b|\bok\b|\bready\b|\bdisabled\b|\bunlocked\b")
_ASKS = re.compile(r"\bpin\b|\bpassword\b|\blocked\b")
_ON_AIR = re.compile(r"\bregistered\b|\bconnected\b|\bsearching\b|\bdenied\b|\broaming\b|\bcall in progress\b")


class PinSim(Enum):
    """PIN state of the SIM."""

    FREE = auto()
    """The SIM requires no PIN, or has accepted one."""
    ASKS = auto()
    WRONG_PIN = auto()
    """The SIM has refused the PIN that was entered."""
    PUK = auto()
    UNKNOWN = auto()


def sim_of(monitor: Row | None) -> PinSim:
    """Parse the output of `monitor`; a registered modem needs no PIN, whatever its driver reports."""
    status = monitor or {}
    word = status.get("pin-status", "").lower()
    for pattern, sim in (
        (_PUK, PinSim.PUK),
        (_WRONG_PIN, PinSim.WRONG_PIN),
        (_FREE, PinSim.FREE),
        (_ASKS, PinSim.ASKS),
    ):
        if pattern.search(word):
            return sim
    text = " ".join(status.get(name, "").lower() for name in ("status", "registration-status"))
    return PinSim.FREE if _ON_AIR.search(text) else PinSim.UNKNOWN


def objection(sim: PinSim, current: str, declared_pin: str, pin_refusal: str) -> str | None:
    """Return why the PIN must not be sent to a SIM that asks for it; None if it may.

    `current` is the PIN in the device's configuration, empty if none.
    """
    if sim is PinSim.PUK:
        return "the SIM is locked after too many wrong PINs and asks for its PUK: unlock it in a telephone"
    if sim is PinSim.WRONG_PIN:
        return "the SIM refused the PIN; it will not be tried again: compare it with the letter of the SIM"
    if pin_refusal:
        return pin_refusal
    if current == declared_pin:
        return (
            "the device has the inventory's PIN, and the SIM still asks for one: the PIN is wrong and is not "
            "tried again"
        )
    if current:
        return "the device has another PIN, which the SIM did not accept: remove it by hand before another one is tried"
    return None


def pending(desired_state: DesiredState, observation: Observation) -> bool:
    """Return True if the PIN is on the device and the modem has not reported its result yet."""
    declared_pins = {item.values.get(_FIELD) for item in desired_state.items.get(LTE, ())} - {None, ""}
    current = any(row.get(_FIELD) in declared_pins for row in observation.rows.get(LTE, ()))
    return current and sim_of(observation.modem) in {PinSim.ASKS, PinSim.UNKNOWN}
