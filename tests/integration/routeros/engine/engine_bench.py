"""The engine against a router twin on real sockets, in one event loop and in time that jumps."""

import asyncio
import selectors
import time
from collections.abc import Callable, Coroutine, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Self, TypeVar

from atlantis_netcfg.core.events import Event
from atlantis_netcfg.core.secret import Secret
from atlantis_netcfg.emulator.routeros import EmulatedRouter, RouterLink, RouterSpec, User, WireBehaviour
from atlantis_netcfg.emulator.routeros.wire.link import Faults
from atlantis_netcfg.routeros import DeviceJob, DeviceResult, Endpoint, JobMode, converge, desired
from atlantis_netcfg.routeros.api import Command, Reply, Session
from atlantis_netcfg.routeros.apply import Channel, SshEndpoint
from atlantis_netcfg.runs import Journal, RunStart, Store

T = TypeVar("T")
PASSWORD = "open sesame"

TEXT = """\
# atlantis:entire /ip firewall filter
/system identity
set name=coastal-router
/interface bridge
add comment="atlantis: lan" name=bridge-lan
/interface bridge port
add bridge=bridge-lan comment="atlantis: lan" interface=ether4
add bridge=bridge-lan comment="atlantis: lan" interface=ether5
/interface list
add comment="atlantis: uplinks" name=WAN
/interface list member
add comment="atlantis: cable" interface=ether1 list=WAN
/ip address
add address=10.64.101.1/24 comment="atlantis: management" interface=ether8
add address=10.64.1.1/24 comment="atlantis: lan" interface=bridge-lan
/ip pool
add comment="atlantis: lan" name=lan ranges=10.64.1.100-10.64.1.199
/ip dhcp-server
add address-pool=lan comment="atlantis: lan" interface=bridge-lan lease-time=1h name=lan
/ip dhcp-server network
add address=10.64.1.0/24 comment="atlantis: lan" dns-server=10.64.1.1 gateway=10.64.1.1
/ip dhcp-server lease
add address=10.64.1.20 comment="atlantis: gateway" mac-address=02:00:00:00:01:20 server=lan
/ip firewall address-list
add address=192.0.2.10 comment="atlantis: vpn" list=sat-allow
/ip firewall filter
add action=accept chain=input comment="atlantis: known" connection-state=established,related
add action=accept chain=input comment="atlantis: management" in-interface=ether8
add action=accept chain=input comment="atlantis: lan" in-interface=bridge-lan protocol=icmp
add action=drop chain=input comment="atlantis: rest"
add action=drop chain=forward comment="atlantis: costs \\"$\\"; & more" dst-address-list=!sat-allow out-interface=ether3
/ip firewall nat
add action=masquerade chain=srcnat comment="atlantis: uplinks" out-interface-list=WAN
/ip service
set telnet disabled=yes
set ftp disabled=yes
/tool mac-server
set allowed-interface-list=none
"""
"""A first configuration: every layer, every kind of menu."""


_STILL_S = 30.0


class _Selector(selectors.DefaultSelector):
    """Never waits: when no socket has anything, the clock jumps to the next timer."""

    now = 1000.0
    threads = 0
    """How many are at work."""

    def select(self, timeout: float | None = None) -> list[tuple[selectors.SelectorKey, int]]:
        if self.threads:
            return self._in_real_time(timeout)
        ready = super().select(0) or super().select(0.0005)
        if ready or timeout == 0:
            return ready
        if timeout is None:
            ready = super().select(_STILL_S)  # a client's own thread may be about to say something
            if ready:
                return ready
            raise RuntimeError("nothing can ever happen any more")
        self.now += timeout
        return []

    def _in_real_time(self, timeout: float | None) -> list[tuple[selectors.SelectorKey, int]]:
        """Somebody works in a thread, and does not see our clock."""
        begun = time.monotonic()
        ready = super().select(0.01 if timeout is None else min(timeout, 0.01))
        self.now += time.monotonic() - begun
        return ready


class _Loop(asyncio.SelectorEventLoop):
    def __init__(self) -> None:
        self._jumping = _Selector()
        super().__init__(self._jumping)

    def time(self) -> float:
        return self._jumping.now

    def run_in_executor(self, *given: Any, **named: Any) -> asyncio.Future[Any]:  # type: ignore[override] # noqa: ANN401
        self._jumping.threads += 1
        work = super().run_in_executor(*given, **named)
        work.add_done_callback(self._done)
        return work

    def _done(self, _: object) -> None:
        self._jumping.threads -= 1


def run(main: Coroutine[Any, Any, T]) -> T:
    """Like asyncio.run, in time that jumps; both ends of every socket have to live in `main`."""
    with asyncio.Runner(loop_factory=_Loop) as runner:
        return runner.run(main)


def leases(number: int) -> str:
    """So many DHCP reservations more."""
    rows = (
        f'add address=10.64.{2 + each // 250}.{1 + each % 250} comment="atlantis: robot {each}"'
        f" mac-address=02:00:00:01:{each // 256:02X}:{each % 256:02X} server=lan\n"
        for each in range(number)
    )
    return "/ip dhcp-server lease\n" + "".join(rows)


@dataclass
class Bench:
    """A twin and what is needed to converge it; `async with` it."""

    tmp_path: Path
    text: str = TEXT
    link: RouterLink | None = None
    knobs: WireBehaviour | None = None
    spec: dict[str, Any] = field(default_factory=dict)
    events: list[Event] = field(default_factory=list)
    router: EmulatedRouter = field(init=False)

    def __post_init__(self) -> None:
        users = (User(name="provision", password=PASSWORD),)
        spec = RouterSpec(**{"name": "router", "users": users, **self.spec})
        self.router = EmulatedRouter(spec, state_dir=self.tmp_path / "flash", link=self.link, knobs=self.knobs)

    async def __aenter__(self) -> Self:
        await self.router.start()
        return self

    async def __aexit__(self, *_: object) -> None:
        await self.router.stop()

    @property
    def store(self) -> Store:
        return Store(self.tmp_path / "state")

    def export(self) -> str:
        """The router's configuration with its secrets, without the header, whose clock moves."""
        return without_header(self.router.export(show_sensitive=True))

    def job(self, **changes: Any) -> DeviceJob:  # noqa: ANN401 - fields of DeviceJob
        endpoint = Endpoint(
            host=self.router.host,
            port=self.router.ports.get("api-ssl", 0),
            user="provision",
            password=Secret(PASSWORD),
            pin=self.router.pin,
        )
        standard = {
            "name": "router",
            "site": "coastal",
            "address": self.router.spec.management.local,
            "endpoint": endpoint,
            "desired_state": desired.read(self.text),
            "events": self.events.append,
        }
        return DeviceJob(**{**standard, **changes})

    @property
    def ssh(self) -> SshEndpoint:
        """The twin's console."""
        port = self.router.ports.get("ssh", 0)
        return SshEndpoint(self.router.host, port, "provision", Secret(PASSWORD), self.router.host_key)

    def journal(self) -> Journal:
        return self.store.start(
            RunStart(site="coastal", revision="", tool="", hosts=("router",), rehearsed=False, command="provision")
        )

    async def converge(self, mode: JobMode = JobMode.APPLY, **changes: Any) -> DeviceResult:  # noqa: ANN401 - as `job`
        """Converge with a journal of its own."""
        with self.journal() as journal:
            return await converge(self.job(**{"journal": journal, **changes}), mode=mode)


@dataclass
class Meddler:
    """Somebody who does something to the twin beside the n-th sentence with a path, before or after it is executed."""

    path: str
    act: Callable[[], Coroutine[Any, Any, object]]
    nth: int = 1
    after: bool = True
    count: int = 0

    async def connect(self, endpoint: Endpoint) -> Channel:
        """In place of `Session.open`."""
        return _Meddled(await Session.open(endpoint), self)


class _Meddled:
    def __init__(self, session: Session, meddler: Meddler) -> None:
        self.traffic = session.traffic
        self._session = session
        self._meddler = meddler

    async def command(self, command: Command, *, silence_s: float | None = None) -> Reply:
        (reply,) = await self.flight([command], silence_s=silence_s)
        return reply

    async def flight(self, commands: Sequence[Command], *, silence_s: float | None = None) -> list[Reply]:
        meddler = self._meddler
        here = sum(Faults.command(command.words()) == meddler.path for command in commands)
        strikes = meddler.count < meddler.nth <= meddler.count + here
        meddler.count += here
        if strikes and not meddler.after:
            await meddler.act()
        replies = await self._session.flight(commands, silence_s=silence_s)
        if strikes and meddler.after:
            await meddler.act()
        return replies

    async def close(self, *, wait: bool = True) -> None:
        await self._session.close(wait=wait)


def without_header(text: str) -> str:
    return "".join(line for line in text.splitlines(keepends=True) if not line.startswith("#"))


def on(bench: Bench, act: Callable[[Bench], Coroutine[Any, Any, T]]) -> T:
    """Run `act` on a bench whose twin is up."""

    async def main() -> T:
        async with bench:
            return await act(bench)

    return run(main())
