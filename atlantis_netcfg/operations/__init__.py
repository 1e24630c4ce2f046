"""What a door can ask for: provision a site, go on after a break, put a saved state back, take a backup.

A request names the way (plan, apply, …); the declaration is rendered into desired text, every device becomes one job
of the engine, and one result per device comes back. The command line asks through Ansible, Ansible asks through one
action plugin, and both end here.
"""

from __future__ import annotations

from atlantis_netcfg.operations.common.request import Mode, Request, Target

__all__ = ["Mode", "Request", "Target"]
