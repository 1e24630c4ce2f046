"""Operations: provision a site, resume after an interruption, restore a saved state, take a backup.

A request names the mode (plan, apply, …); the inventory is rendered into the desired text, every device becomes one job
of the engine, and one result per device is returned. The command line calls Ansible, Ansible calls one action plugin,
and both end here.
"""

from __future__ import annotations

from atlantis_netcfg.operations.common.request import Mode, Request, Target

__all__ = ["Mode", "Request", "Target"]
