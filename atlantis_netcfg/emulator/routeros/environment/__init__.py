"""What stands around a router twin, and what the router shows of it: neighbours, loads on PoE, the far end of a VPN.

All of it is a fact of the place and no setting, so that no command changes it; a rehearsal does, by the twin's control.
The names of fields are those of the manual (PoE-Out, DHCP, Neighbor discovery, OVPN, NTP).

Assumption: poe-load
"""

from __future__ import annotations

from atlantis_netcfg.emulator.routeros.environment._spec import Called, Environment, Load, Validity

__all__ = ["Called", "Environment", "Load", "Validity"]
