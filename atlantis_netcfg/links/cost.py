"""Cost of an action over a metered link, before and after it: bytes, billed bytes, money.

The tariff comes from the inventory (`billing:` of a link); its form follows the published fair-use rules of Iridium
Certus 100: a minimum session of 5 kB, and from 300 s on the greater of the bytes carried and 300 bytes a second.
Whether another plan has such a floor is stated in its contract. An action is priced as a separate session, which is
the upper bound: where the terminal keeps one session open all day, the action adds no more than its own bytes.
Nothing here does I/O.
"""

from __future__ import annotations

from dataclasses import dataclass
from decimal import ROUND_CEILING, Decimal
from enum import StrEnum
from typing import TYPE_CHECKING, Final

from atlantis_netcfg.core.errors import DeviceError
from atlantis_netcfg.core.messages import arg, join, msg

if TYPE_CHECKING:
    from collections.abc import Mapping

ACCEPT: Final = "--accept-cost"
"""Flag by which a person consents to costs; `--yes` does not."""
_MB: Final = 1_000_000
_KB: Final = 1_000
_CENT: Final = Decimal("0.01")


class CostRefusal(DeviceError):
    """The action was not agreed to or exceeds the link's cap; nothing was sent for it."""


class Basis(StrEnum):
    """The rule that determined a session's billed bytes."""

    PAYLOAD = "what it carried"
    MINIMUM = "the minimum session"
    FLOOR = "the floor of a long session"


@dataclass(frozen=True, slots=True)
class Tariff:
    """A provider's counting rules and prices; the fields are those of `billing:` in the inventory."""

    price_per_mb: Decimal
    """Price for 10^6 bytes, both directions counted together."""
    currency: str = "EUR"
    min_session_bytes: int = 0
    floor_bytes_per_s: int = 0
    floor_after_s: int = 0
    """Session length in seconds from which the floor applies."""


@dataclass(frozen=True, slots=True)
class MeteredLink:
    """The properties of a link that determine its cost."""

    name: str
    site: str
    is_metered: bool
    tariff: Tariff | None = None
    """Tariff of the link; None: not known."""
    cap_bytes: int | None = None
    """Maximum number of bytes that one action may send; None: no limit."""

    @property
    def cap_key(self) -> str:
        """The inventory key of the cap, for a person who wants to raise it."""
        return msg(f"`cap_mb` of link `{arg(self.name)}` in group_vars/{arg(self.site)}.yml")

    @property
    def tariff_key(self) -> str:
        """The inventory key where the tariff belongs."""
        return msg(f"`billing` of link `{arg(self.name)}` in group_vars/{arg(self.site)}.yml")


@dataclass(frozen=True, slots=True)
class Bill:
    """The billed bytes and the price of a session."""

    payload_bytes: int
    seconds: float
    billed_bytes: int
    basis: Basis
    price: Decimal | None
    """None: the inventory has no tariff."""
    currency: str | None

    @property
    def money(self) -> str:
        """The price as text, rounded up to hundredths."""
        if self.price is None:
            return "price unknown"
        if 0 < self.price < _CENT:
            return msg(f"less than {arg(_CENT)} {arg(self.currency)}")
        return f"{self.price.quantize(_CENT, ROUND_CEILING)} {self.currency}"

    @property
    def words(self) -> str:
        """The bill as text: `61 kB, billed as 75 kB (the floor of a long session), 0.60 EUR`."""
        more = msg(
            f", billed as {arg(size(self.billed_bytes))} ({arg(self.basis)})"
            if self.billed_bytes > self.payload_bytes
            else ""
        )
        return msg(f"{arg(size(self.payload_bytes))}{arg(more)}, {arg(self.money)}")

    def as_dict(self) -> Mapping[str, str | int | float | None]:
        """Return JSON-able data; the price is text, so that no digit is lost."""
        return {
            "payload_bytes": self.payload_bytes,
            "seconds": round(self.seconds, 1),
            "billed_bytes": self.billed_bytes,
            "basis": self.basis.value,
            "price": None if self.price is None else str(self.price),
            "currency": self.currency,
        }


@dataclass(frozen=True, slots=True)
class Preview:
    """The expected cost of an action on a link."""

    link: MeteredLink
    bill: Bill
    at_most: bool = False
    """Whether the cost is an upper bound because the required work is not known yet."""

    @property
    def over_cap(self) -> bool:
        """Whether the action exceeds the cap and is refused even with a person's consent."""
        cap = self.link.cap_bytes
        return self.link.is_metered and cap is not None and self.bill.payload_bytes > cap

    @property
    def words(self) -> str:
        """The expected cost as text, shown before anything is sent."""
        name, at_most = self.link.name, self.at_most
        if not self.link.is_metered:
            whole = size(self.bill.payload_bytes)
            return msg(f"over {arg(name)} (not metered): {'up to' if at_most else 'about'} {arg(whole)}")
        missing = msg("" if self.bill.price is not None else f" ({arg(self.link.tariff_key)} is not set)")
        cost = join("", (self.bill.words, missing))
        return msg(
            f"over metered link {arg(name)} of {arg(self.link.site)}: {'up to' if at_most else 'about'} {arg(cost)}"
        )

    def refusal(self) -> CostRefusal:
        """Return the error for an action beyond the cap."""
        cap = self.link.cap_bytes or 0
        return CostRefusal(
            f"this would send about {arg(size(self.bill.payload_bytes))} over {arg(self.link.name)}; the limit for one "
            f"action is {arg(size(cap))}",
            hint=f"use another link (`via=lan`), or raise {arg(self.link.cap_key)}",
        )

    def as_dict(self) -> Mapping[str, object]:
        """Return JSON-able data."""
        return {
            "bearer": self.link.name,
            "metered": self.link.is_metered,
            "cap_bytes": self.link.cap_bytes,
            "at_most": self.at_most,
            **self.bill.as_dict(),
        }


def bill(nbytes: int, seconds: float, tariff: Tariff | None) -> Bill:
    """Price a session that carried `nbytes` in both directions and lasted `seconds`.

    Without a tariff the bytes are billed as they are, and the price is unknown. If nothing was carried there was no
    session. Raises ValueError for negative values.
    """
    if nbytes < 0 or seconds < 0:
        raise ValueError(msg(f"invalid session: {arg(nbytes)} bytes in {arg(seconds)} s"))
    if tariff is None:
        return Bill(nbytes, seconds, nbytes, Basis.PAYLOAD, None, None)
    billed_bytes, basis = _compute_billed_bytes(nbytes, seconds, tariff)
    return Bill(nbytes, seconds, billed_bytes, basis, tariff.price_per_mb * billed_bytes / _MB, tariff.currency)


def preview(nbytes: int, seconds: float, link: MeteredLink, *, at_most: bool = False) -> Preview:
    """Return the expected cost of an action on a link; raise ValueError for negative bytes or seconds."""
    return Preview(link, bill(nbytes, seconds, link.tariff if link.is_metered else None), at_most)


def size(nbytes: int) -> str:
    """Format a number of bytes in decimal units, as providers bill them: `812 B`, `61 kB`, `12.4 MB`."""
    if nbytes < _KB:
        return f"{nbytes} B"
    # From here on it would be rounded to `1000 kB`.
    if nbytes < _MB - _KB / 2:
        return f"{nbytes / _KB:.0f} kB" if nbytes >= 10 * _KB else f"{nbytes / _KB:.1f} kB"
    return f"{nbytes / _MB:.1f} MB"


def _compute_billed_bytes(nbytes: int, seconds: float, tariff: Tariff) -> tuple[int, Basis]:
    """Return the largest of the applicable byte counts and its rule; a tie counts as payload."""
    if not nbytes:
        return 0, Basis.PAYLOAD
    rules = (
        (nbytes, Basis.PAYLOAD),
        (tariff.min_session_bytes, Basis.MINIMUM),
        (int(tariff.floor_bytes_per_s * seconds) if seconds >= tariff.floor_after_s else 0, Basis.FLOOR),
    )
    return max(rules, key=lambda rule: rule[0])
