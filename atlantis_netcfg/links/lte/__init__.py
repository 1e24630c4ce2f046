"""4G: drivers for the units in use at sites, one normalised record, and findings as text.

A driver only reads: the commands it may send are data, an allow-list that a test checks every command against.
Settings (APN, PIN, roaming, bands) are made by the device's role, never by a reader, and a PIN is tried once.
"""

from __future__ import annotations

from atlantis_netcfg.links.lte.judge import LteReading, Registration

__all__ = ["LteReading", "Registration"]
