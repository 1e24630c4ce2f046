"""The long-haul links of a site: their reported state, its assessment, and their cost.

A reader parses the text that a device returned into one normalised record; a judge compares that record with the
inventory and describes each problem so that a technician can act on it. Nothing in this package opens a connection to
a RouterOS device or knows the inventory: `operations` passes in the responses and the expected values. A device that
cannot be read (a satellite terminal) is described in the inventory, with evidence, and tested by probes.
"""

from __future__ import annotations

from atlantis_netcfg.links.status import LinkFinding, LinkState, LinkStatus, Quality

__all__ = ["LinkFinding", "LinkState", "LinkStatus", "Quality"]
