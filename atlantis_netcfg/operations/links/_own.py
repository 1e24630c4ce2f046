"""What a bearer's own boxes say of it: the radios of a bridge, the 4G unit, and of a terminal what is declared."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

from atlantis_netcfg.bearers import Finding, LinkState, Quality
from atlantis_netcfg.bearers import wifi as radios
from atlantis_netcfg.bearers.lte import judge as units
from atlantis_netcfg.bearers.satellite import judge_carrier_nat
from atlantis_netcfg.operations.links._radio import RadioLook, wanted_of
from atlantis_netcfg.site.model import LteRouter
from atlantis_netcfg.verdicts import Verdict

if TYPE_CHECKING:
    from collections.abc import Iterable

    from atlantis_netcfg.operations.links._unit import UnitLook
    from atlantis_netcfg.site import Host

__all__ = ["Own", "Silent", "of_bridge", "of_unit", "unheard"]


@dataclass(frozen=True, slots=True)
class Silent:
    """A device that was asked and did not answer, or not as one of its kind does."""

    device: str
    message: str
    hint: str | None = None


@dataclass(frozen=True, slots=True)
class Own:
    """What the boxes of one bearer said."""

    state: LinkState | None = None
    """None: they say nothing of it, or there is no box that could."""
    quality: Quality = field(default_factory=dict)
    findings: tuple[Finding, ...] = ()
    silent: tuple[Silent, ...] = ()


def of_bridge(near: tuple[Host, RadioLook | Silent | None], far: tuple[Host, RadioLook | Silent | None] | None) -> Own:
    """Judge both ends; the readings are the near end's, with what the far end hears beside them.

    An end is a look, a silence, or None where it was not to be asked; `far` is None where nobody declares one.
    """
    ends = [end for end in (near, far) if end is not None]
    macs = {host.name: told.mac for host, told in ends if isinstance(told, RadioLook)}
    own = Own(silent=tuple(told for _, told in ends if isinstance(told, Silent)))
    for host, told in ends:
        if not isinstance(told, RadioLook):
            continue
        own = _joined(own, _of_end(host, told, [other for other, _ in ends if other is not host], macs))
    return own


def _of_end(host: Host, look: RadioLook, others: list[Host], macs: dict[str, str | None]) -> Own:
    if look.reading is None:
        message = f"{host.name}: its menus show no radio"
        hint = "RouterOS 7.13 and later need the package `wireless` or `wifi-qcom` for it: see docs/wifi-link.md"
        return Own(LinkState.DOWN, {}, (Finding(Verdict.FAIL, "no-radio", message, hint),))
    if not others:
        return Own(radios.link_state(look.reading), radios.quality(look.reading))
    wanted = wanted_of(host, others[0], macs.get(others[0].name))
    found = (_said_by(host, finding) for finding in radios.judge(look.reading, wanted))
    return Own(radios.link_state(look.reading), radios.quality(look.reading, wanted), tuple(found))


def _said_by(host: Host, finding: Finding) -> Finding:
    return replace(finding, message=f"{host.name}: {finding.message}")


def _joined(first: Own, second: Own) -> Own:
    """The first end's readings stay; of the second's only what it hears. The worse state of the two holds."""
    if first.state is None:
        return replace(second, silent=first.silent)
    heard: Quality = {"far_signal_dbm": second.quality.get("signal_dbm")}
    states = [state for state in (first.state, second.state) if state is not None]
    return Own(max(states, key=_WORSE.index), first.quality | heard, (*first.findings, *second.findings), first.silent)


_WORSE = (LinkState.UP, LinkState.UNKNOWN, LinkState.SEARCHING, LinkState.DOWN)


def of_unit(host: Host, told: UnitLook | Silent | None, *, forwards: bool) -> Own:
    """Judge a 4G unit. `forwards`: ports of the site's outer addresses are declared to lead inside."""
    if told is None or isinstance(told, Silent):
        return Own(silent=() if told is None else (told,))
    assert isinstance(host.device, LteRouter)  # noqa: S101 - the caller's table of kinds
    reading = told.reading
    found = (_said_by(host, finding) for finding in units.judge(reading, wanted_of_unit(host.device)))
    hidden = judge_carrier_nat(host.name, reading.address, forwards=forwards)
    quality = units.quality(reading) | {"carrier_nat": None if reading.address is None else _word(bool(hidden))}
    shut = hidden if forwards else ()
    return Own(units.link_state(reading), quality, (*found, *shut, *told.findings))


def _word(so: bool) -> str:  # noqa: FBT001 - it is the value that is put into words
    return "yes" if so else "no"


def wanted_of_unit(device: LteRouter) -> units.LteWanted:
    """What is declared of the SIM."""
    sim = device.sim
    return units.LteWanted(
        apn=sim.apn,
        roaming=sim.roaming,
        pin_declared=sim.pin is not None,
        apn_required=sim.user is not None or sim.password is not None,
        bands=sim.bands,
    )


def unheard(silent: Iterable[Silent], *, answers: bool | None) -> tuple[Finding, ...]:
    """What follows from a box that does not answer: little where its link answers, much where nothing does."""
    verdict = Verdict.INCONCLUSIVE if answers is not False else Verdict.FAIL
    told = {True: ", but its link works", None: "", False: ", and nobody answers over its link"}[answers]
    return tuple(
        Finding(verdict, "device-unreachable", f"{one.device} cannot be read{told}: {one.message}", one.hint)
        for one in silent
    )
