"""What a measurement may use: bytes on the wire, seconds, money. Every transmission asks first.

A packet is charged before it is sent, together with the longest answer that it can bring, and what does not come back
is not refunded: a provider may bill it. So a budget is never exceeded, except by copies of answers that the link
itself makes. The end of a measurement, in which late answers are awaited, is charged beforehand as well. Which session
a provider bills is not known here: each measurement is priced as a session of its own, as `bearers.cost` does
everywhere.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import TYPE_CHECKING, Final

from atlantis_netcfg.bearers.cost import Bill, Tariff, bill
from atlantis_netcfg.core.errors import UsageError

if TYPE_CHECKING:
    from collections.abc import Callable
    from decimal import Decimal

IPV4_HEADERS: Final = 28
"""IPv4 without options, and UDP."""
IPV6_HEADERS: Final = 48


class BudgetError(UsageError, ValueError):
    """The budget cannot be kept as it is given."""


class BudgetLimit(StrEnum):
    """What is used up."""

    BYTES = "bytes"
    SECONDS = "seconds"
    MONEY = "money"


@dataclass(frozen=True, slots=True)
class Budget:
    """None: no limit of that kind. BudgetError: money is limited, and nobody has declared a tariff."""

    max_bytes: int | None = None
    """IP and UDP headers included, both directions."""
    max_seconds: float | None = None
    max_price: Decimal | None = None
    tariff: Tariff | None = None
    closing_s: float = 0.0
    """How long answers are awaited after the last packet."""

    def __post_init__(self) -> None:
        if self.max_price is not None and self.tariff is None:
            raise BudgetError("a limit in money needs the tariff of the link (`billing` of the bearer)")

    def limit(self, size: int, seconds: float) -> BudgetLimit | None:
        """Say which limit a session of so many bytes and seconds would exceed."""
        return self._limit(size, seconds + self.closing_s)

    def limit_now(self, size: int, seconds: float) -> BudgetLimit | None:
        """Say the same of a session that ends at this moment."""
        return self._limit(size, seconds)

    def _limit(self, size: int, lasts: float) -> BudgetLimit | None:
        if self.max_bytes is not None and size > self.max_bytes:
            return BudgetLimit.BYTES
        if self.max_seconds is not None and lasts > self.max_seconds:
            return BudgetLimit.SECONDS
        if self.max_price is not None:
            price = bill(size, lasts, self.tariff).price
            if price is None or price > self.max_price:
                return BudgetLimit.MONEY
        return None


class BudgetGuard:
    """Counts what a measurement uses from now on. Several streams and stages of a run share one guard."""

    def __init__(self, budget: Budget, now_s: Callable[[], float], headers: int = IPV4_HEADERS) -> None:
        self.budget = budget
        self.limited_by: BudgetLimit | None = None
        """What refused a packet; once set, every packet is refused."""
        self.sent_bytes = 0
        self.received_bytes = 0
        self.last_s: float | None = None
        """When the last packet was admitted."""
        self._charged = 0
        self._now = now_s
        self._begin = now_s()
        self._headers = headers

    @property
    def seconds(self) -> float:
        """Since the guard was made."""
        return self._now() - self._begin

    def admit(self, request: int, answer: int) -> bool:
        """Charge a UDP payload to send and the longest that may come back (0: none); False: it may not be sent."""
        if self.limited_by is None:
            size = request + self._headers + (answer + self._headers if answer else 0)
            self.limited_by = self.budget.limit(self._charged + size, self.seconds)
            if self.limited_by is None:
                self._charged += size
                self.sent_bytes += request + self._headers
                self.last_s = self.seconds
                return True
        return False

    def expires(self, within_s: float) -> bool:
        """Whether waiting for so long would exceed the budget: time costs, also where nothing is sent."""
        if self.limited_by is None:
            self.limited_by = self.budget.limit_now(self._charged, self.seconds + within_s)
        return self.limited_by is not None

    @property
    def closing_left_s(self) -> float:
        """How long answers to the last packet may still be awaited."""
        return 0.0 if self.last_s is None else max(0.0, self.last_s + self.budget.closing_s - self.seconds)

    def count(self, answer: int, charged: int) -> None:
        """Count a UDP payload that came, of which so much had been charged (0: nobody asked for it)."""
        size = answer + self._headers
        self.received_bytes += size
        self._charged += size - (charged + self._headers if charged else 0)

    def spent(self) -> Bill:
        """Price what has passed up to now: what was sent, and what came."""
        return bill(self.sent_bytes + self.received_bytes, self.seconds, self.budget.tariff)
