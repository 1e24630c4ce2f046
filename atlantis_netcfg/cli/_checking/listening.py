"""Select what probes run against: the real site, or a rehearsal of it in which faults may be injected."""

from __future__ import annotations

from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING

from atlantis_netcfg.checklist.probes import Place
from atlantis_netcfg.checklist.runner import RealEars
from atlantis_netcfg.core.errors import ExitCode, NetcfgError, UsageError
from atlantis_netcfg.core.suggest import nearest
from atlantis_netcfg.operations import Mode

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from atlantis_netcfg.checklist import Checklist, Entry
    from atlantis_netcfg.checklist.runner import Ears
    from atlantis_netcfg.cli._session import Session
    from atlantis_netcfg.core.events import Subscriber


@dataclass(frozen=True, slots=True)
class Listening:
    """The ears of a site."""

    free: Ears
    paid: Ears
    """The same when somebody has agreed to pay for what is asked."""


def refuse_faults(faults: Sequence[str], *, rehearsed: bool) -> None:
    """Raise UsageError for what cannot be broken: nothing is, unless it is emulated."""
    if not faults:
        return
    if not rehearsed:
        raise UsageError("`break=` is for rehearsals: nothing real is broken on purpose", hint="add --rehearse")
    from atlantis_netcfg.checklist.runner.simulated import FAULTS

    for fault in faults:
        if fault not in FAULTS:
            near = nearest(fault, FAULTS)
            known = "\n".join(["it takes:", *(f"{name:<20} {item.words}" for name, item in FAULTS.items())])
            raise UsageError(f"`break={fault}`: no such fault", hint=f"did you mean `break={near}`?" if near else known)


def refuse_absent(faults: Sequence[str], every: Checklist) -> None:
    """Raise UsageError for a fault of something that this site does not have; `every`: its list, not narrowed."""
    if not faults:
        return
    from atlantis_netcfg.checklist.runner.simulated import FAULTS

    here = {entry.item.id for entry in every.entries}
    for fault in faults:
        if not any(turn.replace("SITE", every.site) in here for turn in FAULTS[fault].turns):
            what = f"`break={fault}`: {every.site} has nothing to break there ({FAULTS[fault].words})"
            raise UsageError(
                what, hint="faults are told for the coastal testbed of the shipped inventory: try site=coastal"
            )


def broken(faults: Sequence[str]) -> tuple[str, ...]:
    """What is broken, in words."""
    if not faults:
        return ()
    from atlantis_netcfg.checklist.runner.simulated import FAULTS

    return tuple(f"{fault}: {FAULTS[fault].words}" for fault in faults)


def breaks_a_site(faults: Sequence[str]) -> bool:
    """Whether something beside vehicles is broken, which may be a router."""
    if not faults:
        return False
    from atlantis_netcfg.checklist.runner.simulated import FAULTS

    return any(turn.startswith("SITE/") for fault in faults for turn in FAULTS[fault].turns)


def asks_a_router(entries: Sequence[Entry]) -> bool:
    """Whether routers have to be there: a rehearsal starts and configures them for that alone."""
    probes = [entry.step.probe for entry in entries if entry.step.probe is not None]
    return any(question.place is Place.ROUTER for probe in probes for question in probe.asks())


def not_rehearsed(opened: Session, entries: Sequence[Entry]) -> tuple[str, ...]:
    """What the twins of these entries cannot stand for."""
    if opened.rehearsal is None:
        return ()
    from atlantis_netcfg.emulator import acoustic, gnss, linux, mavlink

    requested = {entry.item.endpoint for entry in entries if entry.step.probe is not None}
    values = {"gps": gnss, "rc_rf": mavlink, "acoustic": acoustic, "usbl": acoustic}
    beside = [line for endpoint, twin in values.items() if endpoint in requested for line in twin.NOT_REHEARSED]
    return tuple(dict.fromkeys([*beside, *linux.NOT_REHEARSED, *opened.rehearsal.not_rehearsed]))


@contextmanager
def listening(
    opened: Session, faults: Sequence[str], notify: Subscriber, ssh_config: str | None = None
) -> Iterator[Listening]:
    """Give the ears of a site, once somebody has agreed to what the looking may cost. Raises CostRefused.

    `ssh_config`: file of OpenSSH that says how the gateway is reached, in place of the declared address.
    """
    if opened.rehearsal is None:
        request = opened.paid(opened.request(Mode.DRIFT))
        paid = request.model_copy(update={"accept_cost": True})
        both = [RealEars(opened.declaration, opened.site, each, notify, ssh_config) for each in (request, paid)]
        yield Listening(*both)
        return
    from atlantis_netcfg.checklist.runner.simulated import rehearsed_ears

    if opened.rehearsal.targets:
        _configure(opened)
    with rehearsed_ears(opened.declaration, opened.site, opened.rehearsal, faults) as ears:
        yield Listening(ears, ears)


def _configure(opened: Session) -> None:
    """Bring the emulated devices to their declared state: fresh from `provision adopt` they have no links."""
    report = opened.perform(Mode.APPLY)
    if report.exit not in {ExitCode.DONE, ExitCode.CHECKS_FAILED, ExitCode.NOTHING}:
        raise NetcfgError(f"the emulated devices could not be configured:\n{report.as_text()}")
