"""The Wi-Fi bridge: one record for both families of RouterOS' radio menus, and findings as text."""

from __future__ import annotations

import re
from dataclasses import dataclass
from enum import StrEnum
from typing import TYPE_CHECKING

from atlantis_netcfg.core.events import Verdict
from atlantis_netcfg.core.messages import arg, join, msg
from atlantis_netcfg.links.status import (
    LinkFinding,
    LinkState,
    Quality,
    Query,
    decibels,
    megabits,
    percent,
    seconds,
    whole,
    yes,
)

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence


class Family(StrEnum):
    """RouterOS' two families of radio menus; the value is the menu under `/interface`."""

    WIRELESS = "wireless"
    """Package `wireless`: nv2, nstreme, 802.11; has CCQ."""
    WIFI = "wifi"
    """Packages `wifi-qcom` and `wifi-qcom-ac`; no CCQ, no noise floor."""


class WifiCondition(StrEnum):
    """The radio's condition; an unrecognised value is `unknown`, never a failure."""

    RUNNING = "running"
    """An access point that transmits, with or without registered clients."""
    CONNECTED = "connected"
    """A station that is connected to an access point."""
    SEARCHING = "searching"
    RADAR = "radar"
    """The radio listens for radar before it may transmit."""
    DISABLED = "disabled"
    UNKNOWN = "unknown"


@dataclass(frozen=True, slots=True, kw_only=True)
class WifiPeer:
    """A registered peer and the signal in both directions: a row of the registration table."""

    mac: str | None = None
    """MAC address in upper case."""
    radio_name: str | None = None
    """Only in the family `wireless`."""
    signal_dbm: float | None = None
    """Signal of the other end as received here."""
    tx_signal_dbm: float | None = None
    """Signal of this end as reported by the other end."""
    chains_dbm: tuple[float | None, ...] = ()
    """`signal_dbm` of each receiver chain, in order."""
    snr_db: float | None = None
    tx_rate_mbps: float | None = None
    """Rate of the latest frame; on an idle link this may be a management frame at the lowest rate."""
    rx_rate_mbps: float | None = None
    tx_ccq_percent: float | None = None
    rx_ccq_percent: float | None = None
    uptime_s: float | None = None
    is_authorised: bool | None = None
    """Whether the key was right; None: not reported."""

    @property
    def imbalance_db(self) -> float | None:
        """Difference in dB between the best and the worst chain; None with fewer than two."""
        levels = [level for level in self.chains_dbm if level is not None]
        return max(levels) - min(levels) if len(levels) > 1 else None


@dataclass(frozen=True, slots=True, kw_only=True)
class WifiReading:
    """The state that a radio reported at one moment."""

    family: Family
    condition: WifiCondition = WifiCondition.UNKNOWN
    status: str | None = None
    """Status as the device words it."""
    channel: str | None = None
    """Channel in the device's notation: `5500/20/an`."""
    channel_mhz: int | None = None
    wait_left_s: float | None = None
    """Seconds until the radar wait ends, if the device reports it."""
    overall_ccq_percent: float | None = None
    """Of an access point in the family `wireless`: CCQ of all its clients together."""
    peers: tuple[WifiPeer, ...] = ()
    is_associated: bool | None = None
    """Whether a peer is registered; None: cannot be determined."""


IMBALANCE_DB = 6.0
LOW_CCQ_PERCENT = 60.0
LOW_RATE_MBPS = 13.0
"""Below it a 20 MHz link uses only its two most robust modulations (IEEE 802.11n, MCS 0 and 1 with one stream)."""
_LONG_RADAR_WAIT_MHZ = (5600, 5650)
"""Weather radar band: ETSI EN 301 893 requires 10 minutes of listening there, and 1 minute elsewhere."""
_HALF_CHANNEL_MHZ = 10


@dataclass(frozen=True, slots=True, kw_only=True)
class WifiSettings:
    """The settings of this end in the inventory."""

    peer: str
    """Name of the other end in the inventory."""
    peer_macs: frozenset[str] = frozenset()
    """MAC addresses of the other end's radio, upper case; empty if not known."""
    peer_radio_name: str | None = None
    access_point: bool
    ssid: str
    protocol: str
    """802.11, nstreme or nv2."""
    frequency_mhz: int
    width_mhz: int = 20
    weakest_dbm: float = -75.0
    strongest_dbm: float = -35.0


def judge(reading: WifiReading, settings: WifiSettings) -> tuple[LinkFinding, ...]:
    """Return all findings about the bridge; empty if it matches the inventory and its signal is good."""
    if reading.is_associated:
        return tuple(_association(reading, settings))
    return (_not_registered(reading, settings),)


def link_state(reading: WifiReading) -> LinkState:
    """Return the link state that the radio itself reports, without a probe."""
    if reading.is_associated is None:
        return LinkState.SEARCHING if reading.condition is WifiCondition.RADAR else LinkState.UNKNOWN
    if reading.is_associated:
        is_unauthorised = bool(reading.peers) and all(peer.is_authorised is False for peer in reading.peers)
        return LinkState.DOWN if is_unauthorised else LinkState.UP
    waiting = {WifiCondition.SEARCHING, WifiCondition.RADAR, WifiCondition.RUNNING}
    return LinkState.SEARCHING if reading.condition in waiting else LinkState.DOWN


def quality(reading: WifiReading, settings: WifiSettings | None = None) -> Quality:
    """Return the quality readings for a `LinkStatus`: of the expected peer if registered, else of the first one."""
    peer = _declared_peer(reading, settings)
    result: Quality = {"status": reading.status, "channel": reading.channel}
    names = ("signal_dbm", "tx_signal_dbm", "snr_db", "tx_rate_mbps", "rx_rate_mbps", "tx_ccq_percent")
    for name in (*names, "rx_ccq_percent", "uptime_s"):
        result[name] = None if peer is None else getattr(peer, name)
    for number, level in enumerate(peer.chains_dbm if peer is not None else ()):
        result[f"signal_chain{number}_dbm"] = level
    result["peer"] = None if peer is None else peer.radio_name or peer.mac
    return result


def _declared_peer(reading: WifiReading, settings: WifiSettings | None) -> WifiPeer | None:
    ours = [peer for peer in reading.peers if settings is not None and _is_declared(peer, settings)]
    return next(iter((*ours, *reading.peers)), None)


def _is_declared(peer: WifiPeer, settings: WifiSettings) -> bool | None:
    """Return whether this is the peer in the inventory; None if there is nothing to identify it by."""
    if settings.peer_macs and peer.mac is not None:
        return peer.mac in settings.peer_macs
    if settings.peer_radio_name is not None and peer.radio_name is not None:
        return peer.radio_name == settings.peer_radio_name
    return None


def _not_registered(reading: WifiReading, settings: WifiSettings) -> LinkFinding:
    """Return the finding that tells why no peer is registered."""
    if reading.condition is WifiCondition.DISABLED:
        hint = "apply the site's configuration to enable it, or find out who disabled it"
        return LinkFinding(Verdict.FAIL, "radio-disabled", "the radio is switched off", hint)
    if reading.condition is WifiCondition.RADAR:
        return _radar(reading, settings)
    if reading.is_associated is None:
        status = f"`{reading.status}`" if reading.status else "nothing"
        message = msg(f"unknown whether {arg(settings.peer)} is registered: the radio's state is {arg(status)}")
        hint = "check the radio's own status page, or try again in a minute"
        return LinkFinding(Verdict.INCONCLUSIVE, "status-unknown", message, hint)
    if settings.access_point:
        message = msg(f"the access point is transmitting, but {arg(settings.peer)} is not registered")
        hint = msg(
            f"check that {arg(settings.peer)} is powered and points here; then compare SSID, key, protocol and channel "
            "at both ends; after a radar event it may take ten minutes"
        )
        return LinkFinding(Verdict.FAIL, "not-associated", message, hint)
    message = msg(f"the station searches for `{arg(settings.ssid)}` of {arg(settings.peer)} but does not find it")
    hint = msg(
        f"check that {arg(settings.peer)} is on and not waiting for radar; then align the antennas, and compare SSID, "
        f"key, protocol ({arg(settings.protocol)}) and channel ({arg(settings.frequency_mhz)} MHz) at both ends"
    )
    return LinkFinding(Verdict.FAIL, "not-associated", message, hint)


def _radar(reading: WifiReading, settings: WifiSettings) -> LinkFinding:
    low, high = _LONG_RADAR_WAIT_MHZ
    channel = reading.channel_mhz or settings.frequency_mhz
    reach = max(_HALF_CHANNEL_MHZ, settings.width_mhz - _HALF_CHANNEL_MHZ)
    long = channel - _HALF_CHANNEL_MHZ < high and channel + reach > low
    if reading.wait_left_s is not None:
        how_long = msg(f"{arg(reading.wait_left_s):.0f} s left")
    else:
        how_long = msg(f"up to 10 minutes at {arg(low)}-{arg(high)} MHz" if long else "60 s")
    message = msg(f"the radio listens for radar at {arg(channel)} MHz before it may send ({arg(how_long)})")
    hint = "wait, then check again; if it happens often, choose another channel: radars are near ports and ships"
    return LinkFinding(Verdict.INCONCLUSIVE, "radar-wait", message, hint)


def _association(reading: WifiReading, settings: WifiSettings) -> Iterator[LinkFinding]:
    yield from _check_strangers(reading, settings)
    peer = _declared_peer(reading, settings)
    if peer is None or peer.signal_dbm is None:
        message = "a station is registered, but the radio reports no signal strength"
        yield LinkFinding(Verdict.INCONCLUSIVE, "signal-unreadable", message, "check the radio's own status page")
    if peer is None:
        return
    if peer.is_authorised is False:
        message = msg(f"{arg(settings.peer)} is registered but not authorised: the keys differ")
        yield LinkFinding(Verdict.FAIL, "not-authorised", message, "compare the bridge's key at both ends")
    yield from _levels(peer, settings)
    yield from _check_quality(reading, peer)


def _check_strangers(reading: WifiReading, settings: WifiSettings) -> Iterator[LinkFinding]:
    by_peer = [(peer, _is_declared(peer, settings)) for peer in reading.peers]
    strangers = [peer.radio_name or peer.mac or "somebody" for peer, is_match in by_peer if is_match is False]
    if not strangers:
        return
    names = join(", ", strangers)
    if any(is_match for _, is_match in by_peer):
        message = msg(f"besides {arg(settings.peer)}, {arg(names)} is registered")
        yield LinkFinding(Verdict.WARN, "stranger-registered", message, "change the bridge's key at both ends")
    else:
        message = msg(f"registered to {arg(names)}, not to {arg(settings.peer)}")
        hint = "compare SSID and key; if the radio at the other end was replaced, provision the site again"
        yield LinkFinding(Verdict.FAIL, "wrong-peer", message, hint)


def _levels(peer: WifiPeer, settings: WifiSettings) -> Iterator[LinkFinding]:
    level = peer.signal_dbm
    if level is not None and level < settings.weakest_dbm:
        message = msg(
            f"the signal of {arg(settings.peer)} is {arg(level):g} dBm, below {arg(settings.weakest_dbm):g} dBm"
        )
        hint = "align both antennas, look for obstacles between them, and check the antenna cables"
        yield LinkFinding(Verdict.WARN, "signal-weak", message, hint)
    if level is not None and level > settings.strongest_dbm:
        message = msg(
            f"the signal of {arg(settings.peer)} is {arg(level):g} dBm, above {arg(settings.strongest_dbm):g} dBm: the "
            "receiver saturates"
        )
        yield LinkFinding(Verdict.WARN, "signal-strong", message, "reduce `tx_power_dbm` at the other end")
    imbalance = peer.imbalance_db
    if imbalance is not None and imbalance > IMBALANCE_DB:
        message = msg(
            f"the signals of the two chains differ by {arg(imbalance):g} dB, more than {arg(IMBALANCE_DB):g} dB"
        )
        hint = "check polarisation and alignment, then the connector of the weaker chain"
        yield LinkFinding(Verdict.WARN, "chain-imbalance", message, hint)


def _check_quality(reading: WifiReading, peer: WifiPeer) -> Iterator[LinkFinding]:
    quality_of = [value for value in (peer.tx_ccq_percent, peer.rx_ccq_percent) if value is not None]
    if not quality_of and reading.overall_ccq_percent is not None:
        quality_of = [reading.overall_ccq_percent]
    if quality_of and min(quality_of) < LOW_CCQ_PERCENT and reading.family is Family.WIRELESS:
        message = msg(f"the connection quality (CCQ) is {arg(min(quality_of)):g} %, below {arg(LOW_CCQ_PERCENT):g} %")
        hint = (
            "frames are retransmitted: look for other transmitters on the channel, a signal that is too strong, "
            "or a bad connector"
        )
        yield LinkFinding(Verdict.WARN, "ccq-low", message, hint)
    rates = [value for value in (peer.tx_rate_mbps, peer.rx_rate_mbps) if value is not None]
    if rates and min(rates) < LOW_RATE_MBPS:
        message = msg(f"the rate is {arg(min(rates)):g} Mbit/s, below {arg(LOW_RATE_MBPS):g} Mbit/s")
        hint = "an idle link shows the rate of its management frames: check again while traffic flows, then align"
        yield LinkFinding(Verdict.WARN, "rate-low", message, hint)


_WORDS = {
    "disabled": WifiCondition.DISABLED,
    "searching-for-network": WifiCondition.SEARCHING,
    "searching": WifiCondition.SEARCHING,
    "connecting": WifiCondition.SEARCHING,
    "connected-to-ess": WifiCondition.CONNECTED,
    "connected": WifiCondition.CONNECTED,
    "running-ap": WifiCondition.RUNNING,
    "running": WifiCondition.RUNNING,
}
_RADAR = re.compile(r"radar|\bdfs\b|\bcac\b")
_SIGNAL_DBM = (-120.0, -1.0)
"""Plausible range: a driver without a measured level reports 0."""
_SNR_DB = (0.0, 120.0)
_CHAIN = re.compile(r"signal(?:-strength)?-ch(\d)")
_MHZ = re.compile(r"\d{4}")
_TIME_LEFT = re.compile(r"\d+(?:\.\d+)?(?:ms|[wdhms])(?:\d+(?:\.\d+)?(?:ms|[wdhms]))*|\d+:\d\d:\d\d")


def queries(family: Family, interface: str) -> tuple[Query, Query]:
    """Return the queries for the registration table and for the radio with this name, in the order of `read`."""
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
    """Build the reading from the two query results; None means that a query was refused or not answered.

    `interface` excludes peers that are registered on other radios of the device.
    """
    monitor_row = monitor or {}
    status = _known_text(monitor_row.get("status")) or _known_text(monitor_row.get("state"))
    condition = _condition(status)
    mine = [row for row in registrations or () if interface is None or row.get("interface", interface) == interface]
    if not mine and condition is WifiCondition.CONNECTED and "bssid" in monitor_row:
        mine = [{"mac-address": monitor_row["bssid"], "radio-name": monitor_row.get("radio-name", "")}]
    return WifiReading(
        family=family,
        condition=condition,
        status=status,
        channel=_known_text(monitor_row.get("channel")),
        channel_mhz=_mhz(monitor_row.get("channel")),
        wait_left_s=_wait_left(status) if condition is WifiCondition.RADAR else None,
        overall_ccq_percent=percent(monitor_row.get("overall-tx-ccq")),
        peers=tuple(_read_peer(row, monitor_row) for row in mine),
        is_associated=_is_associated(condition, monitor_row, mine, complete=registrations is not None),
    )


def _known_text(text: str | None) -> str | None:
    word = (text or "").strip()
    return None if word.lower() in {"", "n/a", "unknown", "none"} else word


def _condition(status: str | None) -> WifiCondition:
    word = (status or "").lower()
    return WifiCondition.RADAR if _RADAR.search(word) else _WORDS.get(word, WifiCondition.UNKNOWN)


def _mhz(channel: str | None) -> int | None:
    match = _MHZ.match(channel or "")
    return int(match[0]) if match is not None else None


def _wait_left(status: str | None) -> float | None:
    match = _TIME_LEFT.search(status or "")
    return seconds(match[0]) if match is not None else None


def _is_associated(
    condition: WifiCondition, monitor_row: Mapping[str, str], rows: Sequence[Mapping[str, str]], *, complete: bool
) -> bool | None:
    if rows or condition is WifiCondition.CONNECTED:
        return True
    counts = [whole(monitor_row.get(name)) for name in ("registered-clients", "registered-peers")]
    if any(counts):
        return True
    complete = (
        complete or 0 in counts or condition in {WifiCondition.SEARCHING, WifiCondition.DISABLED, WifiCondition.RADAR}
    )
    return False if complete and condition is not WifiCondition.UNKNOWN else None


def _read_peer(row: Mapping[str, str], monitor_row: Mapping[str, str]) -> WifiPeer:
    """Parse a registration row; for a station, missing values come from `monitor`, which describes its access point."""
    station = "bssid" in monitor_row or "signal-strength" in monitor_row
    both = {**monitor_row, **row} if station else row
    mac = _known_text(row.get("mac-address"))
    return WifiPeer(
        mac=mac.upper() if mac is not None else None,
        radio_name=_known_text(row.get("radio-name")),
        signal_dbm=_level(both.get("signal-strength")) or _level(both.get("signal")),
        tx_signal_dbm=_level(both.get("tx-signal-strength")),
        chains_dbm=_chain_signals(both),
        snr_db=decibels(both.get("signal-to-noise"), *_SNR_DB, unit="dB"),
        tx_rate_mbps=megabits(both.get("tx-rate")),
        rx_rate_mbps=megabits(both.get("rx-rate")),
        tx_ccq_percent=percent(both.get("tx-ccq")),
        rx_ccq_percent=percent(both.get("rx-ccq")),
        uptime_s=seconds(row.get("uptime")),
        is_authorised=yes(row.get("authorized")),
    )


def _level(text: str | None) -> float | None:
    return decibels(text, *_SIGNAL_DBM)


def _chain_signals(row: Mapping[str, str]) -> tuple[float | None, ...]:
    level_by_chain = {int(match[1]): value for name, value in row.items() if (match := _CHAIN.fullmatch(name))}
    return (
        tuple(_level(level_by_chain.get(number)) for number in range(max(level_by_chain) + 1)) if level_by_chain else ()
    )
