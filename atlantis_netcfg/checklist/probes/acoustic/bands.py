"""Bands and words by which a modem is judged, as data."""

from __future__ import annotations

from atlantis_netcfg.core.verdicts import Verdict

__all__ = ["AIR_LEVEL", "INTEGRITY_LOW", "LEVELS", "RSSI_DB", "SOUND_SPEED_MPS", "STATES", "level_words", "plain"]

SOUND_SPEED_MPS = (1300, 1700)
"""Of water; what an EvoLogics modem takes (BIR)."""
RSSI_DB = (-85, -20)
"""Of an EvoLogics modem: weaker is lost, stronger overdrives it (BIR)."""
INTEGRITY_LOW = 100
"""Below: a weak reception (BIR)."""
LEVELS = {0: "maximum", 1: "-6 dB", 2: "-12 dB", 3: "-20 dB"}
"""Source level of an EvoLogics modem."""
AIR_LEVEL = 3
"""The only source level for a modem in air: louder ones damage the transducer."""

_OFF = "switch the modem off and on, or have its crew let it listen: this tool never switches it"
STATES: dict[str, tuple[Verdict, str, str, str | None]] = {
    "INITIATION LISTEN": (Verdict.PASS, "listens", "listens", None),
    "INITIATION ESTABLISH": (Verdict.WARN, "connecting", "is setting up a connection", "wait a minute, check again"),
    "INITIATION DISCONNECT": (Verdict.WARN, "connecting", "is ending a connection", "wait a minute, check again"),
    "ONLINE": (Verdict.WARN, "connected", "holds an acoustic connection", "let the vehicle end it, and check again"),
    "BACKOFF": (Verdict.WARN, "backing-off", "waits after a collision with another modem", "check again in a minute"),
    "OFFLINE READY": (Verdict.FAIL, "offline", "is switched off on its acoustic side (OFFLINE READY)", _OFF),
    "OFFLINE CONNECTION FAILED": (Verdict.FAIL, "offline", "has lost a connection and does not listen", _OFF),
    "OFFLINE TERMINATED": (Verdict.FAIL, "offline", "has been told to stop and does not listen", _OFF),
    "OFFLINE ALARM": (
        Verdict.FAIL,
        "alarm",
        "has an internal error (OFFLINE ALARM)",
        "switch the modem off and on; if the alarm comes back, its maker has to look at it",
    ),
    "NOISE": (
        Verdict.FAIL,
        "noise",
        "cannot connect: there is too much noise around it (NOISE)",
        "look for a pump, thruster or echo sounder that runs close by, and whether the transducer is in the water",
    ),
    "DEAF": (
        Verdict.FAIL,
        "deaf",
        "cannot receive (DEAF)",
        "look at the transducer and its cable; in air a modem may be deaf: check again in the water",
    ),
}
"""What a state of an EvoLogics modem means: verdict, code, sentence, hint."""


def level_words(level: int) -> str:
    """`1 (-6 dB)`."""
    return f"{level} ({LEVELS[level]})" if level in LEVELS else f"{level} (unknown)"


def plain(value: float) -> str:
    """A number without a tail of noughts."""
    return f"{value:.2f}".rstrip("0").rstrip(".")
