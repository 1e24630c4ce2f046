"""The radio link between two running twins: up while both ends agree, down at once when one of them changes.

A radio whose settings change starts anew: an access point listens for radar first where that is the law, a station has
to find it again. What the technician sends to the far end goes through the near end's cable, bridge and radio; while
the link is down it vanishes, and nobody is told. A far end whose management port is a socket is reached there by a
cable of its own while its radio is off, as a box is that has only been adopted.

Which channels a country allows, how strong, and whether an access point has to listen for radar first.

Europe: `/interface/wifi/radio/reg-info country=Latvia` as the manual prints it (Configuring outdoor CPE to AP links);
the countries of the CEPT share these rules (ERC/REC 70-03; EN 301 893). `no_country_set` of the older driver is "an FCC
compliant set of channels" (Manual, Wireless Interface). Of other countries the twin knows nothing, and its radios stay
silent there, where real ones would not.
"""

from __future__ import annotations

import asyncio
import math
import re
from dataclasses import dataclass
from typing import TYPE_CHECKING

from atlantis_netcfg.emulator.routeros.radio._read import radio_item, settings_of
from atlantis_netcfg.emulator.routeros.radio._settings import (
    Driver,
    Peer,
    RadioSettings,
    RadioState,
    ghz_of,
    standards_of,
)

if TYPE_CHECKING:
    from collections.abc import Iterator

    from atlantis_netcfg.emulator.routeros.core import Core
    from atlantis_netcfg.emulator.routeros.radio._settings import Air, RadioPair
    from atlantis_netcfg.emulator.routeros.router import EmulatedRouter


_CEPT = frozenset(
    (
        *("austria", "belgium", "bulgaria", "croatia", "cyprus", "denmark", "estonia", "etsi", "finland"),
        *("france", "germany", "greece", "hungary", "iceland", "ireland", "italy", "latvia", "lithuania"),
        *("luxembourg", "malta", "netherlands", "norway", "poland", "portugal", "romania", "slovakia", "slovenia"),
        *("spain", "sweden", "switzerland"),
    )
)


@dataclass(frozen=True, slots=True)
class RadioRange:
    """Frequencies with one rule; the power is EIRP."""

    low_mhz: int
    high_mhz: int
    eirp_dbm: float
    indoor: bool = False
    dfs: bool = False


_EUROPE = (
    RadioRange(2402, 2482, 20.0),
    RadioRange(5170, 5250, 23.0, indoor=True),
    RadioRange(5250, 5330, 23.0, indoor=True, dfs=True),
    RadioRange(5490, 5730, 30.0, dfs=True),
    RadioRange(5735, 5875, 14.0),
)
_AMERICA = (
    RadioRange(2402, 2472, 30.0),
    RadioRange(5170, 5250, 30.0),
    RadioRange(5250, 5330, 24.0, dfs=True),
    RadioRange(5490, 5730, 24.0, dfs=True),
    RadioRange(5735, 5835, 30.0),
)
_UNLAWFUL = (RadioRange(2192, 2732, 40.0), RadioRange(4790, 6110, 40.0))
"""Everything that cards of 2 and 5 GHz can."""


def span(frequency_mhz: int, width: str) -> tuple[int, int]:
    """Return the lowest and highest frequency of a channel whose control channel is `frequency_mhz`.

    `C` is the control channel, each `e` 20 MHz more on its side; without letters, or with `X`, they lie above.
    """
    narrow = re.fullmatch(r"(5|10|20)mhz", width)
    if narrow is not None:
        half = int(narrow[1]) // 2
        return frequency_mhz - half, frequency_mhz + half
    sizes, _, letters = width.partition("mhz-")
    below = letters.index("C") if "C" in letters else 0
    number = int(sizes.removesuffix("mhz").split("/")[-1].split("+")[0]) // 20
    low = frequency_mhz - 10 - 20 * below
    return low, low + 20 * number


def within(country: str, frequency_mhz: int, width: str, *, outdoor: bool, lawless: bool = False) -> RadioRange | None:
    """Return the rule under which a channel may be used; None: it may not."""
    if lawless:
        rules: tuple[RadioRange, ...] = _UNLAWFUL
    elif country.lower() in _CEPT:
        rules = _EUROPE
    else:
        rules = _AMERICA if country == "no_country_set" else ()
    low, high = span(frequency_mhz, width)
    # A channel of 80 or 160 MHz may lie over two ranges that touch; the stricter rule holds, which is the one below.
    return next(
        (
            rule
            for rule in rules
            if rule.low_mhz <= low
            and _end(rules, rule) >= high
            and low < rule.high_mhz
            and not (outdoor and rule.indoor)
        ),
        None,
    )


def _end(rules: tuple[RadioRange, ...], rule: RadioRange) -> int:
    """Return where the ranges that touch this one end."""
    following = next((other for other in rules if other.low_mhz == rule.high_mhz), None)
    return rule.high_mhz if following is None else _end(rules, following)


_LIGHT_M_S = 299_792_458.0


def free_space_loss_db(distance_m: float, frequency_mhz: float) -> float:
    """Return the loss between two isotropic antennas, never below none."""
    return max(0.0, 20 * math.log10(4 * math.pi * distance_m * frequency_mhz * 1e6 / _LIGHT_M_S))


def signal_dbm(sender: RadioSettings, receiver: RadioSettings, frequency_mhz: int, air: Air) -> float:
    """Return what `receiver` hears of `sender`."""
    rule = within(sender.country, frequency_mhz, "20mhz", outdoor=False, lawless=sender.lawless)
    eirp = sender.power_dbm + sender.gain_dbi
    if rule is not None:
        eirp = min(eirp, rule.eirp_dbm)
    return eirp - free_space_loss_db(air.distance_m, frequency_mhz) - air.loss_db + receiver.gain_dbi


def why_not(settings: RadioSettings, other: RadioSettings, air: Air) -> str:
    """Return why the two are not connected; empty: they agree."""
    return next(_reasons(settings, other, air), "")


def _reasons(settings: RadioSettings, other: RadioSettings, air: Air) -> Iterator[str]:
    if not (settings.enabled and other.enabled):
        yield "a radio is disabled"
    if settings.is_ap == other.is_ap:
        yield "both ends are access points" if settings.is_ap else "no end is an access point"
        return
    ap, station = (settings, other) if settings.is_ap else (other, settings)
    yield from _roles(ap, station)
    if silent := why_silent(ap, air):
        yield silent
    yield from _channel(ap, station)
    if station.ssid not in ("", ap.ssid):
        yield "the network names differ"
    if _key(ap, ap.speaks) != _key(station, ap.speaks) and not _same_secret(ap, station):
        yield "the keys differ"
    yield from _lists(ap, station)
    yield from _distance(ap, station, air)


def _roles(ap: RadioSettings, station: RadioSettings) -> Iterator[str]:
    if ap.driver is not station.driver:
        yield "station-bridge does not work between the two drivers"
    if station.mode != "station-bridge" or not ap.bridges_stations:
        yield "the station does not bridge"
    if ap.speaks not in station.understands:
        yield "the protocols differ"


def why_silent(ap: RadioSettings, air: Air) -> str:
    """Return why an access point does not speak on its channel; empty: it does."""
    low, high = span(ap.channel_mhz, ap.width or "20mhz")
    if not (air.lowest_mhz <= low and high <= air.highest_mhz) or ap.channel_mhz // 1000 != ghz_of(ap.band):
        return "the radio does not have this channel"
    if within(ap.country, ap.channel_mhz, ap.width or "20mhz", outdoor=ap.outdoor, lawless=ap.lawless) is None:
        return "the country does not allow this channel"
    return "a radar is on this channel" if ap.channel_mhz in air.radar_mhz else ""


def _channel(ap: RadioSettings, station: RadioSettings) -> Iterator[str]:
    bands = standards_of(ap.band, ap.driver) & standards_of(station.band, station.driver)
    if ghz_of(ap.band) != ghz_of(station.band) or not bands:
        yield "the bands differ"
    if ap.width != station.width:
        yield "the channel widths differ"
    rule = within(
        station.country, ap.channel_mhz, ap.width or "20mhz", outdoor=station.outdoor, lawless=station.lawless
    )
    if rule is None:
        yield "the station's country does not allow this channel"
    if station.scans is not None and not any(low <= ap.channel_mhz <= high for low, high in station.scans):
        yield "the station does not look on this channel"


def _key(radio: RadioSettings, protocol: str) -> tuple[object, ...]:
    """With nv2 the security profile is not used, but `nv2-security` (Manual, Nv2)."""
    return (radio.nv2_key,) if protocol == "nv2" else (radio.authentication, radio.passphrase)


def _same_secret(ap: RadioSettings, station: RadioSettings) -> bool:
    """One way of authentication in common is enough, with the same passphrase."""
    if ap.speaks == "nv2":
        return False
    return bool(ap.authentication & station.authentication) and ap.passphrase == station.passphrase


def _lists(ap: RadioSettings, station: RadioSettings) -> Iterator[str]:
    for here, there in ((ap, station), (station, ap)):
        if there.mac not in here.admits and here.refuses & {there.mac, "*"}:
            yield "a list turns the other end away"


def _distance(ap: RadioSettings, station: RadioSettings, air: Air) -> Iterator[str]:
    limits = [each.reach_km for each in (ap, station) if each.reach_km is not None]
    counts = ap.speaks == "nv2" or ap.driver is Driver.WIFI
    if counts and limits and air.distance_m > min(limits) * 1000:
        yield "ranging timeout: the ends are set to a shorter distance"
    weakest = min(signal_dbm(ap, station, ap.channel_mhz, air), signal_dbm(station, ap, ap.channel_mhz, air))
    if weakest < air.sensitivity_dbm:
        yield "the ends are too far apart"


_WEATHER = range(5590, 5661)
"""Control channels of 20 MHz that reach into 5600 to 5650 MHz."""


@dataclass(slots=True)
class _RadioEnd:
    router: EmulatedRouter
    radio: str
    settings: RadioSettings | None = None
    since: float = 0.0
    """When it became what it is now."""

    @property
    def core(self) -> Core:
        return self.router.device.core

    def look(self, now: float) -> None:
        """See what it is set to now; a router that boots has no radio."""
        found = None if self.router.booting else settings_of(self.core, self.radio)
        if found != self.settings:
            self.settings, self.since = found, now


class RadioLink:
    """Belongs to the event loop of its twins; both have to be running."""

    def __init__(self, pair: RadioPair, near: EmulatedRouter, far: EmulatedRouter) -> None:
        self.air: Air = pair.air
        self.up = False
        self.since = 0.0
        """When it came up."""
        self.near = _RadioEnd(near, pair.near_radio)
        self.far = _RadioEnd(far, pair.far_radio)
        self._timer: asyncio.TimerHandle | None = None
        self._carried = False

    def start(self) -> None:
        """Be told by both ends when something changes; links of a freshly started site are up at once if they agree."""
        for end in (self.near, self.far):
            end.router.on_radio(self.look, self._carries if end is self.far else None)
            end.look(float("-inf"))
        self.look()

    def stop(self) -> None:
        """Look no more."""
        if self._timer is not None:
            self._timer.cancel()
        for end in (self.near, self.far):
            end.router.on_radio(None, None)

    def change(self, air: Air) -> None:
        """Put other air between the ends."""
        self.air = air
        self.look()

    @property
    def why(self) -> str:
        """Why it is down, whatever time would bring; empty: it is up, or will be."""
        near, far = self.near.settings, self.far.settings
        if near is None or far is None:
            return "a radio is not there"
        return why_not(near, far, self.air)

    def look(self) -> None:
        """See what has become of the link; tell both ends and everybody who sends over it."""
        now = asyncio.get_running_loop().time()
        for end in (self.near, self.far):
            end.look(now)
        due = float("inf") if self.why else self._due()
        up = due <= now
        if up and not self.up:
            self.since = now
        changed, self.up = up is not self.up, up
        self._wake(due, now)
        self._show(now)
        carried = self._carries()
        if changed or carried is not self._carried:
            self._carried = carried
            for end in (self.near, self.far):
                end.router.regate()

    def _due(self) -> float:
        """When the station is registered: the access point has listened, then the two have met."""
        ends = [(end, end.settings) for end in (self.near, self.far) if end.settings is not None]
        ready = max(end.since + (self._wait(settings) if settings.is_ap else 0.0) for end, settings in ends)
        return ready + self.air.association_s

    def _wait(self, ap: RadioSettings) -> float:
        rule = within(ap.country, ap.channel_mhz, ap.width or "20mhz", outdoor=ap.outdoor, lawless=ap.lawless)
        if rule is None or not rule.dfs:
            return 0.0
        return self.air.weather_wait_s if ap.channel_mhz in _WEATHER else self.air.dfs_wait_s

    def _wake(self, due: float, now: float) -> None:
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
        moments = [moment for moment in (due, *self._listened()) if now < moment < float("inf")]
        if moments:
            self._timer = asyncio.get_running_loop().call_at(min(moments), self.look)

    def _listened(self) -> list[float]:
        """When access points have listened for long enough."""
        ends = (self.near, self.far)
        return [end.since + self._wait(end.settings) for end in ends if end.settings is not None and end.settings.is_ap]

    def _carries(self) -> bool:
        """Tell whether frames get from the technician's cable through the near end into the air and out of it."""
        near = self.near.router
        if self._on_a_cable():
            return True
        return (
            self.up and not near.booting and near.device.core.topology.joins(near.spec.management.port, self.near.radio)
        )

    def _on_a_cable(self) -> bool:
        """Tell whether the far end, managed at a port, has its radio still off: then somebody has a cable in it."""
        far = self.far
        if far.router.spec.management.port == far.radio:
            return False
        return far.settings is None or not far.settings.enabled

    def _show(self, now: float) -> None:
        """Let both devices show what their radios see."""
        for end, other in ((self.near, self.far), (self.far, self.near)):
            found = radio_item(end.core, end.radio)
            if found is None or end.settings is None:
                continue
            end.core.radios[end.radio] = self._state(end, end.settings, other.settings, now)
            linked = end.core.linked | {found[1].id} if self.up else end.core.linked - {found[1].id}
            if linked != end.core.linked:
                end.core.linked = linked
                end.core.store.revision += 1

    def _state(self, end: _RadioEnd, mine: RadioSettings, theirs: RadioSettings | None, now: float) -> RadioState:
        if not mine.enabled:
            return RadioState("disabled")
        peer = None
        if self.up and theirs is not None:
            channel = (mine if mine.is_ap else theirs).channel_mhz
            received = signal_dbm(theirs, mine, channel, self.air)
            there = signal_dbm(mine, theirs, channel, self.air)
            peer = Peer(theirs, received, there, channel, self.since, max(1, round(self.air.distance_m / 1000)))
        if not mine.is_ap:
            return RadioState("connected-to-ess" if peer is not None else "searching-for-network", peer)
        if why_silent(mine, self.air):
            return RadioState("radar-detecting", None)
        listens = now < end.since + self._wait(mine)
        return RadioState("radar-detecting" if listens else "running-ap", peer)
