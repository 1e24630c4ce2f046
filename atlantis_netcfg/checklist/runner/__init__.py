"""The questions of a checklist, asked where the things are: on the gateway, on this computer, of the routers.

All places are asked at the same time, each in one turn: one SSH command carries every question to the gateway, each
router has one session, and what comes back is judged item by item as soon as it is there. Nothing leaves before it is
looked at (programs from the closed list, addresses that are declared, reading commands only) and, where the way is paid
by the byte, before somebody has agreed to pay; a place that cannot be asked answers so, and is no error.
"""

from __future__ import annotations

from atlantis_netcfg.checklist.runner._gateway_access import GatewayAccess, GatewayUnreachable, way_in
from atlantis_netcfg.checklist.runner._real import Ears, RealEars, ask_here
from atlantis_netcfg.checklist.runner._run import examine, utc_now
from atlantis_netcfg.checklist.runner.cost import previews
from atlantis_netcfg.checklist.runner.results import OnAnswer, Questions, all_unanswered, telling, trouble_answer

__all__ = [
    "Ears",
    "GatewayAccess",
    "GatewayUnreachable",
    "OnAnswer",
    "Questions",
    "RealEars",
    "all_unanswered",
    "ask_here",
    "examine",
    "previews",
    "telling",
    "trouble_answer",
    "utc_now",
    "way_in",
]
