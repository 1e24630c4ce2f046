"""How a radio is heard, whoever says it: too little, too much, and one chain less than the other.

Bounds: devices.md, section 8. A receiver saturates at short distance, so there is an upper bound too (a report of two
radios has -27 dBm and 34 % quality at full power, -47 dBm and 94 % reduced). From 10 dB beyond a bound, a tenth or ten
times the power, it no longer passes: our own judgement.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.bearers import Finding
from atlantis_netcfg.core.verdicts import Verdict

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from atlantis_netcfg.declaration.model import WifiEndpoint

__all__ = ["FAR_DB", "IMBALANCE_DB", "judge_chains", "judge_level", "judge_rate"]

FAR_DB = 10.0
IMBALANCE_DB = 6.0


def judge_level(endpoint: WifiEndpoint, level: float | None, who: str, where: str) -> Iterator[Finding]:
    """Compare a level with both bounds. `where` hears `who`."""
    if level is None:
        message = f"{where} does not say how well it hears {who}"
        yield Finding(Verdict.INCONCLUSIVE, "signal-unknown", message, "look at the radio's own page, or ask again")
    elif level < endpoint.low_dbm:
        far = level <= endpoint.low_dbm - FAR_DB
        message = f"{where} hears {who} with {level:g} dBm, below {endpoint.low_dbm:g} dBm"
        hint = "bring both closer or into sight of each other, and look at the antennas and their connectors"
        yield Finding(Verdict.FAIL if far else Verdict.WARN, "signal-weak", message, hint)
    elif level > endpoint.high_dbm:
        far = level >= endpoint.high_dbm + FAR_DB
        message = f"{where} hears {who} with {level:g} dBm, above {endpoint.high_dbm:g} dBm: its receiver is overdriven"
        hint = "move both some metres apart, or reduce the transmit power of the other end"
        yield Finding(Verdict.FAIL if far else Verdict.WARN, "signal-strong", message, hint)


def judge_chains(chains: Sequence[float | None], who: str, where: str) -> Iterator[Finding]:
    """Compare the chains of the receiver with each other."""
    levels = [chain for chain in chains if chain is not None]
    if len(levels) > 1 and max(levels) - min(levels) > IMBALANCE_DB:
        apart = max(levels) - min(levels)
        message = f"the chains of {where} hear {who} {apart:g} dB apart, more than {IMBALANCE_DB:g} dB"
        hint = "check how the antennas stand to each other, then the connector of the weaker chain"
        yield Finding(Verdict.WARN, "chain-imbalance", message, hint)


def judge_rate(
    endpoint: WifiEndpoint, sent: float | None, received: float | None, who: str, where: str
) -> Iterator[Finding]:
    """Compare the rates of the association with the declared floor.

    The rate of sending is the choice of this end's rate control, and counts; what was last received may have been a
    frame of management at the lowest rate, and only warns.
    """
    floor = endpoint.rate_mbps
    if floor is None:
        return
    hint = "look again while traffic flows; then look at level, channel and width"
    if sent is None and received is None:
        message = f"{where} does not say at which rate it is associated with {who}"
        yield Finding(Verdict.INCONCLUSIVE, "rate-unknown", message, hint)
    elif sent is not None and sent < floor:
        message = f"{where} sends to {who} at {sent:g} Mbit/s, below {floor:g} Mbit/s"
        yield Finding(Verdict.FAIL, "rate-low", message, hint)
    elif received is not None and received < floor:
        message = f"{where} last received from {who} at {received:g} Mbit/s, below {floor:g} Mbit/s"
        yield Finding(Verdict.WARN, "rate-low", message, hint)
