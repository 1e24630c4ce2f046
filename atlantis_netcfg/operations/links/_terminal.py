"""A satellite terminal: nothing is sent over it, nobody asks it; what is declared, and what the router sees of it."""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.operations.links._own import Own
from atlantis_netcfg.operations.terminals import is_terminal, look

if TYPE_CHECKING:
    from datetime import date

    from atlantis_netcfg.bearers import Quality
    from atlantis_netcfg.declaration import Declaration, Host
    from atlantis_netcfg.declaration.model import Bearer
    from atlantis_netcfg.journal import Store
    from atlantis_netcfg.operations.links._router import RouterReading

__all__ = ["kept_off", "of_terminal"]


def of_terminal(declaration: Declaration, host: Host | None, store: Store, today: date) -> Own:
    """Tell what a person has seen of the terminal, and what is wrong with that. Raises StateDamaged."""
    if host is None or not is_terminal(host):
        return Own()
    found = look(declaration, host, store, today=today)
    evidence = found.evidence
    quality: Quality = {
        "firmware": None if evidence is None else evidence.firmware,
        "seen_by": None if evidence is None else evidence.by,
        "seen_on": None if evidence is None else evidence.seen_on.isoformat(),
    }
    return Own(None, quality, found.findings)


def kept_off(bearer: Bearer, port: str | None, router: RouterReading | None) -> Quality:
    """What the router has kept off the link, and whether the next hop has answered ARP on the port of late.

    The chain's name is that of `render.view.Uplink.chain`. An entry of ARP ages, so that its absence proves nothing.
    """
    there = None if router is None or router.neighbours is None else router.neighbours.get(port or "", ())
    counted = None if router is None or router.dropped is None else router.dropped.get(f"to-{bearer.name}")
    seen = None if there is None else str(bearer.gateway) in {one.address for one in there}
    return {
        "next_hop_seen": {None: None, True: "yes", False: "no"}[seen],
        "kept_off_packets": None if counted is None else counted[0],
        "kept_off_bytes": None if counted is None else counted[1],
    }
