"""The questions of a first login: licence, default configuration, a new password.

Their words are the device's, as netmiko and community.routeros wait for them.

Assumption: console-first-login
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.emulator.routeros.shell import words

if TYPE_CHECKING:
    from collections.abc import Awaitable, Callable

    from atlantis_netcfg.emulator.routeros.shell.session import Session

__all__ = ["Greeting"]

_REFUSED = "\x03"


class Greeting:
    """Asks what is still to be asked, then hands over to `then`."""

    def __init__(self, session: Session, then: Callable[[], Awaitable[None]]) -> None:
        self._session = session
        self._device = session.talk.device
        self._then = then
        self._left = list(self._device.greetings(session.talk.caller))
        self._wanted = ""

    async def next(self) -> None:
        """The next question, or the prompt."""
        session = self._session
        question = self._left.pop(0) if self._left else ""
        if question == "licence":
            session.ask(words.LICENCE, self._licence)
        elif question == "default-configuration":
            session.lines(words.DEFAULTS)
            session.ask("", self._defaults)
        elif question == "password":
            session.lines(words.PASSWORD)
            session.say("\r\n")
            self._new_password()
        else:
            await self._then()

    async def _licence(self, key: str) -> None:
        self._session.say(f"{key}\r\n" if key >= " " else "\r\n")
        if key.lower() not in ("n", _REFUSED):
            self._session.lines(words.LICENCE_TEXT)
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
        self._session.ask_secret(words.NEW_PASSWORD, self._first)

    async def _first(self, text: str) -> None:
        if text == _REFUSED:
            await self.next()
            return
        self._wanted = text
        self._session.ask_secret(words.REPEAT_PASSWORD, self._second)

    async def _second(self, text: str) -> None:
        if text == _REFUSED:
            await self.next()
        elif text != self._wanted:
            self._session.lines(words.MISMATCH)
            self._new_password()
        elif refused := await self._session.talk.set_password(text):
            self._session.lines(refused)
            self._new_password()
        else:
            self._device.greeted("password")
            self._session.lines(f"\n{words.PASSWORD_DONE}")
            await self.next()
