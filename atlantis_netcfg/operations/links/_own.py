"""What a bearer's own boxes say of it, and of a bridge what both of its ends say."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

from atlantis_netcfg.bearers import Finding, LinkState, Quality
from atlantis_netcfg.bearers import wifi as radios
from atlantis_netcfg.core.verdicts import Verdict
from atlantis_netcfg.operations.links._radio import RadioLook, wanted_of

if TYPE_CHECKING:
    from collections.abc import Iterable

    from atlantis_netcfg.declaration import Host

__all__ = ["Own", "Silent", "of_bridge", "unheard"]


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
        if isinstance(told, RadioLook):
            judged = _of_end(host, told, [other for other, _ in ends if other is not host], macs)
            own = _joined(own, judged if host is near[0] else _far(judged))
    return _expected(own, far[1]) if far is not None and isinstance(far[1], Silent) else own


def _expected(own: Own, far: Silent) -> Own:
    """While the near end hears nobody, that the far one does not answer is no news."""
    if own.state in {None, LinkState.UP, LinkState.UNKNOWN} or far not in own.silent:
        return own
    message = f"{far.device} cannot be read, as is to be expected while the bridge is down: {far.message}"
    hint = "repair the bridge first; if it stays away after that, look at its power"
    found = Finding(Verdict.INCONCLUSIVE, "far-end-unreachable", message, hint)
    rest = tuple(one for one in own.silent if one is not far)
    return replace(own, findings=(*own.findings, found), silent=rest)


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


def _far(own: Own) -> Own:
    """Of the far end's readings only what it hears."""
    return replace(own, quality={"far_signal_dbm": own.quality.get("signal_dbm")})


def _joined(first: Own, second: Own) -> Own:
    """The worse state of the two holds."""
    states = [state for state in (first.state, second.state) if state is not None]
    return Own(
        max(states, key=_WORSE.index, default=None),
        first.quality | second.quality,
        (*first.findings, *second.findings),
        (*first.silent, *second.silent),
    )


_WORSE = (LinkState.UP, LinkState.UNKNOWN, LinkState.SEARCHING, LinkState.DOWN)


def unheard(silent: Iterable[Silent], *, answers: bool | None) -> tuple[Finding, ...]:
    """What follows from a box that does not answer: little where its link answers, much where nothing does."""
    verdict = Verdict.INCONCLUSIVE if answers is not False else Verdict.FAIL
    told = {True: ", but its link works", None: "", False: ", and nobody answers over its link"}[answers]
    return tuple(
        Finding(verdict, "device-unreachable", f"{one.device} cannot be read{told}: {one.message}", one.hint)
        for one in silent
    )
