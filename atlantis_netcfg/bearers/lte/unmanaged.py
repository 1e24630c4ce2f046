"""A 4G unit that nobody but a person can ask: the reading says so, and what the person has to look for."""

from __future__ import annotations

from atlantis_netcfg.bearers.lte.record import LteReading
from atlantis_netcfg.bearers.status import Finding
from atlantis_netcfg.core.verdicts import Verdict

__all__ = ["LOOK_FOR", "finding", "read"]

LOOK_FOR = (
    "the SIM is found and asks for no PIN",
    "registered (home or roaming), with the operator's name",
    "APN as in the contract, and an IP address",
    "roaming as in the contract",
    "RSRP above -105 dBm, RSRQ above -15 dB, SINR above 0 dB",
)
"""What has to stand on the unit's own page."""


def read() -> LteReading:
    """Everything unknown: nothing was asked."""
    return LteReading(source="manual")


def finding(address: str) -> Finding:
    """Say that a person must look, where, and for what."""
    return Finding(
        Verdict.INCONCLUSIVE,
        "look-yourself",
        f"no driver for this 4G unit: a person must look at its own page, http://{address}/ or as its manual says",
        "look for: " + "; ".join(LOOK_FOR),
    )
