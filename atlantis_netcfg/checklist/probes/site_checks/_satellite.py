"""The router's own allow-list for the satellite stands whole: what wants to leave is asked, and the rest is dropped.

Whether it also works is proved by sending (`satellite/allow-list`), which costs; this only reads the rules.
"""

from __future__ import annotations

from dataclasses import dataclass
from ipaddress import IPv4Network
from typing import TYPE_CHECKING, Any

from atlantis_netcfg.bearers import Finding
from atlantis_netcfg.checklist.probes.site_checks._site import OwnSite, ask, look, step
from atlantis_netcfg.checklist.probes.site_checks.findings import declared, fail, good, listed, read
from atlantis_netcfg.checklist.probes.site_checks.parse import look as looked
from atlantis_netcfg.checklist.probes.site_checks.parse import rows, yes
from atlantis_netcfg.checklist.probes.step import Judged
from atlantis_netcfg.routeros.menus import MENUS

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from atlantis_netcfg.checklist.probes.requests import Question
    from atlantis_netcfg.checklist.probes.results import Answer
    from atlantis_netcfg.checklist.probes.step import Step
    from atlantis_netcfg.render.view import Uplink

__all__ = ["of"]

_TARGET = ("dst-address", "dst-port", "protocol", "dst-address-list")
"""By these a declared rule says where it lets packets through."""
_NO_MATCHERS = frozenset(
    {"chain", "action", "comment", "disabled", "jump-target", "log", "log-prefix", "reject-with", "hw-offload"}
    | {"address-list", "address-list-timeout"}
)
_MATCHERS = tuple(field.name for field in MENUS["/ip/firewall/filter"].fields if field.name not in _NO_MATCHERS)
"""Every property by which a rule catches some packets and not others: one that is not read may be a hole."""
_RULE = ("chain", "action", "disabled", "invalid", "jump-target", *_MATCHERS)
_RUN = "run the site before anything else: every byte that slips through is paid"


def of(site: OwnSite) -> Step:
    """The rules of the router, and how many packets they have kept off."""
    satellites = site.view.satellites if site.view is not None else ()
    unless = "" if satellites else "the site has no satellite"
    boxes = tuple(
        bearer.device
        for bearer in site.declared.bearers
        if bearer.device and bearer.name in {up.name for up in satellites}
    )
    return step(
        "satellite-filter",
        "The satellite's allow-list stands in the router",
        _Filter(site),
        (*site.hosts[:1], *boxes),
        unless,
    )


@dataclass(frozen=True, slots=True)
class _Filter:
    """The satellite's allow-list stands in the router."""

    site: OwnSite

    @property
    def _satellites(self) -> tuple[Uplink, ...]:
        assert self.site.view is not None  # noqa: S101 - the check is made for sites with a router
        return self.site.view.satellites

    def asks(self) -> tuple[Question, ...]:
        names = {satellite.name for satellite in self._satellites}
        looks = (question for question in look(self.site) if question.bearer in names)
        return (*ask("rules", self.site, "/ip/firewall/filter", *_RULE), *looks)

    def judge(self, results: Mapping[str, Answer]) -> Judged:
        assert self.site.router is not None  # noqa: S101 - the check is made for sites with a router
        result = rows(results["rules"], self.site.router.name, "its firewall", "chain")
        if isinstance(result, Finding):
            return Judged((result,))
        rules = [row for row in result if not yes(row, "disabled") and not yes(row, "invalid")]
        wrong = [finding for entry in self._satellites for finding in _judged(entry, rules)]
        fine = [self._counted(item, results) for item in self._satellites]
        evidence = [
            declared(
                f"allowed over {uplink.name}", listed(f"{target.name} ({_where(target)})" for target in uplink.targets)
            )
            for uplink in self._satellites
        ]
        evidence += [
            read(f"rules of chain {satellite.chain}", str(sum(row.get("chain") == satellite.chain for row in rules)))
            for satellite in self._satellites
        ]
        return Judged(tuple(wrong or fine), tuple(evidence))

    def _counted(self, satellite: Uplink, results: Mapping[str, Answer]) -> Finding:
        """Counters that cannot be read take nothing away: the rules were seen."""
        values = looked(results[f"look {satellite.name}"], satellite.name)
        quality = {} if isinstance(values, Finding) else values.get("quality") or {}
        count = quality.get("kept_off_packets")
        kept = f", and has kept off {count} packets so far" if isinstance(count, int) else ""
        allowed = listed(dict.fromkeys(target.name for target in satellite.targets)) or "nobody"
        return good("stands", f"the allow-list of {satellite.name} lets through {allowed} and nothing else{kept}")


def _where(target: Any) -> str:  # noqa: ANN401 - a Target of the view
    return target.address if target.port is None else f"{target.address}:{target.port}/{target.transport}"


def _judged(satellite: Uplink, rules: Sequence[Mapping[str, str]]) -> Iterator[Finding]:
    for chain in ("forward", "output"):
        yield from _asked(satellite, [row for row in rules if row.get("chain") == chain], chain)
    local = [row for row in rules if row.get("chain") == satellite.chain]
    if not local or local[-1].get("action") != "drop" or _narrow(local[-1]):
        yield fail("not-dropped", f"chain {satellite.chain} does not end by dropping the rest", _RUN)
    expected = {(item.address, str(item.port or ""), item.transport or "") for item in satellite.targets}
    letting = [row for row in local if row.get("action") not in _HOLDS]
    there = {_target(row) for row in letting}
    whole = {_target(row) for row in letting if not _narrow(row, _TARGET)}
    for target in sorted(there - expected):
        message = f"the allow-list of {satellite.name} also lets through {_worded(target)}"
        hint = "declare it under `allow:` if it is meant; else run the site, which takes it out"
        yield fail("too-wide", message, hint)
    for target in sorted(expected - whole):
        message = f"the allow-list of {satellite.name} does not let through {_worded(target)}"
        yield fail("too-narrow", message, "run the site, which puts the declared rule back")


def _asked(satellite: Uplink, rules: Sequence[Mapping[str, str]], chain: str) -> Iterator[Finding]:
    """Whether everything that leaves comes to the list, before anybody else accepts it."""
    place = next((place for place, row in enumerate(rules) if _jumps(row, satellite)), None)
    if place is None:
        message = f"what leaves over {satellite.name} is not asked: chain {chain} has no rule that leads to"
        yield fail("not-asked", f"{message} {satellite.chain}", _RUN)
    elif any(_accepts(row, satellite) for row in rules[:place]):
        message = f"a rule of chain {chain} accepts packets for {satellite.name} before its allow-list is asked"
        yield fail("bypassed", message, _RUN)


def _accepts(row: Mapping[str, str], satellite: Uplink) -> bool:
    """A rule for another port, or for the terminal itself, which costs no airtime, takes nothing past the list."""
    elsewhere = row.get("out-interface", satellite.port) != satellite.port
    terminal = _inside(row.get("dst-address", ""), satellite.network)
    return row.get("action") in {"accept", "fasttrack-connection"} and not elsewhere and not terminal


def _inside(text: str, network: str) -> bool:
    try:
        return IPv4Network(text).subnet_of(IPv4Network(network))
    except ValueError:
        return False


def _target(row: Mapping[str, str]) -> tuple[str, str, str]:
    leads = row.get("action") == "jump"
    anywhere = f"what chain {row.get('jump-target', '?')} lets through" if leads else "any address"
    return row.get("dst-address", anywhere), row.get("dst-port", ""), row.get("protocol", "")


def _worded(target: tuple[str, str, str]) -> str:
    address, port, protocol = target
    return address + (f" port {port}" if port else "") + (f" ({protocol})" if protocol else "")


_HOLDS = frozenset(
    {"drop", "reject", "tarpit", "log", "passthrough", "add-src-to-address-list", "add-dst-to-address-list"}
)
"""Actions that let nothing through by themselves."""


def _jumps(row: Mapping[str, str], satellite: Uplink) -> bool:
    leads = row.get("action") == "jump" and row.get("jump-target") == satellite.chain
    return leads and row.get("out-interface") == satellite.port and not _narrow(row, ("out-interface",))


def _narrow(row: Mapping[str, str], but: tuple[str, ...] = ()) -> bool:
    """Whether a rule catches only some of what comes to it, by anything `but` these."""
    return any(row.get(name) for name in _MATCHERS if name not in but)
