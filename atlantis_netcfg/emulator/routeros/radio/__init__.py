"""The radio link between two emulated routers: settings, association, and signal levels.

Modelled is what decides over a link: both radios on, one access point and one `station-bridge` of the same driver,
protocol, network name, band and width, key, a channel that the country allows, DFS and association times, and the
distance. Not modelled: antenna alignment, rain, tide, interference and throughput.
"""

from __future__ import annotations

from atlantis_netcfg.emulator.routeros.radio._law import why_not
from atlantis_netcfg.emulator.routeros.radio._link import RadioLink
from atlantis_netcfg.emulator.routeros.radio._read import settings_of
from atlantis_netcfg.emulator.routeros.radio._settings import Air, Driver, RadioPair, RadioSettings

__all__ = ["Air", "Driver", "RadioLink", "RadioPair", "RadioSettings", "settings_of", "why_not"]
