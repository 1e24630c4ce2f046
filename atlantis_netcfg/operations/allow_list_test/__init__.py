"""`provision prove`: what the satellite lets through, learned by probing it from the router of its own site.

What RouterOS offers over its API decides what can be proved:

- a target without a port is pinged from the link's own address, which a routing rule leads into the link's own table;
- a UDP target is judged by the answers that the router's own filter counts for it, while the satellite carries the
  traffic: the VPN's tunnel and the time client ask by themselves. Otherwise nothing asks, and nothing is concluded;
- a TCP target is tried by a netwatch row, and a time server by a routing rule and the router's own time client; both
  rows are on the router for a moment only, under safe mode, and only on a person's word (`/tool/fetch` speaks HTTP only
  and is forbidden by device-mode on home routers);
- the VPN's own address follows the best link (a routing rule of ours). Over TCP it is tried all the same, by a rule for
  what the row sends from the link's own address; over UDP this computer asks, by a rule for its own address (`vpn`).
"""

from __future__ import annotations
