"""The satellite link: what is declared of the terminal, what its names resolve to, and what probing has shown.

The terminal of the pilot (Thales VesseLINK) has no documented interface: nobody has published a manual of one, an API,
or code that speaks to it. So nothing here drives it, and no form of its pages is filled in from imagination. What a
person has seen there is declared, with evidence; whether the allow-list holds is put to the test by probes from the
router.
A terminal that has an interface gets a driver of the protocol `SatTerminal` with the capabilities that it really has.
"""

from __future__ import annotations

from atlantis_netcfg.bearers.satellite.addresses import judge_carrier_nat, judge_factory_address
from atlantis_netcfg.bearers.satellite.evidence import STALE_AFTER_DAYS, Backup, Evidence, judge_evidence
from atlantis_netcfg.bearers.satellite.names import NamedTarget, judge_names
from atlantis_netcfg.bearers.satellite.proof import Attempt, Expected, Outcome, Probe, judge_attempt
from atlantis_netcfg.bearers.satellite.terminal import Capability, ManualTerminal, SatTerminal, Unsupported

__all__ = [
    "STALE_AFTER_DAYS",
    "Attempt",
    "Backup",
    "Capability",
    "Evidence",
    "Expected",
    "ManualTerminal",
    "NamedTarget",
    "Outcome",
    "Probe",
    "SatTerminal",
    "Unsupported",
    "judge_attempt",
    "judge_carrier_nat",
    "judge_evidence",
    "judge_factory_address",
    "judge_names",
]
