"""Time that jumps, and a client on librouteros' codec that can say several sentences at once."""

import asyncio
import selectors
import ssl
from collections.abc import Coroutine, Mapping
from pathlib import Path
from types import TracebackType
from typing import Any, Self, TypeVar

from librouteros import async_create_transport
from librouteros.protocol import AsyncApiProtocol, encode_sentence

from atlantis_netcfg.emulator.routeros import EmulatedRouter, RouterLink, RouterSpec, User, WireBehaviour

T = TypeVar("T")
PASSWORD = "open sesame"
Reply = tuple[str, tuple[str, ...]]


class _Selector(selectors.DefaultSelector):
    """Never waits: when no socket has anything, the clock jumps to the next timer."""

    now = 1000.0

    def select(self, timeout: float | None = None) -> list[tuple[selectors.SelectorKey, int]]:
        ready = super().select(0) or super().select(0.0005)
        if ready or timeout == 0:
            return ready
        if timeout is None:
            raise RuntimeError("nothing can ever happen any more")
        self.now += timeout
        return []


class _Loop(asyncio.SelectorEventLoop):
    def __init__(self) -> None:
        self._jumping = _Selector()
        super().__init__(self._jumping)

    def time(self) -> float:
        return self._jumping.now


def run(main: Coroutine[Any, Any, T]) -> T:
    """Like asyncio.run, in time that jumps; both ends of every socket have to live in `main`."""
    with asyncio.Runner(loop_factory=_Loop) as runner:
        return runner.run(main)


def trusting() -> ssl.SSLContext:
    """For clients that do not check the twin's certificate."""
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    context.check_hostname = False
    context.verify_mode = ssl.CERT_NONE
    return context


class Client:
    """Sentences to a twin and back, without waiting in between unless told to."""

    def __init__(self, router: EmulatedRouter, service: str = "api") -> None:
        self.router = router
        self.service = service
        self.transport: Any
        self.protocol: Any

    async def __aenter__(self) -> Self:
        self.transport = await async_create_transport(
            self.router.host,
            port=self.router.ports[self.service],
            saddr=None,
            timeout=10000,
            ssl_wrapper=trusting() if self.service == "api-ssl" else None,
        )
        self.protocol = AsyncApiProtocol(self.transport, "utf-8")
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.transport.writer.transport.abort()

    def write(self, *sentences: tuple[str, ...]) -> None:
        self.raw(b"".join(encode_sentence(*words, encoding="utf-8") for words in sentences))

    def raw(self, data: bytes) -> None:
        self.transport.writer.write(data)

    async def read(self) -> Reply:
        kind, words = await self.protocol.readSentence()
        return kind, words

    async def answer(self) -> list[Reply]:
        """Reply sentences up to the next `!done`."""
        replies = [await self.read()]
        while replies[-1][0] != "!done":
            replies.append(await self.read())
        return replies

    async def talk(self, *words: str) -> list[Reply]:
        self.write(words)
        return await self.answer()

    async def login(self, user: str = "provision", password: str = PASSWORD) -> list[Reply]:
        return await self.talk("/login", f"=name={user}", f"=password={password}")

    async def ends(self) -> bool:
        """True once the twin has closed the connection in good order, False after a reset."""
        try:
            return not await self.transport.reader.read()
        except ConnectionResetError:
            return False

    @property
    def silent(self) -> bool:
        """Nothing has come that was not read, and the connection stands."""
        reader: Any = self.transport.reader
        return not reader._buffer and not reader.at_eof() and reader.exception() is None


def row(reply: Reply) -> Mapping[str, str]:
    return dict(word[1:].split("=", 1) for word in reply[1] if word.startswith("="))


def router_spec(**changes: Any) -> RouterSpec:  # noqa: ANN401 - fields of RouterSpec
    return RouterSpec(name="router", users=(User(name="provision", password=PASSWORD),), **changes)


def router(
    tmp_path: Path,
    *,
    link: RouterLink | None = None,
    knobs: WireBehaviour | None = None,
    **changes: Any,  # noqa: ANN401 - any field of a specification
) -> EmulatedRouter:
    return EmulatedRouter(router_spec(**changes), state_dir=tmp_path / "flash", link=link, knobs=knobs)


def now() -> float:
    return asyncio.get_running_loop().time()
