"""Upgrading RouterOS on one device of the declaration from package files that a person gives.

`Prepared.of` reads the files and the device and decides what would happen, changing nothing; a person agrees;
`carry_out` saves the device's state, sends the files, reboots, and reads back. It never starts by itself and downloads
nothing.
"""

from __future__ import annotations

from atlantis_netcfg.operations.upgrade._device import Upgrading, Waiting
from atlantis_netcfg.operations.upgrade._prepared import Prepared, Upgraded

__all__ = ["Prepared", "Upgraded", "Upgrading", "Waiting"]
