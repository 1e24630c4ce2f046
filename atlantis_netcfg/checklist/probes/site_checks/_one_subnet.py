"""No interface has two addresses of one subnet: a lease that ends takes the shared route along (BlueOS 4054)."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations
from typing import TYPE_CHECKING

from atlantis_netcfg.bearers import Finding
from atlantis_netcfg.checklist.probes.site_checks._site import OwnSite, ask, run, step
from atlantis_netcfg.checklist.probes.site_checks.findings import fail, good, listed, read
from atlantis_netcfg.checklist.probes.site_checks.parse import Held, addresses
from atlantis_netcfg.checklist.probes.step import Judged

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from atlantis_netcfg.checklist.probes.requests import Question
    from atlantis_netcfg.checklist.probes.results import Answer
    from atlantis_netcfg.checklist.probes.step import Step

__all__ = ["of"]

_HINT = "take one of them away: when a lease ends, it takes the route of both along, and contact is lost"


def of(site: OwnSite) -> Step:
    """The router's and the gateway computer's own addresses."""
    return step("one-subnet-twice", "No two addresses of one subnet on one interface", _OneSubnet(site), site.hosts)


@dataclass(frozen=True, slots=True)
class _OneSubnet:
    """No two addresses of one subnet on one interface."""

    site: OwnSite

    def asks(self) -> tuple[Question, ...]:
        return (
            *ask("router", self.site, "/ip/address", "address", "interface", "disabled", "invalid", "dynamic"),
            *run("gateway", self.site, "ip -j addr show"),
        )

    def judge(self, results: Mapping[str, Answer]) -> Judged:
        assert self.site.router is not None  # noqa: S101 - the check is made for sites with a router
        names = {"router": self.site.router.name}
        if self.site.gateway is not None:
            names["gateway"] = self.site.gateway.name
        values = {name: addresses(results[question], name) for question, name in names.items()}
        current = {name: found for name, found in values.items() if not isinstance(found, Finding)}
        silence = tuple(found for found in values.values() if isinstance(found, Finding))
        wrong = tuple(finding for name, found in current.items() for finding in _twice(name, found))
        evidence = tuple(
            read(f"{item.interface} of {name}", _worded(item)) for name, found in current.items() for item in found
        )
        fine = good("each-subnet-once", f"no interface of {listed(names.values())} has two addresses of one subnet")
        return Judged((*wrong, *silence) or (fine,), evidence)


def _twice(name: str, found: tuple[Held, ...]) -> Iterator[Finding]:
    for item, other in combinations([current for current in found if not current.dead], 2):
        if item.interface == other.interface and item.address.network.overlaps(other.address.network):
            message = f"{item.interface} of {name} has {_worded(item)} and {_worded(other)}, which are in one subnet"
            yield fail("subnet-twice", message, _HINT)


def _worded(item: Held) -> str:
    return f"{item.address} ({'leased' if item.leased else 'static'})"
