"""The questions of a first login: licence, default configuration, a new password.

Their words are the device's, as netmiko and community.routeros wait for them.

Assumption: console-first-login
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Awaitable, Callable

    from atlantis_netcfg.emulator.routeros.device import Device
    from atlantis_netcfg.emulator.routeros.shell.session import Session

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


_REFUSED = "\x03"


class Greeting:
    """Asks what is still to be asked, then hands over to `then`."""

    def __init__(self, session: Session, then: Callable[[], Awaitable[None]]) -> None:
        self._session = session
        self._device = session.talk.device
        self._then = then
        self._left = list(self._device.greetings(session.talk.caller))
        self._expected = ""

    async def next(self) -> None:
        """The next question, or the prompt."""
        session = self._session
        question = self._left.pop(0) if self._left else ""
        if question == "licence":
            session.ask(LICENCE, self._licence)
        elif question == "default-configuration":
            session.lines(DEFAULTS)
            session.ask("", self._defaults)
        elif question == "password":
            session.lines(PASSWORD)
            session.say("\r\n")
            self._new_password()
        else:
            await self._then()

    async def _licence(self, key: str) -> None:
        self._session.say(f"{key}\r\n" if key >= " " else "\r\n")
        if key.lower() not in ("n", _REFUSED):
            self._session.lines(LICENCE_TEXT)
        self._device.greeted("licence")
        await self.next()

    async def _defaults(self, key: str) -> None:
        if key.lower() == "v":
            self._session.lines(self._device.default_configuration())
            self._session.ask("", self._defaults)
            return
        self._device.greeted("default-configuration")
        if key.lower() == "r":
            await self._session.talk.remove_defaults()
        await self.next()

    def _new_password(self) -> None:
        self._session.ask_secret(NEW_PASSWORD, self._first)

    async def _first(self, text: str) -> None:
        if text == _REFUSED:
            await self.next()
            return
        self._expected = text
        self._session.ask_secret(REPEAT_PASSWORD, self._second)

    async def _second(self, text: str) -> None:
        if text == _REFUSED:
            await self.next()
        elif text != self._expected:
            self._session.lines(MISMATCH)
            self._new_password()
        elif refused := await self._session.talk.set_password(text):
            self._session.lines(refused)
            self._new_password()
        else:
            self._device.greeted("password")
            self._session.lines(f"\n{PASSWORD_DONE}")
            await self.next()
