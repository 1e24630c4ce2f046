"""One command on a connection of an emulated router: counted, delayed, run, and changed by scheduled faults."""

from __future__ import annotations

import asyncio
from dataclasses import replace
from typing import TYPE_CHECKING, Protocol

from atlantis_netcfg.emulator.routeros.device import ConsoleReply
from atlantis_netcfg.emulator.routeros.wire import link

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from atlantis_netcfg.emulator.routeros.wire.host import RouterHost


class ConnectionLost(Exception):
    """The connection has ended during the work, which must stop."""


class _PipeTransport(Protocol):
    tally: link.TrafficCounters

    @property
    def over(self) -> bool: ...

    def drop(self) -> None: ...

    def vanish(self) -> None: ...


class WorkItem:
    """Runs commands of a channel on the device, with delays and faults."""

    def __init__(self, host: RouterHost, wire: _PipeTransport) -> None:
        self._host = host
        self._wire = wire

    async def run(self, line: str, action: Callable[[], ConsoleReply]) -> ConsoleReply:
        """Run `action`, requested by `line`. Raises ConnectionLost; may hang for ever because of a fault."""
        faults = await self.begin(line)
        reply = action()
        await self.end(faults)
        return _apply_reply_faults(faults, reply)

    async def begin(self, line: str) -> list[link.LinkFault]:
        """Count the command and apply delays and faults before it; return the faults."""
        self._wire.tally.counters.sentences += 1
        self._wire.tally.sentences.append(link.mask_words((line,)))
        faults = self._host.upon(line)
        await self._apply_faults(faults, "before")
        await asyncio.sleep(self._host.pace.wait_s(self._host.knobs, asyncio.get_running_loop().time()))
        self._require_connection()
        return faults

    async def end(self, faults: Sequence[link.LinkFault]) -> None:
        """Apply the changes, notify sessions, and apply faults before the response."""
        await self._host.settle()
        self._host.tell()
        await self._apply_faults(faults, "after")
        self._require_connection()

    def _require_connection(self) -> None:
        if self._wire.over:
            raise ConnectionLost

    async def _apply_faults(self, faults: Sequence[link.LinkFault], when: str) -> None:
        for fault in faults:
            if fault.when != when:
                continue
            if fault.do is link.FaultKind.DROP:
                self._wire.drop()
            elif fault.do is link.FaultKind.VANISH:
                self._wire.vanish()
            elif fault.do is link.FaultKind.HANG:
                await asyncio.Event().wait()
            else:
                self._host.strike(fault)


def _apply_reply_faults(faults: Sequence[link.LinkFault], reply: ConsoleReply) -> ConsoleReply:
    text = reply.text
    for fault in faults:
        at = fault.offset
        if fault.do is link.FaultKind.TRUNCATE:
            return ConsoleReply(text[: len(text) // 2 if at is None else at], over=True)
        if fault.do is link.FaultKind.GARBAGE:
            garbage = bytes.fromhex(fault.data).decode(errors="surrogateescape")
            return replace(reply, text=text[: at or 0] + garbage + text[at or 0 :])
    return reply
