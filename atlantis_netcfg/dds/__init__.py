"""DDS profiles from the declaration: unicast peers, a lease that outlives a satellite's silence, sizes for each link.

Pure: a view is a function of the declaration, a file a function of a view. `provision dds` is the door.
"""

from __future__ import annotations

from atlantis_netcfg.dds.profiles import FOLDER, profiles
from atlantis_netcfg.dds.tuning import GAP_S, TUNING, Tuning
from atlantis_netcfg.dds.versions import RELEASES, Cyclone, Release
from atlantis_netcfg.dds.view import ProfileView, profile_views

__all__ = [
    "FOLDER",
    "GAP_S",
    "RELEASES",
    "TUNING",
    "Cyclone",
    "ProfileView",
    "Release",
    "Tuning",
    "profile_views",
    "profiles",
]
