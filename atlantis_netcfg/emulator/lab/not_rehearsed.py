"""What machines do not stand for."""

from __future__ import annotations

NOT_REHEARSED = (
    "the clock: it is this computer's and cannot be set, and chrony does not start",
    "the kernel: it is this computer's, with its modules and its processor, not the board's; none can be loaded",
    "kernel settings outside net.*: they cannot be written, nor those of net.* that a namespace does not have",
    "reboot: a machine that reboots ends; power can be cut and given again",
    "the watchdog, the eMMC and the card, U-Boot, serial ports, GPS: there are none",
    "what a power cut costs: whatever was written is kept, also what was never fsynced",
    "Ubuntu: the machine is a Debian",
    "limits of memory and processor time of a service: they are accepted, and hold where this computer hands them down",
    "the network beyond the yard: there is none",
)
"""What a run against machines says nothing about; the rehearsal's report prints it."""
