"""What is tried while the sites of a rehearsal are joined: cuts of links, data, TEST_ROBOT, then every checklist."""

from __future__ import annotations

from collections import defaultdict
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from dataclasses import dataclass, field
from functools import partial
from typing import TYPE_CHECKING, Any, Final

from atlantis_netcfg.checklist.probes.site_checks import data_reaches
from atlantis_netcfg.checklist.rehearsal import check_site
from atlantis_netcfg.core import events
from atlantis_netcfg.core.errors import ExitCode
from atlantis_netcfg.core.events import Verdict
from atlantis_netcfg.core.messages import arg, join, msg
from atlantis_netcfg.inventory import model
from atlantis_netcfg.operations.pilot_network import link_cuts, link_use, robot
from atlantis_netcfg.operations.pilot_network.allow_list import prove_allow_list

if TYPE_CHECKING:
    from atlantis_netcfg.inventory import Host
    from atlantis_netcfg.operations.pilot_network.rehearsal import PilotRehearsal

_HEARD_S: Final = 30.0
"""TEST_ROBOT, which speaks each second, is heard within this time after a change of link."""
_UNHEARD_S: Final = 5.0


@dataclass(slots=True)
class _DataOverLinks:
    """What became of one computer's data over each link of its site."""

    titles: dict[str, list[str]] = field(default_factory=lambda: defaultdict(list))
    """What arrived, and over which links."""
    messages: list[str] = field(default_factory=list)
    differences: list[str] = field(default_factory=list)

    @property
    def words(self) -> str:
        """One line for people about what was as declared."""
        parts = (msg(f"{arg(title)} (over {arg(join(', ', links))})") for title, links in self.titles.items())
        return msg(f"with packets: {arg(join('; ', parts))}")


def try_sites(pilot: PilotRehearsal, notify: events.Subscriber = events.ignore) -> dict[str, dict[str, Any]]:
    """Try everything; return by host name what to add to its result. Raises MachineError.

    Without the VPN's server only the cuts of links are tried.
    """
    fields: dict[str, dict[str, Any]] = defaultdict(dict)
    for name, why in pilot.silent.items():
        fields[name] = {"exit": ExitCode.FAILED, "status": "unknown", "message": why}
    sites = [host.site for host in pilot.routers] if pilot.has_server else []
    with ExitStack() as stack:
        listener = _robots(pilot, stack)
        pool = stack.enter_context(ThreadPoolExecutor(max(1, len(pilot.routers))))
        for section in pool.map(lambda host: _try_links(pilot, host, listener), pilot.routers):
            for name, rest in section.items():
                fields[name] |= rest
    with ThreadPoolExecutor(max(1, len(sites))) as pool:
        list(pool.map(lambda site: _run_checklist(pilot, site, fields, notify), sites))
    return fields


def _try_links(pilot: PilotRehearsal, host: Host, listener: robot.RobotProcess | None) -> dict[str, dict[str, Any]]:
    """Cut the links of one site and send data over each; return by host name what to add to its result."""
    fields: dict[str, dict[str, Any]] = defaultdict(dict)
    sender, data = pilot.inventory.computer_of(host.site), _DataOverLinks()

    def visit(link: str) -> None:
        if pilot.has_server and sender is not None and sender.name in pilot.rehearsal.computers.machines:
            _try_data(pilot, sender, link, listener, data)

    cuts = link_cuts.cut_links(pilot, host, visit)
    if cuts.moves:
        uses = link_use.use_links(pilot, host)
        words, differences = join("; ", (cuts.words, uses.words)), [*cuts.differences, *uses.differences]
        _add(fields[host.name], "link_cuts", words, differences)
        _wait_for_robot(pilot, host.site, sender, listener)
    if sender is not None and (data.messages or data.differences):
        _add(fields[sender.name], "data", data.words, data.differences)
        fields[sender.name]["data"]["messages"] = data.messages
    return fields


def _wait_for_robot(pilot: PilotRehearsal, site: str, sender: Host | None, listener: robot.RobotProcess | None) -> None:
    """Wait for TEST_ROBOT over the first link: the tunnel has to have moved there before the checklists begin."""
    dds, first = pilot.inventory.pilot.dds, pilot.inventory.sites[site].bearers[0]
    if listener is None or dds is None or sender is None or not isinstance(sender.device, model.Gateway):
        return
    if first.carries(dds):
        listener.wait_for(sender.name, _HEARD_S)


def _add(result: dict[str, Any], name: str, words: str, differences: list[str]) -> None:
    """Add a section to a device's result; differences make it a failure."""
    result[name] = {"differences": differences, **({} if differences else {"words": words})}
    if differences:
        result |= {"exit": ExitCode.FAILED, "status": "unknown", "message": differences[0]}


def _robots(pilot: PilotRehearsal, stack: ExitStack) -> robot.RobotProcess | None:
    """Start TEST_ROBOT at each gateway, and its listener at the control centre; None if the rehearsal has none."""
    machines = pilot.rehearsal.computers.machines
    places = [
        (host.device, name, machines[name].namespace)
        for name, host in pilot.inventory.hosts.items()
        if name in machines and isinstance(host.device, model.ServerComputer) and host.device.vpn_address is not None
    ]
    centres = [
        (place, str(device.vpn_address)) for device, _, place in places if isinstance(device, model.ControlCentre)
    ]
    robots = [
        (name, place, str(device.vpn_address)) for device, name, place in places if isinstance(device, model.Gateway)
    ]
    if not pilot.has_server or not centres or not robots or pilot.inventory.pilot.dds is None:
        return None
    return stack.enter_context(robot.run_robots(pilot.inventory, robots, centres[0]))


def _try_data(
    pilot: PilotRehearsal, sender: Host, link: str, listener: robot.RobotProcess | None, data: _DataOverLinks
) -> None:
    """Send data from a site's computer, and look whether TEST_ROBOT is heard exactly where DDS may pass."""
    outcome = check_site(pilot.inventory, sender.site, pilot.rehearsal, has_real_tunnels=True, step=data_reaches.NAME)
    for item in outcome.items:
        if item.verdict in {Verdict.PASS, Verdict.WARN} and item.id in outcome.by_machine:
            data.titles[item.title].append(link)
            data.messages.append(item.message)
        else:
            data.differences.append(msg(f"over {arg(link)}: {arg(item.message)}"))
    dds = pilot.inventory.pilot.dds
    if listener is None or dds is None or not isinstance(sender.device, model.Gateway):
        return
    may_pass = next(each for each in pilot.inventory.sites[sender.site].bearers if each.name == link).carries(dds)
    is_heard = listener.wait_for(sender.name, _HEARD_S if may_pass else _UNHEARD_S)
    if is_heard is may_pass:
        visible, kept_off = msg(f"{arg(robot.NAME)} is seen at the control centre"), msg("DDS is kept off, as declared")
        data.titles[visible if may_pass else kept_off].append(link)
    elif may_pass:
        data.differences.append(msg(f"{arg(robot.NAME)} is not seen at the control centre over {arg(link)}"))
    else:
        data.differences.append(msg(f"DDS passes {arg(link)}, which must not carry it"))


def _run_checklist(
    pilot: PilotRehearsal, site: str, fields: dict[str, dict[str, Any]], notify: events.Subscriber
) -> None:
    """Run the automatic items of a site's checklist; its computer's result gets them."""
    computer = pilot.inventory.computer_of(site)
    if computer is None:
        return
    prove = partial(prove_allow_list, pilot)
    outcome = check_site(pilot.inventory, site, pilot.rehearsal, notify, has_real_tunnels=True, prove=prove)
    problems = [msg(f"{arg(item.verdict)}: {arg(item.id)}: {arg(item.message)}") for item in outcome.problems]
    fields[computer.name]["checklist"] = {**outcome.as_dict(), "differences": problems}
    if any(item.verdict in {Verdict.FAIL, Verdict.ERROR} for item in outcome.problems):
        fields[computer.name].setdefault("exit", ExitCode.CHECKS_FAILED)
