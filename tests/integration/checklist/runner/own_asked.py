"""The site's own checks, asked in a namespace that stands for the gateway computer.

What the gateway's programs print is real, and comes through the program that listens; what its router says is data.
"""

import asyncio
from collections.abc import Mapping
from dataclasses import replace

from atlantis_netcfg.checklist.probes import (
    Answer,
    Cell,
    DdsDiscoverRequest,
    Probe,
    ProbeResult,
    ReflectRequest,
    RunProgram,
)
from atlantis_netcfg.checklist.probes.site_checks import steps
from atlantis_netcfg.checklist.runner import ask_here
from atlantis_netcfg.inventory import Inventory

SITE, GATEWAY = "coastal", "coastal-gateway"
_Asked = RunProgram | DdsDiscoverRequest | ReflectRequest


def check(declaration: Inventory, name: str) -> Probe:
    """The probe of a check of the site."""
    (probe,) = (one.probe for one in steps(Cell(declaration, SITE, None, "site")) if one.name == name)
    assert probe is not None
    return probe


def inside(
    namespace: str, probe: Probe, told: Mapping[str, Answer], hurry: Mapping[str, str] | None = None
) -> ProbeResult:
    """Ask what programs print in the namespace, and judge it with what is `told` of the rest.

    `hurry`: words of programs that take their time, and those that stand for them.
    """
    asked = [(one.name, _sooner(one, hurry or {})) for one in probe.asks() if isinstance(one, _Asked)]
    assert {one.name for one in probe.asks()} == {name for name, _ in asked} | set(told)
    heard = asyncio.run(ask_here(asked, lambda *_: None, ("ip", "netns", "exec", namespace)))
    return probe.judge({**told, **heard})


def _sooner(question: _Asked, hurry: Mapping[str, str]) -> _Asked:
    if isinstance(question, RunProgram):
        return replace(question, argv=tuple(hurry.get(word, word) for word in question.argv))
    return replace(question, within_s=3.0) if hurry and isinstance(question, ReflectRequest) else question


def findings(judged: ProbeResult) -> list[str]:
    return [f"{one.verdict} {one.code}: {one.message}" for one in judged.findings]
