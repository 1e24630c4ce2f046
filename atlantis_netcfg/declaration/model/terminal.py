"""The satellite terminal of a site. `host_vars/<host>.yml`, key `device`."""

from __future__ import annotations

from typing import Literal

from pydantic import StrictBool

from atlantis_netcfg.declaration.model._base import Address, Day, Model, Sha256, Text
from atlantis_netcfg.declaration.model._box import Box

__all__ = ["SatelliteTerminal", "TerminalEvidence"]


class TerminalEvidence(Model):
    """What a person has seen on the terminal's own pages, and when."""

    firmware: Text
    """As the terminal shows it."""
    backup_file: Text | None = None
    """Name of the backup that the terminal exported; the file itself is looked for in `evidence/` of the inventory."""
    backup_sha256: Sha256 | None = None
    """Of that file, so that a changed terminal is noticed by its next backup."""
    allow_list: StrictBool
    """Whether the terminal's own filter holds the declared destinations and nothing else."""
    sim_address: Address | None = None
    """The terminal's address towards the network, if its page shows one: behind a carrier's NAT it is a private one."""
    by: Text
    """Who has looked."""
    seen_on: Day
    """Day, like 2026-11-21."""


class SatelliteTerminal(Box):
    """The Thales VesseLINK: no machine interface of it is documented, so its own settings are declared, not driven."""

    kind: Literal["satellite_terminal"]
    address: Address
    driver: Literal["manual"] = "manual"
    """The one there is: no terminal of the pilot has a documented interface."""
    evidence: TerminalEvidence | None = None
    """None: nobody has looked yet, which every report says."""
