"""How the links of a site are: every box asked at once, in few round trips, and nothing changed.

The router is asked once for its routes, ports and counters and to ping each link's canaries from the link's own
address; both radios of a bridge and the 4G unit for their own readings; a satellite terminal for nothing, because its
airtime is for traffic and no interface of it is documented.
"""

from __future__ import annotations
