"""Datagrams that arrive at a port of this computer; nothing is sent, and no port is taken from anybody."""

from __future__ import annotations

import re
import socket
import time
from typing import TYPE_CHECKING, Any

from atlantis_netcfg.checklist.probes.agent._shared import no_answer

if TYPE_CHECKING:
    from atlantis_netcfg.checklist.probes.agent._shared import Sound

__all__ = ["udp"]

_LONGEST = 65535


def udp(question: dict[str, Any], sound: Sound) -> None:
    """Take what arrives at a port. Raises NoAnswer, busy where another program has the port."""
    ends = time.monotonic() + question["listen_s"]
    enough = re.compile(question["enough"].encode("latin-1")) if question["enough"] else None
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as port:
        try:
            # Without SO_REUSEADDR: beside a program that has it, either of the two would lose datagrams.
            port.bind((question["address"], question["port"]))
        except OSError as error:
            raise no_answer(error, f"UDP port {question['port']}") from None
        while not sound.full and (enough is None or not enough.search(sound.data)):
            left = ends - time.monotonic()
            if left <= 0:
                return
            port.settimeout(left)
            try:
                data, source = port.recvfrom(_LONGEST)
                sound.add(data, source[0])
            except socket.timeout:
                return
