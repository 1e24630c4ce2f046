"""Every command that may go to a modem; anything else is refused before the wire.

Only reads: the `?` forms and the execution forms that return information (3GPP TS 27.007), and vendors' reads. One of
them holds a `=` and is a documented read all the same: `+QENG="servingcell"`. What sets something (`+CFUN=`, `+COPS=`,
`+CPIN=`, `E0`, `+CMEE=`) is not here, nor what tells who the subscriber is (`+CGSN`, `+CIMI`, `+CCID`).
"""

from __future__ import annotations

from atlantis_netcfg.core.errors import NetcfgError

__all__ = ["ALLOWED", "READS", "VENDOR_READS", "CommandForbidden", "checked"]

READS: tuple[str, ...] = (
    "AT+CGMI",
    "AT+CFUN?",
    "AT+CPIN?",
    "AT+CEREG?",
    "AT+CGREG?",
    "AT+CREG?",
    "AT+COPS?",
    "AT+CESQ",
    "AT+CSQ",
    "AT+CGACT?",
    "AT+CGCONTRDP",
    "AT+CGPADDR",
    "AT+CGDCONT?",
)
"""Sent one after another for a reading, in this order."""

VENDOR_READS: dict[str, tuple[str, ...]] = {"quectel": ("AT+QNWINFO",)}
"""Sent afterwards if the manufacturer's name holds the word."""

ALLOWED: frozenset[str] = frozenset(
    {
        *READS,
        *(command for commands in VENDOR_READS.values() for command in commands),
        "ATI",
        "AT+CGMM",
        "AT+CGMR",
        'AT+QENG="servingcell"',
        "AT+QCSQ",
        "AT^HCSQ?",
        "AT^SYSCFG?",
    }
)


class CommandForbidden(NetcfgError):
    """Our own code was about to send something that is no read: a fault of ours, and nothing was sent."""


def checked(command: str) -> str:
    """Give the command back if it is allowed. Raises CommandForbidden."""
    if command not in ALLOWED:
        word = command.partition("=")[0]
        raise CommandForbidden(f"`{word}` is not on the allow-list of modem commands: it was not sent")
    return command
