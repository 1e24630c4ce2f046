"""A SIM's PIN: sent only while the SIM asks for it, and only once.

A RouterOS device keeps the PIN of `/interface/lte` and enters it whenever the modem starts; a SIM counts wrong ones,
and the third locks it (3GPP TS 31.101, 9.5). So a PIN is an ordinary secret of the declared text with a gate before it:

- the SIM asks for none: nothing is sent, whatever is declared; a device that holds one keeps it;
- it asks, and the device holds none: the declared one is sent, and safe mode takes it back unless a new session reads
  that it was taken, so that a wrong one does not stay to be entered again;
- it has refused one, asks for its PUK, or asks although the device holds one: the plan is refused;
- an earlier run has sent one in vain (`DesiredState.pin_refusal`): the plan is refused until a person has cleared that.

The words of `pin-status` are written by the modem's driver; any others than those read here mean that nobody knows, for
which nothing is sent.

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
"""What `monitor_of` needs to know."""
_MODEM = "lte1"
"""The first modem, by its default name: the only one that is declared."""


def monitor_of(modems: Iterable[Row] = ()) -> Command:
    """Ask the modem under the name that it has among these rows; without them under its default name."""
    name = next((row["name"] for row in modems if row.get("default-name") == _MODEM and row.get("name")), _MODEM)
    return Command(f"{LTE}/monitor", (("numbers", name), ("once", "")))


MONITOR = monitor_of()
"""Asked together with the menus of a text that declares the modem; once more where these tell that it was renamed."""
STATUS_FIELDS = ("pin-status", "status", "registration-status")
"""What of its answer is kept: nothing that names the SIM."""
_FIELD = "pin"

_PUK = re.compile(r"\bpuk2?\b")
_WRONG_PIN = re.compile(r"\bwrong\b|\bincorrect\b|\binvalid\b|\brejected\b")
_FREE = re.compile(r"\bno password\b|\bnot required\b|\bok\b|\bready\b|\bdisabled\b|\bunlocked\b")
_ASKS = re.compile(r"\bpin\b|\bpassword\b|\blocked\b")
_ON_AIR = re.compile(r"\bregistered\b|\bconnected\b|\bsearching\b|\bdenied\b|\broaming\b|\bcall in progress\b")


class PinSim(Enum):
    """What the SIM says of its PIN."""

    FREE = auto()
    """It asks for none, or has taken one."""
    ASKS = auto()
    WRONG_PIN = auto()
    """It has refused the one that was entered."""
    PUK = auto()
    UNKNOWN = auto()


def sim_of(monitor: Row | None) -> PinSim:
    """Read what `monitor` says; a modem on the air has no need of a PIN, whatever its driver says of it."""
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
    """Say why the declared PIN must not be sent to a SIM that asks; None: nothing speaks against it.

    `held` is the PIN that the device has in its configuration, empty if none.
    """
    if sim is PinSim.PUK:
        return "the SIM is locked after too many wrong PINs and asks for its PUK: unlock it in a telephone"
    if sim is PinSim.WRONG_PIN:
        return "the SIM has refused the PIN, which is not tried again: compare it with the SIM's letter"
    if pin_refusal:
        return pin_refusal
    if current == declared_pin:
        return "the device holds the declared PIN, and the SIM still asks for one: it is wrong, and not tried again"
    if current:
        return "the device holds another PIN, which the SIM has not taken: take it out by hand before one more is tried"
    return None


def pending(desired_state: DesiredState, observation: Observation) -> bool:
    """Tell whether the declared PIN is on the device and the modem has not yet said what became of it."""
    declared_pins = {item.values.get(_FIELD) for item in desired_state.items.get(LTE, ())} - {None, ""}
    current = any(row.get(_FIELD) in declared_pins for row in observation.rows.get(LTE, ()))
    return current and sim_of(observation.modem) in {PinSim.ASKS, PinSim.UNKNOWN}
