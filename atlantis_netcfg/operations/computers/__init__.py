"""Gateway computers in a run: ordinary Ansible roles do the work, and this is what stands around them.

Before the roles `wanted` tells each of them what its hosts should hold, as data made by pure functions. While they run
a `Watch` in Ansible's main process holds the site's lock, writes its journal, and puts every task's result into words.
"""

from __future__ import annotations

from atlantis_netcfg.operations.computers._access import is_gateway
from atlantis_netcfg.operations.computers._emulation import RehearsedGateways, rehearsed_gateways, tree_spec
from atlantis_netcfg.operations.computers._wanted import perform
from atlantis_netcfg.operations.computers._watch import Watch

__all__ = ["RehearsedGateways", "Watch", "is_gateway", "perform", "rehearsed_gateways", "tree_spec"]
