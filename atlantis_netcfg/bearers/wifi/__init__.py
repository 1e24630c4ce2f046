"""The Wi-Fi bridge: what both families of RouterOS' radio menus say, in one record, and what is wrong in words."""

from __future__ import annotations

from atlantis_netcfg.bearers.wifi.judge import WifiWanted, judge, link_state, quality
from atlantis_netcfg.bearers.wifi.read import queries, read
from atlantis_netcfg.bearers.wifi.record import Condition, Family, WifiPeer, WifiReading

__all__ = [
    "Condition",
    "Family",
    "WifiPeer",
    "WifiReading",
    "WifiWanted",
    "judge",
    "link_state",
    "quality",
    "queries",
    "read",
]
