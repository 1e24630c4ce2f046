"""`provision measure satellite`: tests what the satellite lets through, with probes from the router of its site.

What RouterOS offers over its API decides what can be proved:

- a target without a port is pinged from the link's own address, which a routing rule sends to the link's own table;
- a UDP target is judged by the responses that the router's filter counts for it, while the satellite carries the
  traffic: the VPN's tunnel and the time client send requests anyway. Otherwise no request is sent, and there is no
  result;
- a TCP target is tested by a netwatch row, and a time server by a routing rule and the router's own time client; both
  rows are on the router only briefly, under safe mode, and only with a person's consent (`/tool/fetch` speaks HTTP only
  and is forbidden by device-mode on home routers);
- the VPN's own address follows the best link (a routing rule of this toolkit). Over TCP it is tested all the same, by a
  rule for what the row sends from the link's own address; over UDP this computer sends the request, by a rule for its
  own address (`vpn`).
"""

from __future__ import annotations
