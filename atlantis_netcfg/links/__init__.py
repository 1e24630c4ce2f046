"""The long-haul links of a site: what they say of themselves, whether that is good, and what they cost.

A reader takes what a device has answered, as text, and gives one normalised record; a judge compares that record with
what is declared and says in words that a technician can act on what is wrong. Nothing in here opens a connection to a
RouterOS device or knows the inventory: `operations` brings the answers and the declared values. Whoever cannot be asked
(a satellite terminal) is declared, with evidence, and put to the test by probes.
"""

from __future__ import annotations

from atlantis_netcfg.links.status import BearerFinding, BearerStatus, LinkState, Quality

__all__ = ["BearerFinding", "BearerStatus", "LinkState", "Quality"]
