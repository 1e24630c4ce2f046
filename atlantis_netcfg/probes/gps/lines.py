"""Lines out of a stream, each with the time at which its end came."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterator

    from atlantis_netcfg.probes.answers import Transcript

__all__ = ["lines"]


def lines(heard: Transcript) -> Iterator[tuple[float, bytes]]:
    r"""Give whole lines without their end (`\n`, `\r\n`); what the end of the listening has cut off is left out."""
    pieces: list[bytes] = []
    for at_s, data in heard.chunks:
        first, *others = data.split(b"\n")
        pieces.append(first)
        for other in others:
            yield at_s, b"".join(pieces).rstrip(b"\r")
            pieces = [other]
