"""Runs the requests of a checklist where the devices are reachable: on the gateway, on this computer, on routers.

All places run at the same time, each in one turn: one SSH command carries all requests to the gateway, each router has
one session, and each item is judged as soon as its results are there. Nothing is sent before it is checked (programs
from the allow-list, addresses in the inventory, read-only commands) and, on a metered link, before a person has given
consent. A place that cannot be reached is a result, not an error.
"""

from __future__ import annotations

from atlantis_netcfg.checklist.runner._gateway_access import GatewayAccess, GatewayUnreachable, way_in
from atlantis_netcfg.checklist.runner._real import ProbeTransport, RealTransport, ask_here
from atlantis_netcfg.checklist.runner._run import examine, utc_now
from atlantis_netcfg.checklist.runner.cost import previews
from atlantis_netcfg.checklist.runner.results import OnAnswer, Questions, all_unanswered, trouble_answer

__all__ = [
    "GatewayAccess",
    "GatewayUnreachable",
    "OnAnswer",
    "ProbeTransport",
    "Questions",
    "RealTransport",
    "all_unanswered",
    "ask_here",
    "examine",
    "previews",
    "trouble_answer",
    "utc_now",
    "way_in",
]
