"""The budget of a measurement: bytes on the wire, seconds, money; it is checked before every transmission.

A packet is charged before it is sent, together with every response it can cause, and a missing response is not
refunded: a provider may bill it. For a copy that the link may make of each response, room is kept until a second after
its arrival. So a budget is never exceeded by more than one packet. The end of a measurement, when late responses are
awaited, is charged in advance as well. Which sessions a provider bills is not known here: each measurement is priced
as a separate session, as `links.cost` does everywhere.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from enum import StrEnum
from typing import TYPE_CHECKING, Final

from atlantis_netcfg.core.errors import UsageError
from atlantis_netcfg.links import cost

if TYPE_CHECKING:
    from collections.abc import Callable
    from decimal import Decimal

IPV4_HEADERS: Final = 28
"""Octets of the headers of IPv4 without options, and UDP."""
IPV6_HEADERS: Final = 48
VPN_HEADERS: Final = 52
"""OpenVPN's overhead per packet over UDP with an AEAD cipher: IPv4 and UDP again, opcode and peer, number, tag."""
COPY_S: Final = 1.0
"""Seconds after a response in which the link may still deliver a duplicate of it."""


class BudgetError(UsageError, ValueError):
    """The budget cannot be enforced as given."""


class BudgetLimit(StrEnum):
    """The limit that has been reached."""

    BYTES = "bytes"
    SECONDS = "seconds"
    MONEY = "money"


@dataclass(frozen=True, slots=True)
class Budget:
    """Limits of a measurement; None means no limit. Raises BudgetError if money is limited without a tariff."""

    max_bytes: int | None = None
    """Maximum number of bytes in both directions, IP and UDP headers included."""
    max_seconds: float | None = None
    max_price: Decimal | None = None
    tariff: cost.Tariff | None = None
    closing_s: float = 0.0
    """Seconds to wait for responses after the last packet."""

    def __post_init__(self) -> None:
        if self.max_price is not None and self.tariff is None:
            raise BudgetError("a limit in money needs the tariff of the link (`billing` of the bearer)")

    def limit(self, size: int, seconds: float) -> BudgetLimit | None:
        """Return the limit that a session of so many bytes and seconds would exceed, including its closing time."""
        return self._limit(size, seconds + self.closing_s)

    def limit_now(self, size: int, seconds: float) -> BudgetLimit | None:
        """Return the limit that a session ending now would exceed."""
        return self._limit(size, seconds)

    def _limit(self, size: int, lasts: float) -> BudgetLimit | None:
        if self.max_bytes is not None and size > self.max_bytes:
            return BudgetLimit.BYTES
        if self.max_seconds is not None and lasts > self.max_seconds:
            return BudgetLimit.SECONDS
        if self.max_price is not None:
            price = cost.bill(size, lasts, self.tariff).price
            if price is None or price > self.max_price:
                return BudgetLimit.MONEY
        return None


class BudgetGuard:
    """A counter of what a measurement uses; several streams and stages of a run share one guard."""

    def __init__(self, budget: Budget, now_s: Callable[[], float], headers: int = IPV4_HEADERS) -> None:
        self.budget = budget
        self.limited_by: BudgetLimit | None = None
        """The limit that refused a packet; once set, every packet is refused."""
        self.sent_bytes = 0
        self.received_bytes = 0
        self._charged = 0
        self._now = now_s
        self._begin = now_s()
        self._headers = headers
        self._answers_until_s: float | None = None
        """Time by which the far end has sent the last requested response; None: nothing was sent yet."""
        self._awaited: deque[tuple[float, int]] = deque()
        """Expected responses in the order of sending: time until which each may arrive, and its octets."""
        self._arrived: deque[tuple[float, int]] = deque()
        """Received responses that may be duplicated: time until which a duplicate may arrive, and its octets."""
        self._copies = 0
        """Sum of the octets in `_awaited` and `_arrived`."""

    @property
    def seconds(self) -> float:
        """Seconds since the guard was created."""
        return self._now() - self._begin

    def admit(self, request: int, answer: int, answers: int = 1, answer_s: float = 0.0) -> bool:
        """Charge a UDP payload and all its possible responses (0: none); return False if it must not be sent.

        `answers`: the number of response datagrams; `answer_s`: how long the far end sends them.
        """
        if self.limited_by is not None:
            return False
        seconds = self.seconds
        back = answer + self._headers * answers if answer else 0
        size = request + self._headers + back
        # A copy of one packet may exceed the budget; the copies of all that is under way may not.
        copies = self._expected_copies(seconds) + back - back // max(1, answers)
        self.limited_by = self.budget.limit(self._charged + size + copies, seconds + answer_s)
        if self.limited_by is not None:
            return False
        self._charged += size
        self.sent_bytes += request + self._headers
        self._answers_until_s = max(self._answers_until_s or 0.0, seconds + answer_s)
        if back:
            self._awaited.append((seconds + answer_s + max(self.budget.closing_s, COPY_S), back))
            self._copies += back
        return True

    def _expected_copies(self, seconds: float) -> int:
        """Return the bytes that may still arrive if the link duplicates each response."""
        for queue in (self._awaited, self._arrived):
            while queue and queue[0][0] < seconds:
                self._copies -= queue.popleft()[1]
        return self._copies

    def expires(self, within_s: float) -> bool:
        """Return whether waiting this long would exceed the budget: time costs even if nothing is sent."""
        if self.limited_by is None:
            self.limited_by = self.budget.limit_now(self._charged, self.seconds + within_s)
        return self.limited_by is not None

    @property
    def closing_left_s(self) -> float:
        """Seconds for which responses to the last packet may still be awaited."""
        until = self._answers_until_s
        return 0.0 if until is None else max(0.0, until + self.budget.closing_s - self.seconds)

    def count(self, answer: int, charge: int) -> None:
        """Count a received UDP payload and how much of it was charged before (0: it was not requested)."""
        size = answer + self._headers
        self.received_bytes += size
        self._charged += size - (charge + self._headers if charge else 0)
        if charge:
            self._keep_room(size)

    def _keep_room(self, size: int) -> None:
        """Keep room in the budget for a possible duplicate of a response that has arrived."""
        remaining = size
        while remaining and self._awaited:
            until, awaited_bytes = self._awaited.popleft()
            if awaited_bytes > remaining:
                self._awaited.appendleft((until, awaited_bytes - remaining))
            self._copies -= min(awaited_bytes, remaining)
            remaining -= min(awaited_bytes, remaining)
        self._arrived.append((self.seconds + COPY_S, size))
        self._copies += size

    @property
    def charged_bytes(self) -> int:
        """Bytes admitted, including missing responses: they may still arrive, and a provider may bill them."""
        return self._charged

    def current_bill(self) -> cost.Bill:
        """Price the bytes sent and received so far."""
        return cost.bill(self.sent_bytes + self.received_bytes, self.seconds, self.budget.tariff)
