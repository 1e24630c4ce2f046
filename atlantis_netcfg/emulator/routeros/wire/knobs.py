"""What a router does on its wire that no manual promises: order, limits and moods, each a knob.

Assumption: api-tagged-order
Assumption: api-flight-24
Assumption: api-flight-100
Assumption: tls-version
"""

from __future__ import annotations

from typing import Literal

from pydantic import BaseModel, ConfigDict, Field


class WireBehaviour(BaseModel):
    """Behaviour of the router's API service; all times in seconds as the caller wants to wait for them."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    shuffle: int | None = None
    """A seed: tagged sentences that arrived in one burst run in another order and their answers interleave.

    None: in order of arrival.
    """
    hang_at: int | None = Field(default=None, ge=1)
    """The connection falls silent for good when so many sentences are unanswered.

    A CHR 7.22.1 hung at 25 concurrent `/console/inspect` (`tikoci/restraml docs/mikrotik-bug-native-api-inspect.md`).
    """
    hang_writes_at: int | None = Field(default=None, ge=1)
    """The same when so many sentences that are no `print` are unanswered."""
    knee_after: int | None = Field(default=None, ge=0)
    """So many sentences of all connections are answered at once; then each takes `knee_s` until the router was idle.

    Seen on a CHR 7.23.2 after 120 to 220 (`danikf/tik4net Docs/findings-router-throughput-ceiling.md`).
    """
    knee_s: float = Field(default=0.020, ge=0)
    idle_s: float = Field(default=1.0, ge=0)
    stall_every: int | None = Field(default=None, ge=1)
    """Every n-th sentence finds the router busy for `stall_s` (the same source saw 7 s and 30 s)."""
    stall_s: float = Field(default=7.0, ge=0)
    probe_s: float = Field(default=5.0, ge=0)
    """How long a console waits for a terminal to say what it is. Assumption: console-first-login"""
    boot_s: float = Field(default=60.0, ge=0)
    """From a reboot or power cut until the API answers again."""
    old_login: bool = False
    """The login of before 6.43: the new form is answered by a challenge, too."""
    sentences_before_login: int = Field(default=8, ge=1)
    """More without a login end the connection; the manual says that there is a limit, not which.

    Assumption: api-limit-words
    """
    word_before_login: int = Field(default=1024, ge=1)
    """Longest word before login, in bytes."""
    pipelined_login: bool = False
    """Sentences that were sent before the answer to `/login` was there are accepted. Assumption: api-login-pipelined"""
    tls: Literal["1.2", "1.3"] = "1.2"
    """The newest TLS that the router speaks; `/ip/service tls-version` may only lower it."""


class Pace:
    """How long the router keeps a sentence waiting before it runs it; one for all connections."""

    def __init__(self) -> None:
        self._since_idle = 0
        self._total = 0
        self._free_at = 0.0

    def wait_s(self, knobs: WireBehaviour, now: float) -> float:
        """Seconds until the sentence that has its turn now may run."""
        self._total += 1
        if now - self._free_at > knobs.idle_s:
            self._since_idle = 0
        self._since_idle += 1
        self._free_at = max(now, self._free_at) + self._cost_s(knobs)
        return self._free_at - now

    def _cost_s(self, knobs: WireBehaviour) -> float:
        knee = knobs.knee_after is not None and self._since_idle > knobs.knee_after
        stall = knobs.stall_every is not None and self._total % knobs.stall_every == 0
        return (knobs.knee_s if knee else 0.0) + (knobs.stall_s if stall else 0.0)
