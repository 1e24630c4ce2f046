"""`--rehearse`: the run itself, then again over every link of the site; the repeated runs must change nothing."""

from __future__ import annotations

import sys
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from atlantis_netcfg.core.errors import ExitCode
from atlantis_netcfg.core.language import translate
from atlantis_netcfg.core.messages import arg, join, msg
from atlantis_netcfg.operations import Mode
from atlantis_netcfg.operations.common.kinds import is_other_lte_unit
from atlantis_netcfg.operations.common.session_link import LAN, site_link_of
from atlantis_netcfg.runs.report.run import Pass, RunReport

if TYPE_CHECKING:
    from atlantis_netcfg.cli.base.session import CommandSession
    from atlantis_netcfg.operations.common.rehearsal import Rehearsal


def rehearse(
    session: CommandSession, emulators: Rehearsal, *, mode: Mode = Mode.APPLY, run: str | None = None
) -> RunReport:
    """Apply over the link in the inventory, then converge again over each link with its delay and rate."""
    first = session.perform(mode, run=run)
    if session.arguments.flag("verbose"):
        session.show_plan(first)
    if first.exit is not ExitCode.DONE:
        return first
    report = _again(session, emulators, first)
    return report if report.exit is not ExitCode.DONE else _try_flows(session, emulators, report)


def _try_flows(session: CommandSession, emulators: Rehearsal, report: RunReport) -> RunReport:
    """Send the packets of every flow through the configured rows, where this computer may make namespaces."""
    from atlantis_netcfg.emulator import lab
    from atlantis_netcfg.emulator.routeros import dataplane
    from atlantis_netcfg.operations.flows import rehearsal

    routers = rehearsal.routers_of(session.contacted_hosts)
    if not routers:
        return report
    why, flows = lab.why_no_namespace(), dict[str, dict[str, Any]]()
    if why is None:
        if not session.as_json:
            words = "Packets through the routers: what may pass, and what must not"
            print(translate(words), file=sys.stderr, flush=True)
        try:
            flows = rehearsal.try_flows(session.inventory, routers, emulators.emulators)
        except lab.MachineError as error:  # of this computer's kernel or programs, not of the site
            why = str(error)
    if why is not None:
        limit = msg(f"packets: no flow was tried through the routers: {arg(why)}")
        return replace(report, not_rehearsed=(*report.not_rehearsed, limit))
    limits = [*dataplane.NOT_REHEARSED, *rehearsal.limits(flows)]
    devices = {name: {**result, **flows.get(name, {})} for name, result in report.devices.items()}
    return replace(report, devices=devices, not_rehearsed=(*report.not_rehearsed, *limits))


def announce(session: CommandSession) -> None:
    """Print that no real device is contacted."""
    if not session.as_json:
        sites = {host.site for host in session.hosts}
        titles = join(", ", (site.title for name, site in session.inventory.sites.items() if name in sites))
        words = msg(f"Rehearsal of {arg(session.site)} ({arg(titles)}): emulated devices, no real device is contacted")
        print(translate(words), flush=True)


def _again(session: CommandSession, emulators: Rehearsal, first: RunReport) -> RunReport:
    """Run again over each link; a device whose site lacks it keeps its own. Ctrl-C ends it without passing."""
    passes: list[Pass] = []
    sites = session.inventory.sites
    units = {host.name for host in session.hosts if is_other_lte_unit(host)}
    links = list(
        dict.fromkeys([LAN.name, *(link.name for host in session.contacted_hosts for link in sites[host.site].bearers)])
    )
    for number, name in enumerate(links, 1):
        if not session.as_json:
            words = msg(f"Repeated run {arg(number)} of {arg(len(links))}, over {arg(name)}: no change may be left")
            print(translate(words), file=sys.stderr, flush=True)
        via = {
            host.name: name for host in session.contacted_hosts if name in {LAN.name, *_link_names(session, host.site)}
        }
        for host in session.contacted_hosts:
            link = site_link_of(session.inventory, host, via.get(host.name, session.via))
            emulators.relink(session.inventory, host, link.name)
        again = session.perform(Mode.APPLY, via=via)
        for device, result in again.devices.items():
            if device in via or device in units or result.get("other_end") in via:
                passes.append(Pass(device, name, result))
        if again.stopped_by:
            return replace(first, passes=tuple(passes), stopped_by=again.stopped_by)
    return replace(first, passes=tuple(passes))


def _link_names(session: CommandSession, site: str) -> list[str]:
    return [link.name for link in session.inventory.sites[site].bearers]
