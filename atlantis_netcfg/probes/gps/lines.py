"""Lines out of a stream, each with the time at which its end came."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterator

    from atlantis_netcfg.probes.answers import Transcript

__all__ = ["lines"]


def lines(heard: Transcript) -> Iterator[tuple[float, bytes]]:
    r"""Give whole lines without their end (`\n`, `\r\n`); what the end of the listening has cut off is left out."""
    rest = b""
    for at_s, data in heard.chunks:
        *whole, rest = (rest + data).split(b"\n")
        for line in whole:
            yield at_s, line.rstrip(b"\r")
