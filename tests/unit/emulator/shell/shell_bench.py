"""A console session on a device with a clock of its own, without sockets."""

import asyncio
from collections.abc import Iterable

from atlantis_netcfg.emulator.routeros import Device, RouterSpec, User
from atlantis_netcfg.emulator.routeros.shell.keys import split_login
from atlantis_netcfg.emulator.routeros.shell.session import ConsoleSession, DirectTalk

PASSWORD = "open sesame"
TECHNICIAN = "10.64.101.10"


class Clock:
    """Seconds, moved by hand."""

    def __init__(self) -> None:
        self.now = 1000.0

    def __call__(self) -> float:
        return self.now


class Bench:
    def __init__(self, **spec: object) -> None:
        users = (
            User(name="admin", password=PASSWORD),
            User(name="guest", password=PASSWORD, group="read"),
            User(name="fresh"),
        )
        self.clock = Clock()
        self.device = Device(RouterSpec.model_validate({"name": "router", "users": users, **spec}), self.clock)

    def terminal(self, login: str = "admin+cet80w", *, sized: bool = True) -> "Terminal":
        return Terminal(self, login, sized=sized)

    def text(self) -> str:
        return self.device.export(header=False, show_sensitive=True)

    def wait(self, seconds: float) -> None:
        self.clock.now += seconds
        self.device.tick()


class Terminal:
    def __init__(self, bench: Bench, login: str, *, sized: bool) -> None:
        self._bench = bench
        user, screen = split_login(login)
        self.caller = bench.device.login(user, "" if user == "fresh" else PASSWORD, via="ssh", address=TECHNICIAN)
        self._out = bytearray()
        self.session = ConsoleSession(DirectTalk(bench.device, self.caller), screen, self._out.extend, has_size=sized)
        asyncio.run(self.session.start())

    def shown(self) -> str:
        """What came since somebody last looked."""
        self.session.tell()
        text = self._out.decode(errors="surrogateescape")
        self._out.clear()
        return text

    def type(self, text: str, *, cut: bool = False) -> str:
        data = text.encode(errors="surrogateescape")
        asyncio.run(self._feed([data[at : at + 1] for at in range(len(data))] if cut else [data]))
        return self.shown()

    async def _feed(self, pieces: Iterable[bytes]) -> None:
        for piece in pieces:
            await self.session.feed(piece)

    def leave(self) -> None:
        """The line is cut in good order, or the session has ended."""
        if self.session.quitted:
            self._bench.device.keep(self.caller)
        self._bench.device.logout(self.caller, clean=True)
