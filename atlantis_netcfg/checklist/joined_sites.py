"""What is tried while the sites of a rehearsal are joined: cuts of links, data, TEST_ROBOT, then every checklist."""

from __future__ import annotations

from collections import defaultdict
from contextlib import ExitStack
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Final

from atlantis_netcfg.checklist.probes.site_checks import data_reaches
from atlantis_netcfg.checklist.rehearsal import check_site
from atlantis_netcfg.core import events
from atlantis_netcfg.core.errors import ExitCode
from atlantis_netcfg.core.events import Verdict
from atlantis_netcfg.core.messages import arg, join, msg
from atlantis_netcfg.inventory import model
from atlantis_netcfg.operations.pilot_network import link_cuts, robot

if TYPE_CHECKING:
    from atlantis_netcfg.inventory import Host
    from atlantis_netcfg.operations.pilot_network.rehearsal import JoinedRehearsal

_HEARD_S: Final = 30.0
"""TEST_ROBOT, which speaks each second, is heard within this time after a change of link."""
_UNHEARD_S: Final = 5.0


@dataclass(slots=True)
class _DataOverLinks:
    """What a gateway's data did over each link."""

    arrivals: list[str] = field(default_factory=list)
    differences: list[str] = field(default_factory=list)

    @property
    def words(self) -> str:
        return msg(f"with packets, {arg(join('; ', self.arrivals))}")


def try_sites(joined: JoinedRehearsal, notify: events.Subscriber = events.ignore) -> dict[str, dict[str, Any]]:
    """Try everything; return by host name what to add to its result. Raises MachineError."""
    fields: dict[str, dict[str, Any]] = defaultdict(dict)
    for name, why in joined.silent.items():
        fields[name] = {"exit": ExitCode.FAILED, "status": "unknown", "message": why}
    with ExitStack() as stack:
        listener = _robots(joined, stack)
        for host in joined.routers:
            gateway = joined.inventory.computer_of(host.site)
            data = _DataOverLinks()

            def visit(link: str, gateway: Host | None = gateway, data: _DataOverLinks = data) -> None:
                if gateway is not None and gateway.name in joined.rehearsal.computers.machines:
                    _try_data(joined, gateway, link, listener, data)

            cuts = link_cuts.cut_links(joined, host, visit)
            if cuts.moves:
                _add(fields[host.name], "link_cuts", cuts.words, cuts.differences)
            if gateway is not None and (data.arrivals or data.differences):
                _add(fields[gateway.name], "data", data.words, data.differences)
    for host in joined.routers:
        _run_checklist(joined, host.site, fields, notify)
    return fields


def _add(result: dict[str, Any], name: str, words: str, differences: list[str]) -> None:
    """Add a section to a device's result; differences make it a failure."""
    result[name] = {"differences": differences, **({} if differences else {"words": words})}
    if differences:
        result |= {"exit": ExitCode.FAILED, "status": "unknown", "message": differences[0]}


def _robots(joined: JoinedRehearsal, stack: ExitStack) -> robot.RobotProcess | None:
    """Start TEST_ROBOT at each gateway, and its listener at the control centre; None if the rehearsal has none."""
    machines = joined.rehearsal.computers.machines
    places = [
        (host.device, name, machines[name].namespace)
        for name, host in joined.inventory.hosts.items()
        if name in machines and isinstance(host.device, model.ServerComputer) and host.device.vpn_address is not None
    ]
    centres = [
        (place, str(device.vpn_address)) for device, _, place in places if isinstance(device, model.ControlCentre)
    ]
    robots = [
        (name, place, str(device.vpn_address)) for device, name, place in places if isinstance(device, model.Gateway)
    ]
    if not centres or not robots or joined.inventory.pilot.dds is None:
        return None
    return stack.enter_context(robot.run_robots(joined.inventory, robots, centres[0]))


def _try_data(
    joined: JoinedRehearsal, gateway: Host, link: str, listener: robot.RobotProcess | None, data: _DataOverLinks
) -> None:
    """Send data from a gateway to the control centre, and look whether TEST_ROBOT is heard where DDS may pass."""
    outcome = check_site(
        joined.inventory, gateway.site, joined.rehearsal, has_real_tunnels=True, step=data_reaches.NAME
    )
    for item in outcome.items:
        arrived = item.verdict in {Verdict.PASS, Verdict.WARN} and item.id in outcome.by_machine
        (data.arrivals if arrived else data.differences).append(item.message)
    dds = joined.inventory.pilot.dds
    if listener is None or dds is None or not isinstance(gateway.device, model.Gateway):
        return
    may_pass = next(each for each in joined.inventory.sites[gateway.site].bearers if each.name == link).carries(dds)
    is_heard = listener.wait_for(gateway.name, _HEARD_S if may_pass else _UNHEARD_S)
    if is_heard is may_pass:
        heard = msg(f"{arg(robot.NAME)} is seen at the control centre over {arg(link)}")
        data.arrivals.append(heard if may_pass else msg(f"DDS is kept off {arg(link)}"))
    else:
        missing = msg(f"{arg(robot.NAME)} of {arg(gateway.name)} is not seen at the control centre over {arg(link)}")
        data.differences.append(missing if may_pass else msg(f"DDS passes {arg(link)}, which must not carry it"))


def _run_checklist(
    joined: JoinedRehearsal, site: str, fields: dict[str, dict[str, Any]], notify: events.Subscriber
) -> None:
    gateway = joined.inventory.computer_of(site)
    if gateway is None:
        return
    outcome = check_site(joined.inventory, site, joined.rehearsal, notify, has_real_tunnels=True)
    problems = [msg(f"{arg(item.verdict)}: {arg(item.id)}: {arg(item.message)}") for item in outcome.problems]
    fields[gateway.name]["checklist"] = {"words": outcome.words, "differences": problems}
    if any(item.verdict in {Verdict.FAIL, Verdict.ERROR} for item in outcome.problems):
        fields[gateway.name].setdefault("exit", ExitCode.CHECKS_FAILED)
