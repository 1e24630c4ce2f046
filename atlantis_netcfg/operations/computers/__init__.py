"""Computers in a run, gateways and the VPN's server: ordinary Ansible roles work, and this is what stands around them.

Before the roles `wanted` tells each of them what its hosts should hold, as data made by pure functions. While they run
a `Watch` in Ansible's main process holds the site's lock, writes its journal, and puts every task's result into words.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.core.lazy_imports import homes

if TYPE_CHECKING:
    from atlantis_netcfg.operations.computers._access import is_computer, is_gateway, is_server
    from atlantis_netcfg.operations.computers._emulation import RehearsedComputers, rehearsed_computers, tree_spec
    from atlantis_netcfg.operations.computers._wanted import perform
    from atlantis_netcfg.operations.computers._watch import Watch
    from atlantis_netcfg.operations.computers.parts import refuse_unfounded

__all__ = [
    "RehearsedComputers",
    "Watch",
    "is_computer",
    "is_gateway",
    "is_server",
    "perform",
    "refuse_unfounded",
    "rehearsed_computers",
    "tree_spec",
]

__getattr__ = homes(
    __name__,
    {
        "_access": ("is_computer", "is_gateway", "is_server"),
        "_emulation": ("RehearsedComputers", "rehearsed_computers", "tree_spec"),
        "_wanted": ("perform",),
        "_watch": ("Watch",),
        "parts": ("refuse_unfounded",),
    },
)
