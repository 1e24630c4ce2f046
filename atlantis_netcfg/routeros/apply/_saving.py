"""The device's own text of its state, fetched before the first change, and the proof that it runs scripts for us.

An export hides secrets unless asked otherwise, and is not asked otherwise: what is kept on a laptop for years is no
place for them.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from atlantis_netcfg.core.errors import DeviceFailed
from atlantis_netcfg.routeros.api import Command
from atlantis_netcfg.routeros.apply._writer import ScriptWriter, SentenceWriter
from atlantis_netcfg.routeros.commands import executed

if TYPE_CHECKING:
    from collections.abc import Callable

    from atlantis_netcfg.routeros.api import Reply
    from atlantis_netcfg.routeros.apply._job import Channel
    from atlantis_netcfg.routeros.apply._writer import Writer

_END = "atlantis: all of it"
_PROBE = "atlantis"
_NAME = "atlantis-before"
_CHUNK = 32_768

SAVING = (executed(f'/export\n:put "{_END}"\n'), executed(f':put "{_PROBE}"\n'))
"""Commands whose answers `saved` reads; they go wherever a round trip is under way."""


@dataclass(frozen=True, slots=True)
class Saved:
    """What the answers to SAVING hold."""

    text: str | None
    """The whole export, or None if the device does not print it into a script's output."""
    writer: Writer


def saved(export: Reply, probe: Reply) -> Saved:
    """Read the answers to SAVING."""
    text = _whole(export.ret or "") if export.trap is None else None
    runs = text is not None or (probe.trap is None and (probe.ret or "").strip() == _PROBE)
    return Saved(text, ScriptWriter() if runs else SentenceWriter())


async def fetch(session: Channel, instead: Callable[[], str] | None = None) -> str:
    """Get the export by way of a file on the device, or what is to be saved `instead` of it.

    Before RouterOS 7.13 no file can be read over the API. Raises DeviceFailed if nothing can be saved.
    """
    try:
        return await _exported(session)
    except DeviceFailed:
        if instead is None:
            raise
        return instead()


async def _exported(session: Channel) -> str:
    made = await session.command(Command("/export", (("file", _NAME),)))
    if made.trap is not None:
        raise _impossible(made.trap.message)
    data = b""
    while True:
        chunk = await _chunk(session, len(data))
        data += chunk
        if len(chunk) < _CHUNK:
            break
    await session.command(Command("/file/remove", ((".id", f"{_NAME}.rsc"),)))
    text = data.decode(errors="replace")
    if not text.lstrip().startswith("#"):
        raise _impossible("its export is empty")
    return text


async def _chunk(session: Channel, offset: int) -> bytes:
    arguments = (("file", f"{_NAME}.rsc"), ("offset", str(offset)), ("chunk-size", str(_CHUNK)))
    reply = await session.command(Command("/file/read", arguments))
    if reply.trap is not None:
        raise _impossible(reply.trap.message)
    return "".join(row.get("data", "") for row in reply.rows).encode(errors="surrogateescape")


def _whole(text: str) -> str | None:
    """Return an export that was not cut off, with one newline at its end."""
    body, found, rest = text.replace("\r\n", "\n").rpartition(_END)
    if not found or rest.strip() or not body.lstrip().startswith("#"):
        return None
    return body.strip() + "\n"


def _impossible(words: str) -> DeviceFailed:
    return DeviceFailed(f"the state before the change cannot be saved, so nothing is changed; the device says: {words}")
