"""4G: drivers for what may stand at a site, one normalised record, and what is wrong in words.

A driver only asks: what it may send is data, an allow-list that a test holds every command against. What has to be set
(APN, PIN, roaming, bands) is set by the role of the device, never by a reader, and a PIN is tried once.
"""

from __future__ import annotations

from atlantis_netcfg.links.lte.judge import LteReading, Registration

__all__ = ["LteReading", "Registration"]
