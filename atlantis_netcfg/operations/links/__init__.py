"""The state of the links: all devices are queried at once, in few round trips, without changes.

The router is queried once for its routes, ports and counters, and pings each link's probe targets from the link's own
address. Both radios of a bridge and the 4G unit are queried for their own readings. A satellite terminal is not
queried: its airtime is for traffic, and it has no documented interface.
"""

from __future__ import annotations
