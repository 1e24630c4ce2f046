"""What a request costs on the links that are paid by the byte: told and agreed to first, counted after.

Every door ends here, so that neither a command nor a playbook can forget to ask: `gate` refuses a request before its
first byte, a `Meter` stands beside each device's run, and `Costs.told` is the bill.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

from atlantis_netcfg.operations.costs._gate import beforehand, gate, unpaid
from atlantis_netcfg.operations.costs._links import link_of, links_of, ports_of, ways_of
from atlantis_netcfg.operations.costs._meter import Meter

if TYPE_CHECKING:
    from collections.abc import Mapping

    from atlantis_netcfg.declaration import Declaration
    from atlantis_netcfg.journal import Recorder, Store
    from atlantis_netcfg.operations.request import Request
    from atlantis_netcfg.routeros.apply import DeviceJob, DeviceResult

__all__ = ["Costs", "Meter", "beforehand", "gate", "link_of", "links_of", "ports_of", "unpaid", "ways_of"]


@dataclass(slots=True)
class Costs:
    """The meters of one request, made when their device's turn comes."""

    declaration: Declaration
    request: Request
    _meters: dict[str, Meter] = field(default_factory=dict)

    def beside(self, job: DeviceJob) -> DeviceJob:
        """Give a job its meter."""
        meter = self._meter(job.name)
        return replace(job, toll=meter, counted=meter.ports)

    def told(self, result: DeviceResult, journal: Recorder, store: Store) -> Mapping[str, Any]:
        """What a device's result says besides, once it has ended; before its site's journal is closed."""
        told = self._meter(result.name).told(result, journal, store)
        del self._meters[result.name]
        return told

    def _meter(self, name: str) -> Meter:
        if name not in self._meters:
            self._meters[name] = Meter(self.declaration, self.declaration.hosts[name], self.request)
        return self._meters[name]
