"""Where a modem is reached, and the one question that serves every item that reads it.

A modem serves one client, and a vehicle's acoustic and USBL columns often mean the same one: everything that they
and the comparison of the fleet want to know is asked in one script with one listening, which is identical for
all of them and therefore asked once.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from atlantis_netcfg.checklist.probes.acoustic import evologics, seatrac
from atlantis_netcfg.checklist.probes.acoustic.allowed import ask_at, ask_seatrac
from atlantis_netcfg.checklist.probes.cell import Cell
from atlantis_netcfg.checklist.probes.requests import Listen, Place
from atlantis_netcfg.declaration.model import AcousticDriver, AcousticEndpoint, Column, UsblEndpoint

if TYPE_CHECKING:
    from collections.abc import Iterator

    from atlantis_netcfg.checklist.probes.requests import Say

__all__ = ["WATER", "Modem", "declared_address", "modem_of", "modems", "question"]

WATER = "water"
"""The turn of what transmits: one at a time, or they drown each other."""
_FIXES = 3
"""So many of each expected address are enough: listening ends."""
_BAUD = {AcousticDriver.EVOLOGICS: 19200, AcousticDriver.SEATRAC: 115200}
_QUERIES = ("AT?S", "AT&V", "AT?AL", "AT?L", "AT?ZU", "AT?E", "AT?I", "AT?T", "ATI0", "ATI1", "AT?BV")
"""What matters most comes first: after a query that is not answered no other is asked."""
_NUMBERS = (seatrac.ALIVE, seatrac.INFO, seatrac.SETTINGS, seatrac.STATUS, seatrac.TRANSCEIVER)


@dataclass(frozen=True, slots=True)
class Modem:
    """One end that a script goes to."""

    driver: AcousticDriver
    place: Place
    address: str
    port: int
    device: str
    baud: int

    @property
    def where(self) -> str:
        """In words: `10.64.1.21:9200`, `/dev/ttyUSB0 of the gateway`."""
        computer = "this laptop" if self.place is Place.LAPTOP else "the gateway"
        return f"{self.device} of {computer}" if self.device else f"{self.address}:{self.port}"

    def listen(
        self, name: str, say: tuple[Say, ...], *, listen_s: float, enough: bytes = b"", turn: str = ""
    ) -> Listen:
        """A script for it."""
        return Listen(
            name=name,
            place=self.place,
            transport="serial" if self.device else "tcp",
            address=self.address,
            port=self.port,
            device=self.device,
            baud=self.baud,
            say=say,
            listen_s=listen_s,
            enough=enough,
            turn=turn,
        )


def modem_of(cell: Cell) -> Modem | None:
    """The modem of a cell in the columns acoustic and USBL; None: none is declared, or nobody says where it is."""
    endpoint = _endpoint(cell)
    if endpoint is None:
        return None
    place = cell.place(endpoint.seen_from)
    if endpoint.device is not None:
        return Modem(endpoint.driver, place, "", 0, endpoint.device, endpoint.baud or _BAUD[endpoint.driver])
    address = cell.address(endpoint.address)
    return Modem(endpoint.driver, place, address, endpoint.port, "", 0) if address else None


def _endpoint(cell: Cell) -> AcousticEndpoint | UsblEndpoint | None:
    return cell.endpoints.usbl if cell.endpoint == Column.USBL else cell.endpoints.acoustic


def modems(cell: Cell, column: Column) -> Iterator[tuple[Cell, Modem]]:
    """The modems of all rows that are tested at the site, with their cells; the site's own comes last."""
    here = cell.declared.checklist.vehicles
    for row in (*(key for key in cell.declaration.vehicles if here is None or key in here), None):
        other = Cell(cell.declaration, cell.site, row, column)
        if modem := modem_of(other):
            yield other, modem


def declared_address(cell: Cell, modem: Modem) -> int | None:
    """The acoustic address of a modem, as the acoustic column of any row declares it; None: nobody does."""
    same = (other.endpoints.acoustic for other, its in modems(cell, Column.ACOUSTIC) if its == modem)
    return next(
        (
            endpoint.acoustic_address
            for endpoint in same
            if endpoint is not None and endpoint.acoustic_address is not None
        ),
        None,
    )


def question(cell: Cell, modem: Modem) -> Listen:
    """What is asked of a modem, whoever wants to know: reading queries, then the longest listening that is wanted."""
    usbl = [item.endpoints.usbl for item, other in modems(cell, Column.USBL) if other == modem]
    expected = [endpoint for endpoint in usbl if endpoint is not None]
    return modem.listen(
        f"modem at {modem.where}",
        _script(modem.driver),
        listen_s=max((endpoint.listen_s for endpoint in expected), default=0.0),
        enough=_enough(modem.driver, expected),
    )


def _script(driver: AcousticDriver) -> tuple[Say, ...]:
    if driver is AcousticDriver.SEATRAC:
        return tuple(ask_seatrac(number, rb"(?i)\$%02X[0-9A-F]+[\r\n]" % number) for number in _NUMBERS)
    return tuple(ask_at(query, evologics.answered(query)) for query in _QUERIES)


def _enough(driver: AcousticDriver, desired: list[UsblEndpoint]) -> bytes:
    """Some whole fixes of every address that is expected; nothing, where nobody listens for any."""
    expected = sorted({address for endpoint in desired for address in endpoint.hears})
    remotes: list[int | None] = list(expected)
    if any(not endpoint.hears for endpoint in desired):
        remotes.append(None)
    seen = b"".join(b"(?=(?:.*?%b){%d})" % (_fix_of(driver, remote), _FIXES) for remote in remotes)
    if not seen or driver is AcousticDriver.SEATRAC:
        return rb"(?s)\A" + seen if seen else b""
    # Whose output of fixes is switched off need not be listened to.
    return rb"(?s)\A(?:%b|.*?\+\+\+AT\?ZU:1:0\r\n)" % seen


def _fix_of(driver: AcousticDriver, remote: int | None) -> bytes:
    if driver is AcousticDriver.SEATRAC:
        return rb"\$(?:42|52)[0-9A-Fa-f]{2}%b[0-9A-Fa-f]+[\r\n]" % (
            rb"[0-9A-Fa-f]{2}" if remote is None else rb"(?i:%02X)" % remote
        )
    return rb"USBL(?:LONG|ANGLES),[^,\r\n]*,[^,\r\n]*,%b,[^\r\n]*\r?\n" % (
        rb"\d+" if remote is None else b"%d" % remote
    )
