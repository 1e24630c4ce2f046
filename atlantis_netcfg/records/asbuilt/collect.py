"""Reading of every device of a site at once, one session per device, combined with saved facts.

Nothing is changed. A device that does not respond is listed, without an error; a device that cannot be queried is
listed with the reason.
"""

from __future__ import annotations

import asyncio
import time
from dataclasses import dataclass, field
from datetime import UTC, datetime
from typing import TYPE_CHECKING

from atlantis_netcfg.checklist.history import VehicleState, books
from atlantis_netcfg.checklist.runner._real import ask_gateway
from atlantis_netcfg.core import events
from atlantis_netcfg.core.errors import NetcfgError, fill_hint
from atlantis_netcfg.core.messages import arg, join, msg
from atlantis_netcfg.inventory.model import (
    Cpe,
    LteDriver,
    LteRouter,
    Port,
    PortUse,
    Router,
    SatelliteTerminal,
    Switch,
    SwitchPortUse,
)
from atlantis_netcfg.operations.common.kinds import get_managed_device, is_supported
from atlantis_netcfg.operations.common.session_link import PATIENCE_S
from atlantis_netcfg.operations.computers._access import is_computer
from atlantis_netcfg.operations.links import collect
from atlantis_netcfg.operations.lte.units import LteUnit
from atlantis_netcfg.records.asbuilt import computer, routeros
from atlantis_netcfg.records.asbuilt.record import (
    DeviceRecord,
    Fact,
    Origin,
    PortRecord,
    ReadState,
    SessionUsage,
    mask_number,
)
from atlantis_netcfg.runs import Purpose, Run, Store

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from atlantis_netcfg.checklist.probes import Answer
    from atlantis_netcfg.inventory import Host, Inventory
    from atlantis_netcfg.operations.common.request import Request
    from atlantis_netcfg.operations.links.session import ReadOnlySession

_COMPLETE_STATUSES = frozenset({"changed", "unchanged"})
"""Run results in which read-back has confirmed that the device matches the inventory."""
_NO_INTERFACE = "no documented interface for programs: check its web pages by hand"


@dataclass(slots=True)
class SiteLook:
    """One reading of a site: the devices to query, and the results."""

    inventory: Inventory
    site: str
    request: Request
    notify: events.Subscriber
    not_emulated: Mapping[str, str] = field(default_factory=dict)
    """Rehearsal: reason why a host is not emulated, by host."""
    patience_s: float = PATIENCE_S
    ssh_config: str | None = None
    """OpenSSH configuration file for the route to a computer, instead of the declared address."""
    sessions: dict[str, ReadOnlySession] = field(default_factory=dict)

    async def devices(self, selected_hosts: Sequence[Host]) -> tuple[DeviceRecord, ...]:
        """Return every host of the site, in the order of the inventory; only `selected_hosts` are queried."""
        names = {host.name for host in selected_hosts}
        hosts = self.inventory.site_hosts(self.site)
        records = await asyncio.gather(*(self._device(host, is_selected=host.name in names) for host in hosts))
        history = JournalFacts(self.inventory, self.site, self._store)
        return tuple(history.extend_record(device) for device in records)

    @property
    def checklist(self) -> Fact:
        """The last signed checklist of the site."""
        signed_books = [
            book for book in books(self._store.root / self.site / "checks") if book.state is VehicleState.SIGNED
        ]
        document = signed_books[-1].document if signed_books else None
        if document is None or document.signed is None:
            return Fact(value=None, origin=Origin.NOT_READ, note="there is no signed checklist on this computer")
        note = msg(f"signed by {arg(document.signed.by)}, digest {arg(document.signed.digest[:16])}")
        return Fact(value=document.run, origin=Origin.STORED, at=document.signed.at, note=note)

    @property
    def _store(self) -> Store:
        return Store(self.request.state, is_rehearsal=self.request.rehearsed)

    @property
    def usage(self) -> dict[str, SessionUsage]:
        """The cost of each session on the wire."""
        return {
            name: SessionUsage(round_trips=item.round_trips, bytes=item.bytes) for name, item in self.sessions.items()
        }

    def costs(self, seconds: float) -> dict[str, str]:
        """Return the bills of sessions with RouterOS devices over metered links."""
        hosts = self.inventory.site_hosts(self.site)
        first = next((host for host in hosts if isinstance(host.device, Router)), hosts[0])
        queries = collect.LinkQueries(self.inventory, first, self.request, self.notify, doors=self.sessions)
        return {name: bill.words for name, bill in collect.bills(queries, None, seconds).items()}

    async def _device(self, host: Host, *, is_selected: bool) -> DeviceRecord:
        device = DeviceRecord(
            name=host.name,
            kind=host.device.kind,
            state=ReadState.LEFT_OUT,
            why="excluded by `device=`",
            facts=_declared_facts(host),
            ports=tuple(PortRecord(name=name, belongs=what) for name, what in places(self.inventory, host).items()),
        )
        if not is_selected:
            return device
        state, why = self._why_not(host)
        if state is not None:
            return device.model_copy(update={"state": state, "why": why})
        self.notify(events.Event(host.name, events.Stage.CONNECTING, "read-only"))
        try:
            result = await self._read(host, device)
        except NetcfgError as error:
            self.notify(events.Event(host.name, events.Stage.FAILED, str(error)))
            hint = error.hint and fill_hint(error.hint, site=host.site, device=host.name)
            return device.model_copy(update={"state": ReadState.NOT_REACHED, "why": str(error), "hint": hint})
        has_answered = result.read_at is not None
        self.notify(
            events.Event(
                host.name,
                events.Stage.DONE if has_answered else events.Stage.FAILED,
                "read" if has_answered else result.why,
            )
        )
        return result

    def _why_not(self, host: Host) -> tuple[ReadState | None, str]:
        """Return why a host cannot be queried; None if it can."""
        device = host.device
        if isinstance(device, SatelliteTerminal):
            return ReadState.BY_HAND, _NO_INTERFACE
        if isinstance(device, LteRouter) and device.driver not in {LteDriver.ROUTEROS, LteDriver.RUTOS}:
            return (
                ReadState.BY_HAND,
                msg(f"its driver `{arg(device.driver)}` reads the link, but nothing that identifies the unit"),
            )
        if not is_supported(host) and not is_computer(host) and not isinstance(device, LteRouter):
            return ReadState.BY_HAND, msg(f"reading a {arg(device.kind.replace('_', ' '))} is not supported yet")
        if self.request.rehearsed and host.name not in self.request.targets:
            return ReadState.NOT_REHEARSED, self.not_emulated.get(host.name, "it is not emulated in this rehearsal")
        return None, ""

    async def _read(self, host: Host, device: DeviceRecord) -> DeviceRecord:
        """Read a host; raise NetcfgError if it does not respond."""
        if is_supported(host):
            return await self._routeros(host, device)
        if is_computer(host):
            return await self._computer(host, device)
        return await self._unit(host, device)

    async def _routeros(self, host: Host, device: DeviceRecord) -> DeviceRecord:
        """Read in one session of two round trips after the handshake: the login, and everything else at once."""
        hardware = get_managed_device(self.inventory, host).hardware
        modem = hardware.modem.name if hardware.modem is not None else None
        door = collect.session_to(self.inventory, self.site, host, self.request, self.patience_s)
        self.sessions[host.name] = door
        async with door.open_session() as session:
            certificate = session.certificate
            replies = await session.flight(routeros.questions(hardware.ports, modem))
        mask = self.inventory.pilot.asbuilt.mask
        reading = routeros.read(replies, hardware.ports, modem, mask, addresses(self.inventory, self.site))
        certificate_facts = {"certificate": Fact(value=certificate, origin=Origin.READ)}
        record = _fill_record(
            device, {**reading.facts, **certificate_facts}, reading.ports, reading.missing, reading.notes
        )
        return record.model_copy(update={"elsewhere": reading.elsewhere})

    async def _unit(self, host: Host, device: DeviceRecord) -> DeviceRecord:
        """Read a RutOS unit: its serial number, and those of modem and SIM; other field names are not known."""
        assert isinstance(host.device, LteRouter)  # noqa: S101 - `_why_not` lets nothing else through
        target = self.request.targets.get(host.name)
        unit = LteUnit(host, host.device, self._store, self.notify, self.request.rehearsed, target)
        status = await asyncio.to_thread(unit.look)
        mask, pin = self.inventory.pilot.asbuilt.mask, unit.endpoint.pin
        numbers = {name: mask_number(number, mask) for name, number in status.identities.items()}
        values = {"serial": status.serial, "imei": numbers.get("imei"), "iccid": numbers.get("iccid")}
        facts = {name: _fact(value, "the unit does not report it to this user") for name, value in values.items()}
        facts["version"] = _fact(None, "no RutOS page is known that shows the firmware")
        facts["certificate"] = _fact(pin, "no pinned certificate")
        return _fill_record(device, facts)

    async def _computer(self, host: Host, device: DeviceRecord) -> DeviceRecord:
        """Read a computer with one SSH command; an ssh error becomes the reason. Raise CostRefusal."""
        packages, notes = computer.declared_packages(self.inventory, host, self.request)
        asked_for = computer.questions(host, packages)
        answers: Mapping[str, Answer] = await ask_gateway(
            self.inventory, host, self.request, asked_for, lambda *_: None, self.ssh_config
        )
        if all(answer.trouble is not None for answer in answers.values()):
            why = next(iter(answers.values())).words
            return device.model_copy(update={"state": ReadState.NOT_REACHED, "why": why})
        reading = computer.read(host, answers, packages, addresses(self.inventory, self.site))
        record = _fill_record(device, reading.facts, reading.ports, reading.missing, notes)
        return record.model_copy(update={"packages": dict(reading.packages)})


def _fill_record(
    device: DeviceRecord,
    facts: Mapping[str, Fact],
    ports: Sequence[PortRecord] = (),
    missing: Sequence[str] = (),
    notes: Sequence[str] = (),
) -> DeviceRecord:
    """Return the record of a device that was read; missing ports of the inventory are kept, with an unknown link."""
    there = {port.name for port in ports}
    places = {port.name: port.belongs for port in device.ports}
    present_ports = [port.model_copy(update={"belongs": port.belongs or places.get(port.name)}) for port in ports]
    absent = [port for port in device.ports if port.name not in there]
    return device.model_copy(
        update={
            "state": ReadState.IN_PART if missing else ReadState.READ,
            "why": join("; ", missing),
            "read_at": datetime.now(UTC),
            "facts": {**device.facts, **facts},
            "ports": (*present_ports, *absent),
            "notes": (*_model_differences(device, facts), *notes),
        }
    )


def _model_differences(device: DeviceRecord, facts: Mapping[str, Fact]) -> Iterator[str]:
    declared_model, read = device.facts.get("model"), facts.get("model")
    if (
        declared_model is None
        or declared_model.value is None
        or read is None
        or read.value in {None, declared_model.value}
    ):
        return
    yield msg(f"the inventory has model {arg(declared_model.value)}, the device reports {arg(read.value)}")


def _fact(value: str | None, why_not: str) -> Fact:
    return Fact(value=value, origin=Origin.READ) if value else Fact(value=None, origin=Origin.NOT_READ, note=why_not)


def _declared_facts(host: Host) -> dict[str, Fact]:
    """Return the inventory's facts about a device; for a terminal also what a person saw on its pages."""
    device = host.device
    model = {} if device.model is None else {"model": Fact(value=device.model, origin=Origin.DECLARED)}
    if not isinstance(device, SatelliteTerminal):
        return model
    evidence = device.evidence
    version = Fact(value=None, origin=Origin.NOT_READ, note="its web pages were not inspected yet")
    if evidence is not None:
        note = msg(f"inventory: {arg(evidence.by)} saw it on its web pages on {arg(evidence.seen_on)}")
        version = Fact(value=evidence.firmware, origin=Origin.DECLARED, note=note)
    return {**model, "serial": Fact(value=None, origin=Origin.NOT_READ, note=_NO_INTERFACE), "version": version}


_USES: Mapping[str, str] = {
    PortUse.LAN: "LAN of the site",
    PortUse.MANAGEMENT: "the technician's laptop",
    PortUse.OFF: "unused: off",
    SwitchPortUse.UPLINK: "the cable to the router",
}
"""Text for the intended use of a port; `lan` and `off` of a switch are the same as those of a router."""


def places(inventory: Inventory, host: Host) -> dict[str, str]:
    """Return what is connected to each port according to the inventory."""
    device = host.device
    if isinstance(device, Cpe):
        return {device.port: "the cable to the router, which also powers it"}
    if not isinstance(device, Router | Switch):
        return {}
    fed = {
        other.device.powered_by.port: other.name
        for other in inventory.site_hosts(host.site)
        if other.device.powered_by is not None and other.device.powered_by.device == host.name
    }
    site = inventory.sites[host.site]
    boxes = {site_link.name: site_link.device for site_link in site.bearers} | {
        link.name: link.device for link in site.served_links
    }
    result = {}
    for port in device.ports:
        link = port.link if isinstance(port, Port) else None
        what = _USES.get(port.use) or msg(f"link {arg(link)}: {arg(boxes.get(link or '') or 'a cable')}")
        power = msg(f", power for {arg(fed[port.name])}" if port.name in fed and fed[port.name] not in what else "")
        result[port.name] = join("", (what, power))
    return result


def addresses(inventory: Inventory, site: str) -> dict[str, str]:
    """Return the host or link of the site for each MAC or IP address of the inventory."""
    result: dict[str, str] = {}
    for link in inventory.sites[site].bearers:
        result[str(link.gateway)] = msg(f"next hop of {arg(link.name)}")
        result |= {str(probe_target): msg(f"probe target of {arg(link.name)}") for probe_target in link.canaries}
    for entry in inventory.sites[site].lan.reservations:
        result |= {entry.mac: entry.name, str(entry.address): entry.name}
    for host in inventory.site_hosts(site):
        address = getattr(host.device, "address", None) or getattr(
            getattr(host.device, "access", None), "address", None
        )
        result |= {str(key): host.name for key in (host.device.mac, address) if key is not None}
    return result


class JournalFacts:
    """Facts that this computer has recorded about a site's devices: adoptions, confirmed runs, pins."""

    def __init__(self, inventory: Inventory, site: str, store: Store) -> None:
        self._declaration, self._store = inventory, store
        names = (*store.archived_runs(site), *(run.id for run in store.runs(site)))
        self._runs = [store.run(site, name) for name in sorted(names, reverse=True)]

    def extend_record(self, device: DeviceRecord) -> DeviceRecord:
        """Return the device with these facts."""
        facts = {
            **device.facts,
            "adopted": self._adoption_fact(device.name),
            "confirmed": self._confirmation_fact(device.name),
            "host_key": self._host_key(device),
        }
        return device.model_copy(update={"facts": {name: fact for name, fact in facts.items() if fact is not None}})

    def _run(self, name: str, purpose: Purpose) -> Run | None:
        """Return the latest run of this purpose that has confirmed the device's state."""
        runs = (run for run in self._runs if run.purpose is purpose)
        return next(
            (run for run in runs if (end := run.outcomes.get(name)) is not None and end.status in _COMPLETE_STATUSES),
            None,
        )

    def _adoption_fact(self, name: str) -> Fact | None:
        host = self._declaration.hosts[name]
        if not is_supported(host):
            return None
        run = self._run(name, Purpose.ADOPT)
        if run is None:
            return Fact(value=None, origin=Origin.NOT_READ, note="the journal on this computer has no adoption of it")
        by = run.start_record.by if run.start_record is not None else ""
        return Fact(
            value=by or "who did it was not recorded", origin=Origin.STORED, at=run.at, note=msg(f"run {arg(run.id)}")
        )

    def _confirmation_fact(self, name: str) -> Fact:
        run = self._run(name, Purpose.CONFIGURE)
        if run is None:
            return Fact(value=None, origin=Origin.NOT_READ, note="the journal on this computer has no such run")
        return Fact(value=run.id, origin=Origin.STORED, at=run.at, note=run.outcomes[name].status)

    def _host_key(self, device: DeviceRecord) -> Fact | None:
        """Return the host key presented by the device, else a saved one; RouterOS presents none over its API."""
        if "host_key" in device.facts or not is_supported(self._declaration.hosts[device.name]):
            return device.facts.get("host_key")
        declared_key = get_managed_device(self._declaration, self._declaration.hosts[device.name]).access.host_key
        if declared_key is not None:
            return Fact(value=declared_key, origin=Origin.DECLARED)
        pinned_key = self._store.pins.host_key(device.name)
        if pinned_key is not None:
            return Fact(value=pinned_key, origin=Origin.STORED, note="the pin on this computer")
        return Fact(value=None, origin=Origin.NOT_READ, note="none was accepted on this computer")


async def look_at(site: SiteLook, selected_hosts: Sequence[Host]) -> tuple[tuple[DeviceRecord, ...], dict[str, str]]:
    """Query the devices; return them with the bills of metered links."""
    began = time.monotonic()
    devices = await site.devices(selected_hosts)
    return devices, site.costs(time.monotonic() - began)
