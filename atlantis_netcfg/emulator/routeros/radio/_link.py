"""The radio link between two running emulated routers: up while both ends match, down at once after a change.

A radio with changed settings starts anew: an access point first listens for radar if required, and a station must find
it again. The technician's packets to the far end go through the near end's cable, bridge and radio; while the link is
down they are lost without notice. While its radio is off, a far end with a wired management port is reached by a
separate cable, like a device that has only been adopted.
"""

from __future__ import annotations

import asyncio
from dataclasses import dataclass
from typing import TYPE_CHECKING

from atlantis_netcfg.emulator.routeros.radio import _law, _settings
from atlantis_netcfg.emulator.routeros.radio._read import radio_item, settings_of

if TYPE_CHECKING:
    from atlantis_netcfg.emulator.routeros.core import Core
    from atlantis_netcfg.emulator.routeros.router import EmulatedRouter


_WEATHER = range(5590, 5661)
"""Control channels of 20 MHz that overlap the band of 5600 to 5650 MHz."""


@dataclass(slots=True)
class _RadioEnd:
    router: EmulatedRouter
    radio: str
    settings: _settings.RadioSettings | None = None
    since: float = 0.0
    """Time of the latest change."""

    @property
    def core(self) -> Core:
        return self.router.device.core

    def look(self, now: float) -> None:
        """Update the end's settings; a booting router has no radio."""
        settings = None if self.router.booting else settings_of(self.core, self.radio)
        if settings != self.settings:
            self.settings, self.since = settings, now


class RadioLink:
    """A radio link in the event loop of its routers; both must be running."""

    def __init__(self, pair: _settings.RadioPair, near: EmulatedRouter, far: EmulatedRouter) -> None:
        self.air: _settings.Air = pair.air
        self.up = False
        self.since = 0.0
        """Time when the link came up."""
        self.near = _RadioEnd(near, pair.near_radio)
        self.far = _RadioEnd(far, pair.far_radio)
        self._timer: asyncio.TimerHandle | None = None
        self._carried = False

    def start(self) -> None:
        """Subscribe to changes of both ends; a new site's links are up at once if the ends match."""
        for end in (self.near, self.far):
            end.router.on_radio(self.look, self._carries if end is self.far else None)
            end.look(float("-inf"))
        self.look()

    def stop(self) -> None:
        """Stop updating the link."""
        if self._timer is not None:
            self._timer.cancel()
        for end in (self.near, self.far):
            end.router.on_radio(None, None)

    def change(self, air: _settings.Air) -> None:
        """Change the radio path between the ends."""
        self.air = air
        self.look()

    @property
    def down_reason(self) -> str:
        """Why the link stays down, regardless of time; empty: it is up, or will be."""
        near, far = self.near.settings, self.far.settings
        if near is None or far is None:
            return "a radio is not there"
        return _law.why_not(near, far, self.air)

    def look(self) -> None:
        """Update the link, and notify both ends and all senders."""
        now = asyncio.get_running_loop().time()
        for end in (self.near, self.far):
            end.look(now)
        due = float("inf") if self.down_reason else self._due()
        up = due <= now
        if up and not self.up:
            self.since = now
        has_changed, self.up = up is not self.up, up
        self._schedule_look(due, now)
        self._show(now)
        is_carrying = self._carries()
        if has_changed or is_carrying is not self._carried:
            self._carried = is_carrying
            for end in (self.near, self.far):
                end.router.regate()

    def _due(self) -> float:
        """Return when the station is registered: after radar check and association."""
        ends = [(end, end.settings) for end in (self.near, self.far) if end.settings is not None]
        ready = max(end.since + (self._radar_wait_s(settings) if settings.is_ap else 0.0) for end, settings in ends)
        return ready + self.air.association_s

    def _radar_wait_s(self, ap: _settings.RadioSettings) -> float:
        rule = _law.find_rule(ap.country, ap.channel_mhz, ap.width or "20mhz", outdoor=ap.outdoor, lawless=ap.lawless)
        if rule is None or not rule.dfs:
            return 0.0
        return self.air.weather_wait_s if ap.channel_mhz in _WEATHER else self.air.dfs_wait_s

    def _schedule_look(self, due: float, now: float) -> None:
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
        moments = [moment for moment in (due, *self._listen_ends()) if now < moment < float("inf")]
        if moments:
            self._timer = asyncio.get_running_loop().call_at(min(moments), self.look)

    def _listen_ends(self) -> list[float]:
        """Return when the access points finish their radar check."""
        ends = (self.near, self.far)
        return [
            end.since + self._radar_wait_s(end.settings)
            for end in ends
            if end.settings is not None and end.settings.is_ap
        ]

    def _carries(self) -> bool:
        """Return whether frames pass from the technician's cable through the near end and the radio link."""
        near = self.near.router
        if self._on_a_cable():
            return True
        return (
            self.up and not near.booting and near.device.core.topology.joins(near.spec.management.port, self.near.radio)
        )

    def _on_a_cable(self) -> bool:
        """Return whether a far end with a wired management port has its radio off, so that a cable is used."""
        far = self.far
        if far.router.spec.management.port == far.radio:
            return False
        return far.settings is None or not far.settings.is_enabled

    def _show(self, now: float) -> None:
        """Update the radio status of both devices."""
        for end, other in ((self.near, self.far), (self.far, self.near)):
            radio = radio_item(end.core, end.radio)
            if radio is None or end.settings is None:
                continue
            end.core.radios[end.radio] = self._state(end, end.settings, other.settings, now)
            linked_radios = end.core.linked | {radio[1].id} if self.up else end.core.linked - {radio[1].id}
            if linked_radios != end.core.linked:
                end.core.linked = linked_radios
                end.core.store.revision += 1

    def _state(
        self, end: _RadioEnd, mine: _settings.RadioSettings, theirs: _settings.RadioSettings | None, now: float
    ) -> _settings.RadioState:
        if not mine.is_enabled:
            return _settings.RadioState("disabled")
        peer = None
        if self.up and theirs is not None:
            channel = (mine if mine.is_ap else theirs).channel_mhz
            near_signal = _law.signal_dbm(theirs, mine, channel, self.air)
            there = _law.signal_dbm(mine, theirs, channel, self.air)
            peer = _settings.Peer(
                theirs, near_signal, there, channel, self.since, max(1, round(self.air.distance_m / 1000))
            )
        if not mine.is_ap:
            return _settings.RadioState("connected-to-ess" if peer is not None else "searching-for-network", peer)
        if _law.why_silent(mine, self.air):
            return _settings.RadioState("radar-detecting", None)
        listens = now < end.since + self._radar_wait_s(mine)
        return _settings.RadioState("radar-detecting" if listens else "running-ap", peer)
