"""From the rows of `registration-table` and `monitor once` to one record, for both families of menus.

Names of fields and words: Manual, Wireless Interface; Manual, WiFi. The words of `state` in `/interface/wifi/monitor`
are nowhere listed in public: those read here are inferred from the console's texts, and any other is `unknown`.
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from atlantis_netcfg.bearers._text import decibels, megabits, percent, seconds, whole, yes
from atlantis_netcfg.bearers.query import Query
from atlantis_netcfg.bearers.wifi.record import Condition, Family, WifiPeer, WifiReading

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

__all__ = ["queries", "read"]

_WORDS = {
    "disabled": Condition.DISABLED,
    "searching-for-network": Condition.SEARCHING,
    "searching": Condition.SEARCHING,
    "connecting": Condition.SEARCHING,
    "connected-to-ess": Condition.CONNECTED,
    "connected": Condition.CONNECTED,
    "running-ap": Condition.RUNNING,
    "running": Condition.RUNNING,
}
_RADAR = re.compile(r"radar|\bdfs\b|\bcac\b")
_SIGNAL_DBM = (-120.0, -1.0)
"""A level of 0 is what a driver writes that has none."""
_SNR_DB = (0.0, 120.0)
_CHAIN = re.compile(r"signal(?:-strength)?-ch(\d)")
_MHZ = re.compile(r"\d{4}")
_LEFT = re.compile(r"\d+(?:\.\d+)?(?:ms|[wdhms])(?:\d+(?:\.\d+)?(?:ms|[wdhms]))*|\d+:\d\d:\d\d")


def queries(family: Family, interface: str) -> tuple[Query, Query]:
    """What to ask of the device: the registration table, then the radio with this name; the answers go to `read`."""
    menu = f"/interface/{family}"
    return (
        Query(f"{menu}/registration-table", "print"),
        Query(menu, "monitor", (("numbers", interface), ("once", ""))),
    )


def read(
    family: Family,
    registrations: Sequence[Mapping[str, str]] | None,
    monitor: Mapping[str, str] | None,
    interface: str | None = None,
) -> WifiReading:
    """Read what the two queries answered; None: a question that the device refused or did not answer.

    `interface` leaves out what is registered on other radios of the device.
    """
    shown = monitor or {}
    status = _said(shown.get("status")) or _said(shown.get("state"))
    condition = _condition(status)
    mine = [row for row in registrations or () if interface is None or row.get("interface", interface) == interface]
    if not mine and condition is Condition.CONNECTED and "bssid" in shown:
        mine = [{"mac-address": shown["bssid"], "radio-name": shown.get("radio-name", "")}]
    return WifiReading(
        family=family,
        condition=condition,
        status=status,
        channel=_said(shown.get("channel")),
        channel_mhz=_mhz(shown.get("channel")),
        wait_left_s=_wait_left(status) if condition is Condition.RADAR else None,
        overall_ccq_percent=percent(shown.get("overall-tx-ccq")),
        peers=tuple(_peer(row, shown) for row in mine),
        associated=_associated(condition, shown, mine, told=registrations is not None),
    )


def _said(text: str | None) -> str | None:
    stripped = (text or "").strip()
    return None if stripped.lower() in {"", "n/a", "unknown", "none"} else stripped


def _condition(status: str | None) -> Condition:
    word = (status or "").lower()
    return Condition.RADAR if _RADAR.search(word) else _WORDS.get(word, Condition.UNKNOWN)


def _mhz(channel: str | None) -> int | None:
    found = _MHZ.match(channel or "")
    return int(found[0]) if found is not None else None


def _wait_left(status: str | None) -> float | None:
    found = _LEFT.search(status or "")
    return seconds(found[0]) if found is not None else None


def _associated(
    condition: Condition, shown: Mapping[str, str], rows: Sequence[Mapping[str, str]], *, told: bool
) -> bool | None:
    if rows or condition is Condition.CONNECTED:
        return True
    counts = [whole(shown.get(name)) for name in ("registered-clients", "registered-peers")]
    if any(counts):
        return True
    told = told or 0 in counts or condition in {Condition.SEARCHING, Condition.DISABLED, Condition.RADAR}
    return False if told and condition is not Condition.UNKNOWN else None


def _peer(row: Mapping[str, str], shown: Mapping[str, str]) -> WifiPeer:
    """Read a row; what it lacks may stand in `monitor`, which speaks of the one access point of a station."""
    station = "bssid" in shown or "signal-strength" in shown
    both = {**shown, **row} if station else row
    mac = _said(row.get("mac-address"))
    return WifiPeer(
        mac=mac.upper() if mac is not None else None,
        radio_name=_said(row.get("radio-name")),
        signal_dbm=_level(both.get("signal-strength")) or _level(both.get("signal")),
        tx_signal_dbm=_level(both.get("tx-signal-strength")),
        chains_dbm=_chains(both),
        snr_db=decibels(both.get("signal-to-noise"), *_SNR_DB, unit="dB"),
        tx_rate_mbps=megabits(both.get("tx-rate")),
        rx_rate_mbps=megabits(both.get("rx-rate")),
        tx_ccq_percent=percent(both.get("tx-ccq")),
        rx_ccq_percent=percent(both.get("rx-ccq")),
        uptime_s=seconds(row.get("uptime")),
        authorised=yes(row.get("authorized")),
    )


def _level(text: str | None) -> float | None:
    return decibels(text, *_SIGNAL_DBM)


def _chains(row: Mapping[str, str]) -> tuple[float | None, ...]:
    found = {int(match[1]): value for name, value in row.items() if (match := _CHAIN.fullmatch(name))}
    return tuple(_level(found.get(number)) for number in range(max(found) + 1)) if found else ()
