"""What the console says around the commands: greeting, first login, pager.

Sources: Manual, Command Line Interface; netmiko `mikrotik_ssh.py` and community.routeros `plugins/terminal` for the
questions of a first login. The device's licence and its letters drawn of letters are not repeated here.

Assumption: console-first-login
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from atlantis_netcfg.emulator.routeros.device import Device

__all__ = [
    "DEFAULTS",
    "LICENCE",
    "LICENCE_TEXT",
    "MISMATCH",
    "NEW_PASSWORD",
    "PASSWORD",
    "PASSWORD_DONE",
    "REPEAT_PASSWORD",
    "banner",
    "note",
    "pager",
]

LICENCE = "Do you want to see the software license? [Y/n]: "
LICENCE_TEXT = "(the text of the software license is not rehearsed)"
DEFAULTS = """The following default configuration has been installed on your router:
-------------------------------------------------------------------------------
You can type "v" to see the exact commands that are used to add and remove
this default configuration, or you can view them later with
'/system default-configuration print' command.
To remove this default configuration type "r" or hit any other key to continue.
If you are connected using the above IP and you remove it, you will be
disconnected."""
PASSWORD = "Change your password"  # noqa: S105 (a heading)
NEW_PASSWORD = "new password> "  # noqa: S105 (a prompt)
REPEAT_PASSWORD = "repeat new password> "  # noqa: S105 (a prompt)
PASSWORD_DONE = "Password changed"  # noqa: S105 (a message)
MISMATCH = "Passwords do not match"


def banner(device: Device) -> str:
    """Who speaks."""
    name = f"  MikroTik RouterOS {device.spec.version} (c) 1999-2025       https://www.mikrotik.com/"
    return f"\n\n{name}\n\nPress F1 for help\n"


def note(device: Device) -> str:
    """`/system/note`, if it is to be shown at login."""
    settings = device.settings("/system/note")
    text = settings.get("note", "")
    return text if text and settings.get("show-at-login") == "yes" else ""


def pager(device: Device) -> str:
    """The line below a page; version 6 has other words."""
    return "-- [Q quit|D dump|down]" if device.at_least("7.0") else "-- [Q quit|D dump|right|down]"
