"""Names behind the addresses of the allow-list: the list holds addresses, and names move."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from atlantis_netcfg.bearers.status import Finding
from atlantis_netcfg.core.verdicts import Verdict

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping

__all__ = ["NamedTarget", "judge_names"]


@dataclass(frozen=True, slots=True)
class NamedTarget:
    """An entry of an allow-list that has a name."""

    what: str
    """What it is for: `VPN server`."""
    dns_name: str
    address: str
    """As declared."""
    where: str
    """Where that is written, for the hint: `pilot.vpn in group_vars/all/pilot.yml`."""


def judge_names(
    targets: Iterable[NamedTarget], resolved: Mapping[str, frozenset[str] | None], by: str
) -> tuple[Finding, ...]:
    """Compare declared addresses with what names resolve to; `by` says who was asked: `this computer`, `the router`.

    `resolved` holds the IPv4 addresses of each name, an empty set for a name that does not exist, None for a name that
    could not be asked about: that is silence, and proves nothing.
    """
    return tuple(finding for target in targets for finding in _judge(target, resolved.get(target.dns_name), by))


def _judge(target: NamedTarget, addresses: frozenset[str] | None, by: str) -> Iterator[Finding]:
    name = f"{target.dns_name} ({target.what})"
    if addresses is None:
        message = f"{by} could not ask for {name}: whether it is still {target.address} is not known"
        yield Finding(Verdict.INCONCLUSIVE, "allow-list-name-not-asked", message, "ask again where DNS answers")
    elif not addresses:
        message = f"{by} knows no address of {name}; the allow-list admits {target.address}"
        hint = f"correct `dns_name`, or the name itself ({target.where})"
        yield Finding(Verdict.WARN, "allow-list-name-unknown", message, hint)
    elif target.address not in addresses:
        found = ", ".join(sorted(addresses))
        message = f"{name} has moved: {by} resolves it to {found}, the allow-list admits {target.address}"
        hint = f"declare the right address ({target.where}) and provision the site before it is left with its satellite"
        yield Finding(Verdict.FAIL, "allow-list-name-moved", message, hint)
    elif len(addresses) > 1:
        others = ", ".join(sorted(addresses - {target.address}))
        message = f"{name} has more addresses than the allow-list admits: {target.address}, but also {others}"
        hint = "whoever takes one of the others over the satellite is dropped: add them to `allow:` if they are meant"
        yield Finding(Verdict.WARN, "allow-list-name-has-more", message, hint)
