"""`--rehearse`: the run itself, then again over every link of the site; the repeated runs must change nothing."""

from __future__ import annotations

import sys
from contextlib import ExitStack
from copy import copy
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from atlantis_netcfg.core.errors import ExitCode
from atlantis_netcfg.core.language import translate
from atlantis_netcfg.core.messages import arg, conjunction, join, msg
from atlantis_netcfg.inventory.model import Router
from atlantis_netcfg.operations import Mode
from atlantis_netcfg.operations.common.kinds import is_other_lte_unit
from atlantis_netcfg.operations.common.session_link import LAN, site_link_of
from atlantis_netcfg.runs.report.run import Pass, RunReport

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

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
    for try_packets in (_try_flows, _join_sites):
        if report.exit is ExitCode.DONE:
            report = try_packets(session, emulators, report)
    return report


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
    return _with_fields(report, flows, [*dataplane.NOT_REHEARSED, *rehearsal.limits(flows)])


def _join_sites(session: CommandSession, emulators: Rehearsal, report: RunReport) -> RunReport:
    """Join the sites, where this computer may make namespaces: cut links, send data, and run the checklists."""
    from atlantis_netcfg.checklist import pilot_rehearsal
    from atlantis_netcfg.emulator import lab
    from atlantis_netcfg.operations.pilot_network.rehearsal import join_sites

    hosts = session.contacted_hosts
    if lab.why_no_namespace() is not None or not any(isinstance(host.device, Router) for host in hosts):
        return report  # the packets of the flows have said why
    if not session.as_json:
        print(translate("Sites joined: links are cut one by one"), file=sys.stderr, flush=True)
    request = session.request(Mode.APPLY)
    with ExitStack() as stack:
        try:
            pilot = stack.enter_context(join_sites(session.inventory, hosts, emulators, request))
        except lab.MachineError as error:  # of this computer's kernel or programs, not of the sites
            limit = msg(f"sites were not joined: {arg(str(error))}")
            return replace(report, not_rehearsed=(*report.not_rehearsed, limit))
        fields = pilot_rehearsal.try_sites(pilot)
    limits = [line for each in fields.values() for line in each.get("checklist", {}).get("not_rehearsed", ())]
    if not pilot.has_server:
        limits.append(msg("data, TEST_ROBOT and checklists with packets: rehearse site=all"))
    return _with_fields(report, fields, limits)


def _with_fields(report: RunReport, fields: Mapping[str, Mapping[str, Any]], limits: Sequence[str]) -> RunReport:
    """Add fields to the results of devices, and limits."""
    devices = {name: {**result, **fields.get(name, {})} for name, result in report.devices.items()}
    return replace(report, devices=devices, not_rehearsed=tuple(dict.fromkeys([*report.not_rehearsed, *limits])))


def announce(session: CommandSession) -> None:
    """Print that no real device is contacted."""
    if not session.as_json:
        sites = {host.site for host in session.hosts}
        titles = join(", ", (site.title for name, site in session.inventory.sites.items() if name in sites))
        words = msg(f"Rehearsal of {arg(session.site)} ({arg(titles)}): emulated devices, no real device is contacted")
        print(translate(words), flush=True)


def _again(session: CommandSession, emulators: Rehearsal, first: RunReport) -> RunReport:
    """Run again until every device was reached over each link of its site. Ctrl-C ends it without passing."""
    passes: list[Pass] = []
    rounds, host_names = _rounds(session), {host.name for host in session.hosts}
    for number, links in enumerate(rounds, 1):
        if not session.as_json:
            over = conjunction(dict.fromkeys(links.values()))
            words = msg(f"Repeated run {arg(number)} of {arg(len(rounds))}, over {arg(over)}: no change may be left")
            print(translate(words), file=sys.stderr, flush=True)
        via = {host.name: links[host.name] for host in session.contacted_hosts if host.name in links}
        for host in session.contacted_hosts:
            link = site_link_of(session.inventory, host, via.get(host.name, session.via))
            emulators.relink(session.inventory, host, link.name)
        part = copy(session)
        part.narrow(list(links))
        again = part.perform(Mode.APPLY, via=via)
        for device, result in again.devices.items():
            link_name = links.get(device if device in host_names else result.get("other_end", ""))
            if link_name is not None:
                passes.append(Pass(device, link_name, result))
        if again.stopped_by:
            return replace(first, passes=tuple(passes), stopped_by=again.stopped_by)
    return replace(first, passes=tuple(passes))


def _rounds(session: CommandSession) -> list[dict[str, str]]:
    """Return the link of each device in each repeated run; the slowest, which sites declare last, go side by side."""
    units = (host for host in session.hosts if is_other_lte_unit(host))
    links = {
        host.name: [LAN.name, *(link.name for link in session.inventory.sites[host.site].bearers)]
        for host in (*session.contacted_hosts, *units)
    }
    number = max(map(len, links.values()), default=0)
    return [
        {name: choices[last] for name, choices in links.items() if last >= -len(choices)} for last in range(-number, 0)
    ]
