"""The radio link between two running twins: up while both ends agree, down at once when one of them changes.

A radio whose settings change starts anew: an access point listens for radar first where that is the law, a station has
to find it again. What the technician sends to the far end goes through the near end's cable, bridge and radio; while
the link is down it vanishes, and nobody is told. A far end whose management port is a socket is reached there by a
cable of its own while its radio is off, as a box is that has only been adopted.
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
"""Control channels of 20 MHz that reach into 5600 to 5650 MHz."""


@dataclass(slots=True)
class _RadioEnd:
    router: EmulatedRouter
    radio: str
    settings: _settings.RadioSettings | None = None
    since: float = 0.0
    """When it became what it is now."""

    @property
    def core(self) -> Core:
        return self.router.device.core

    def look(self, now: float) -> None:
        """See what it is set to now; a router that boots has no radio."""
        settings = None if self.router.booting else settings_of(self.core, self.radio)
        if settings != self.settings:
            self.settings, self.since = settings, now


class RadioLink:
    """Belongs to the event loop of its twins; both have to be running."""

    def __init__(self, pair: _settings.RadioPair, near: EmulatedRouter, far: EmulatedRouter) -> None:
        self.air: _settings.Air = pair.air
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

    def change(self, air: _settings.Air) -> None:
        """Put other air between the ends."""
        self.air = air
        self.look()

    @property
    def why(self) -> str:
        """Why it is down, whatever time would bring; empty: it is up, or will be."""
        near, far = self.near.settings, self.far.settings
        if near is None or far is None:
            return "a radio is not there"
        return _law.why_not(near, far, self.air)

    def look(self) -> None:
        """See what has become of the link; tell both ends and everybody who sends over it."""
        now = asyncio.get_running_loop().time()
        for end in (self.near, self.far):
            end.look(now)
        due = float("inf") if self.why else self._due()
        up = due <= now
        if up and not self.up:
            self.since = now
        has_changed, self.up = up is not self.up, up
        self._wake(due, now)
        self._show(now)
        is_carrying = self._carries()
        if has_changed or is_carrying is not self._carried:
            self._carried = is_carrying
            for end in (self.near, self.far):
                end.router.regate()

    def _due(self) -> float:
        """When the station is registered: the access point has listened, then the two have met."""
        ends = [(end, end.settings) for end in (self.near, self.far) if end.settings is not None]
        ready = max(end.since + (self._wait(settings) if settings.is_ap else 0.0) for end, settings in ends)
        return ready + self.air.association_s

    def _wait(self, ap: _settings.RadioSettings) -> float:
        rule = _law.within(ap.country, ap.channel_mhz, ap.width or "20mhz", outdoor=ap.outdoor, lawless=ap.lawless)
        if rule is None or not rule.dfs:
            return 0.0
        return self.air.weather_wait_s if ap.channel_mhz in _WEATHER else self.air.dfs_wait_s

    def _wake(self, due: float, now: float) -> None:
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
        moments = [moment for moment in (due, *self._listen_ends()) if now < moment < float("inf")]
        if moments:
            self._timer = asyncio.get_running_loop().call_at(min(moments), self.look)

    def _listen_ends(self) -> list[float]:
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
        return far.settings is None or not far.settings.is_enabled

    def _show(self, now: float) -> None:
        """Let both devices show what their radios see."""
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
        listens = now < end.since + self._wait(mine)
        return _settings.RadioState("radar-detecting" if listens else "running-ap", peer)
