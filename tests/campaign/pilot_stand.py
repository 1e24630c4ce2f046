"""The joined pilot on which single faults strike: applied once, its routers on their links and all tunnels up.

What a computer sends is a packet; the routers' clocks are moved forward while their probes notice a fault or its end.
"""

from __future__ import annotations

import asyncio
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from typing import TYPE_CHECKING, Final

import pytest

from atlantis_netcfg.checklist import plan, report
from atlantis_netcfg.checklist.runner import examine
from atlantis_netcfg.checklist.runner.simulated import environment
from atlantis_netcfg.cli import checklist
from atlantis_netcfg.cli.base.session import session
from atlantis_netcfg.cli.base.syntax import parse
from atlantis_netcfg.core.events import Verdict
from atlantis_netcfg.emulator import lab
from atlantis_netcfg.emulator.lab import hosts
from atlantis_netcfg.operations import Mode
from atlantis_netcfg.operations.pilot_network import link_cuts
from atlantis_netcfg.operations.pilot_network.rehearsal import PilotRehearsal, join_sites
from atlantis_netcfg.routeros.render import _links

if TYPE_CHECKING:
    import subprocess
    from collections.abc import Iterator, Mapping

    from atlantis_netcfg.inventory import Host
    from campaign.pilot_faults import Fault

SITES: Final = ("scc", "coastal", "te4sea")
MEMBERS: Final = ("coastal", "te4sea")
"""Sites whose router is in the VPN."""
GATEWAYS: Final = ("coastal-gateway", "te4sea-gateway")
CENTRE: Final = "scc-control"
SERVER: Final = "scc-vpn"
PROBE_S: Final = 11.0
"""What docs/links.md adds to the declared times."""
DATA_S: Final = 20.0
"""What the looks take at most once data could flow: pings that were sent too early wait for their timeout."""
_STEP_S: Final = 1.0
"""Emulated seconds between two looks."""
_STRANGER: Final = 250
"""Last byte of the address of a computer that somebody brings into a LAN."""
_GOOD: Final = frozenset({Verdict.PASS, Verdict.SKIP})

Results = dict[str, str]
"""Item to its verdict, and the codes of its findings that do not pass."""


@dataclass
class Trial:
    """What a fault has done."""

    turned: Results = field(default_factory=dict)
    moved_s: float | None = None
    """Seconds until the other link carried the traffic."""
    back_s: float | None = None
    """Seconds from mending until data flowed again over the first link; None: not within the declared time."""
    left: Results = field(default_factory=dict)
    """Items that are not as before at the end."""

    def as_dict(self) -> dict[str, object]:
        return asdict(self)


class PilotStand:
    """The joined pilot; `well` is how its checklists are without a fault."""

    def __init__(self, pilot: PilotRehearsal) -> None:
        self.pilot = pilot
        self.inventory = pilot.inventory
        self.well: Results = {}
        self.processes: dict[str, subprocess.Popen[bytes]] = {}
        """What strangers in a site's LAN run."""
        self._strangers: dict[str, str] = {}

    # --- devices ---------------------------------------------------------------------------------------------------

    def machine(self, name: str) -> lab.Machine:
        return self.pilot.rehearsal.computers.machines[name]

    def router(self, site: str) -> Host:
        return next(host for host in self.pilot.routers if host.site == site)

    def unit(self, site: str, link: str) -> str | None:
        """Return the namespace of the 4G unit or terminal of a link; None: it has none."""
        gateway = next((each.gateway for each in self.inventory.sites[site].bearers if each.name == link), None)
        for line in hosts.program("ip", "netns", "list").splitlines():
            name = line.split()[0]
            if name.startswith(self.pilot.network.namespace("u")):
                addresses = self.pilot.network.run(name, "ip", "-o", "-4", "address", "show", "dev", "near")
                if f" {gateway}/" in addresses:
                    return name
        return None

    def stranger(self, site: str) -> str:
        """Return the namespace of a computer that somebody has plugged into a site's LAN."""
        if site not in self._strangers:
            address = self.inventory.sites[site].lan.network[_STRANGER]
            self._strangers[site] = self.pilot.network.add_host(self.router(site), f"x{site}", address)
        return self._strangers[site]

    def in_router(self, site: str, *words: str, text: str | None = None) -> str:
        """Run a program in the namespace of a site's router."""
        return self.pilot.network.run(self.pilot.network.routers[self.router(site).name], *words, text=text)

    def console(self, site: str, *words: str) -> list[list[str]]:
        """Let somebody change a router; it has to accept that."""
        name = self.router(site).name
        answers: list[list[str]] = self.pilot.rehearsal.emulators.do(name, "console", words=list(words))
        assert all(answer[0] != "!trap" for answer in answers), (words, answers)
        return answers

    def rows(self, site: str, menu: str) -> list[dict[str, str]]:
        """Read the rows of a router's menu, with `.id`."""
        answers = self.console(site, f"{menu}/print")
        return [
            dict(word[1:].split("=", 1) for word in words if word.startswith("="))
            for kind, *words in answers
            if kind == "!re"
        ]

    # --- looks -----------------------------------------------------------------------------------------------------

    def check(self) -> Results:
        """Run the automatic items of all sites that their own computers and routers answer."""
        with ThreadPoolExecutor(len(SITES)) as pool:
            results = pool.map(self._check_site, SITES)
        return {name: words for items in results for name, words in items.items()}

    def _check_site(self, site: str) -> Results:
        entries = [
            entry
            for entry in plan(self.inventory, site).entries
            if entry.item.endpoint == "site" and entry.step.probe is not None and not entry.step.unless
        ]
        with environment.rehearsed_ears(self.inventory, site, self.pilot.rehearsal, has_real_tunnels=True) as ears:
            return {item.id: _words(item) for item in asyncio.run(examine(entries, ears, lambda _: None))}

    def turned(self) -> Results:
        """Return the items that are not as they are without a fault."""
        return {name: words for name, words in self.check().items() if words != self.well[name]}

    def link_in_use(self, site: str) -> str | None:
        return link_cuts.link_in_use(self.pilot, self.router(site))

    def has_data(self, name: str) -> bool:
        """Return whether a gateway's pings pass the VPN to the control centre and back."""
        machine, centre = self.machine(name), self.inventory.hosts[CENTRE].device
        if not machine.runs:
            return False
        command = f"ping -n -q -c 1 -W 4 -I tun0 {getattr(centre, 'vpn_address', None)}"
        return machine.run(command, check=False).returncode == 0

    def has_tunnel(self, site: str) -> bool:
        """Return whether all VPN clients of a site's router are connected."""
        return all(each.address for each in self.pilot.tunnels[self.router(site).name].tunnels.values())

    # --- time ------------------------------------------------------------------------------------------------------

    def declared_s(self, site: str) -> tuple[float, float]:
        """Seconds after which a site has left a dead link, and has come back to its first (docs/links.md)."""
        times, first = self.inventory.sites[site].failover, self.inventory.sites[site].bearers[0]
        leave_s, return_s = (times.metered_probe_s,) * 2 if first.metered else (0, _links.WATCH_S)
        return times.hold_down_s + leave_s + PROBE_S, times.fail_back_s + return_s + PROBE_S

    def _return_s(self) -> float:
        return max(self.declared_s(site)[1] for site in SITES)

    def wait_for(
        self, links: Mapping[str, str], senders: tuple[str, ...], limit_s: float, *, tunnels: tuple[str, ...] = ()
    ) -> float | None:
        """Let time pass until sites use these links and gateways' data arrive; return the seconds, or None.

        `tunnels`: sites whose router has to be in the VPN.

        A router's clock is moved only while its site is not yet on its link; tunnels live in real time.
        """
        skipped_s, begin = 0.0, time.monotonic()
        while skipped_s + time.monotonic() - begin < limit_s:
            late = [site for site, link in links.items() if self.link_in_use(site) != link]
            if not late and all(map(self.has_tunnel, tunnels)) and all(map(self.has_data, senders)):
                return round(skipped_s + time.monotonic() - begin, 1)
            for site in late:
                self.pilot.rehearsal.emulators.do(self.router(site).name, "wait", seconds=_STEP_S)
            skipped_s += _STEP_S if late else 0.0
            time.sleep(0 if late else 1)
        return None

    def try_fault(self, fault: Fault) -> Trial:
        """Let a fault strike, run the checklists, mend it, and wait until all is as before."""
        trial = Trial()
        strike, mend = fault.pair
        try:
            strike(self)
            if fault.over is not None:
                trial.moved_s = self.wait_for(dict([fault.over]), GATEWAYS, self.declared_s(fault.over[0])[0] + DATA_S)
            trial.turned = self.turned()
        finally:
            mend(self)
        limit_s = DATA_S + (self._return_s() if fault.within_s is None else fault.within_s)
        trial.back_s = self.wait_for(self.first_links(), GATEWAYS, limit_s, tunnels=MEMBERS)
        trial.left = self.turned()
        return trial

    def settle(self) -> None:
        """Let every site come to its first link, with data from all gateways; remember what the checklists show."""
        took_s = self.wait_for(self.first_links(), GATEWAYS, 300)
        assert took_s is not None
        self.well = self.check()

    def first_links(self) -> dict[str, str]:
        return {site: self.inventory.sites[site].bearers[0].name for site in SITES}


def _words(item: report.Item) -> str:
    if (
        item.id.endswith("/default-route") and item.verdict is Verdict.PASS
    ):  # it passes over whichever link is the best now, and names it
        return f"{item.verdict} {item.message}"
    codes = sorted({finding.code for finding in item.findings if finding.verdict not in _GOOD})
    return " ".join([str(item.verdict), *codes])


@contextmanager
def pilot_stand() -> Iterator[PilotStand]:
    """Apply the shipped inventory to emulated devices and machines, and join the sites."""
    arguments = parse(checklist.CHECK, ["site=all", "--rehearse", "--json"])
    with session(arguments, rehearse=True) as opened:
        outcome = opened.perform(Mode.APPLY)
        assert outcome.exit == 0, outcome
        assert opened.rehearsal is not None
        request = opened.request(Mode.APPLY)
        with join_sites(opened.inventory, opened.contacted_hosts, opened.rehearsal, request) as pilot:
            assert pilot.silent == {}
            stand = PilotStand(pilot)
            stand.settle()
            yield stand


def module_stand(folders: pytest.TempPathFactory) -> Iterator[PilotStand]:
    """Yield the stand of a test module; skip its tests where no machine can run."""
    with pytest.MonkeyPatch.context() as patch:
        patch.delenv(lab.OFF, raising=False)
        patch.setenv("ATLANTIS_STATE", str(folders.mktemp("pilot")))
        if (reason := lab.why_not()) is not None:
            pytest.skip(reason)
        with pilot_stand() as stand:
            yield stand
