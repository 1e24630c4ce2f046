"""The computer itself: which program answers a command line, and who offers addresses on its segments."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

from atlantis_netcfg.emulator.linux._clock import chronyc, timedatectl
from atlantis_netcfg.emulator.linux._dds import answers
from atlantis_netcfg.emulator.linux._files import cat, openssl
from atlantis_netcfg.emulator.linux._ip import ip
from atlantis_netcfg.emulator.linux._iw import iw
from atlantis_netcfg.emulator.linux._ping import ping

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from atlantis_netcfg.emulator.linux._spec import ComputerSpec, OfferSpec

__all__ = ["Computer"]

Printed = tuple[int, str, str]
NOT_FOUND = 127
"""Of a shell, for a program that is not there (POSIX, 2.8.2)."""


class Computer:
    """Answers without a socket or a process: the seam is the command line, as for SSH."""

    def __init__(self, spec: ComputerSpec, clock: Callable[[], float] = time.time) -> None:
        self.spec = spec
        """May be replaced at any time; the next answer is from the new one."""
        self.heard: list[tuple[str, ...]] = []
        """Every command line that came."""
        self._clock = clock

    @property
    def now(self) -> float:
        """Seconds since 1970 by its own clock."""
        return self._clock() + self.spec.time.offset_s

    def answer(self, argv: Sequence[str]) -> Printed:
        """Exit code, output and error output; 127 for a program that it does not have."""
        self.heard.append(tuple(argv))
        program = argv[0] if argv else ""
        if program in self.spec.lacks or program not in _PROGRAMS:
            return NOT_FOUND, "", f"sh: 1: {program}: not found\n"
        return _PROGRAMS[program](self, argv)

    def offers(self, interface: str, cards: Sequence[str] = ()) -> tuple[OfferSpec, ...] | None:
        """Who answers a DISCOVER on an interface, named by its name or an address of it; None: no such interface.

        It is asked in the name of the interface, of `cards`, and of one that nobody knows.
        """
        one = self.spec.interface(interface)
        if one is None and interface[:1].isdigit():
            one = self.spec.holding(interface)
        if one is None:
            return None
        asked = {card.lower() for card in (one.mac or "", *cards)}
        there = self.spec.dhcp.get(one.name, ()) if one.up else ()
        return tuple(server for server in there if not server.knows or asked & {card.lower() for card in server.knows})

    def participants(self, domain: int, address: str, asked_by: bytes) -> tuple[tuple[str, bytes], ...] | None:
        """Address and messages of the DDS participants that answer one who announces itself to an own address.

        None: no interface has this address.
        """
        if self.spec.holding(address) is None:
            return None
        there = [one for one in self.spec.dds if one.domain == domain]
        return tuple(
            (address, message) for number, one in enumerate(there) for message in answers(number, one, asked_by)
        )


_PROGRAMS: dict[str, Callable[[Computer, Sequence[str]], Printed]] = {
    "cat": lambda computer, argv: cat(computer.spec, argv),
    "chronyc": lambda computer, argv: chronyc(computer.spec, argv, computer.now),
    "ip": lambda computer, argv: ip(computer.spec, argv),
    "iw": lambda computer, argv: iw(computer.spec, argv),
    "openssl": lambda computer, argv: openssl(computer.spec, argv),
    "ping": lambda computer, argv: ping(computer.spec, argv),
    "timedatectl": lambda computer, argv: timedatectl(computer.spec, argv, computer.now),
}
