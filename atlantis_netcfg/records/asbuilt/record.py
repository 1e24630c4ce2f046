"""One as-built record: devices with values, ports and packages; differences from the previous record; exit code."""

from __future__ import annotations

from datetime import datetime
from enum import StrEnum
from typing import TYPE_CHECKING, Any

from pydantic import Field

from atlantis_netcfg.core.errors import ExitCode
from atlantis_netcfg.core.message_models import MessageModel
from atlantis_netcfg.core.messages import arg, msg
from atlantis_netcfg.inventory.model import NumberMask

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator


class Origin(StrEnum):
    """The origin of a value."""

    READ = "read"
    """The device reported it in the run of this record."""
    STORED = "stored"
    """It was read or recorded earlier; `at` gives the time."""
    DECLARED = "declared"
    """The value is from the inventory."""
    NOT_READ = "not read"
    """The value is not known; `note` gives the reason."""


class Fact(MessageModel):
    """One value of a device."""

    value: str | None
    origin: Origin
    at: datetime | None = None
    note: str = ""
    """Where the value was found, or why it is not known."""


class PortNeighbour(MessageModel):
    """A neighbour detected on a port; only `declared` comes from the inventory."""

    mac: str
    by: tuple[str, ...]
    """Detection methods: `bridge`, `neighbour discovery`, `ARP`, `DHCP lease`."""
    address: str | None = None
    name: str | None = None
    """The neighbour's own name."""
    declared: str | None = None
    """Host or link in the inventory with this MAC or IP address."""


class CableState(StrEnum):
    """Whether the other end of a port's cable is active."""

    UP = "up"
    DOWN = "down"
    UNKNOWN = "unknown"


class PortRecord(MessageModel):
    """A port, with its detected neighbours."""

    name: str
    mac: str | None = None
    link: CableState = CableState.UNKNOWN
    speed: str | None = None
    """Speed as the device words it: `1Gbps`, `1000 Mbit/s`."""
    belongs: str | None = None
    """What belongs in the port by the inventory; None: not in the inventory."""
    neighbours: tuple[PortNeighbour, ...] = ()


class ReadState(StrEnum):
    """The result of reading a device."""

    READ = "read"
    IN_PART = "read in part"
    """It responded, but refused a query that devices of its kind answer."""
    NOT_REACHED = "not reached"
    BY_HAND = "only a person can check"
    NOT_REHEARSED = "not rehearsed"
    LEFT_OUT = "excluded"


class DeviceRecord(MessageModel):
    """One device."""

    name: str
    kind: str
    state: ReadState
    why: str = ""
    """Why it was not read, or only in part."""
    hint: str | None = None
    read_at: datetime | None = None
    """Time of reading; None: never read on this computer."""
    facts: dict[str, Fact] = Field(default_factory=dict)
    """Facts by the names in `FACTS`."""
    ports: tuple[PortRecord, ...] = ()
    elsewhere: tuple[PortNeighbour, ...] = ()
    """Detected neighbours whose port cannot be determined."""
    packages: dict[str, str] = Field(default_factory=dict)
    """For a computer: version by declared package, as dpkg reports it; `not installed` if missing."""
    notes: tuple[str, ...] = ()


FACTS = (
    "model",
    "serial",
    "version",
    "boot_firmware",
    "modem",
    "modem_firmware",
    "imei",
    "iccid",
    "os",
    "kernel",
    "certificate",
    "host_key",
    "adopted",
    "confirmed",
)
"""Names of facts, in the order in which they are shown."""
_OF_RUNS = frozenset({"adopted", "confirmed"})
"""Facts from this computer's journal; they differ between records, which is no difference of the device."""

_MADE_ANEW = frozenset({"certificate", "host_key"})
"""Rehearsal: keys that an emulated device generates at each start."""


class Change(MessageModel):
    """One difference of a device from the previous record."""

    device: str
    what: str
    before: str | None
    after: str | None
    neighbour: bool = False
    """The change concerns a neighbour on a port, which is not a property of the device."""

    @property
    def words(self) -> str:
        """The difference as text."""
        if self.neighbour:
            if self.after is None:
                return msg(f"{arg(self.device)}: {arg(self.what)} no longer has {arg(self.before)}")
            return msg(f"{arg(self.device)}: {arg(self.what)} now has {arg(self.after)}")
        if self.before is None:
            return msg(f"{arg(self.device)}: {arg(self.what)} is now {arg(self.after)}; it was not known before")
        if self.after is None:
            return msg(f"{arg(self.device)}: {arg(self.what)} is gone; it was {arg(self.before)}")
        return msg(f"{arg(self.device)}: {arg(self.what)} changed from {arg(self.before)} to {arg(self.after)}")


class SessionUsage(MessageModel):
    """The cost of reading a device on the wire, including its login."""

    round_trips: int
    bytes: int


class AsBuiltRecord(MessageModel):
    """The content of `as-built.json`."""

    format: int = 1
    id: str
    """Identifier, sortable by time; also the name of the record's folder."""
    site: str
    title: str
    at: datetime
    tool: str
    inventory: str
    """Revision of the inventory."""
    rehearsed: bool
    time_zone: str = ""
    mask: NumberMask
    checklist: Fact | None = None
    """Last signed checklist of the site."""
    devices: tuple[DeviceRecord, ...]
    since: str | None = None
    """Record with which this one is compared; None: there is none."""
    changes: tuple[Change, ...] = ()
    notes: tuple[str, ...] = ()
    not_rehearsed: tuple[str, ...] = ()
    spent: dict[str, SessionUsage] = Field(default_factory=dict)
    """Usage by RouterOS device; SSH sessions to computers are not included."""
    costs: dict[str, str] = Field(default_factory=dict)
    """Cost as text, by metered link."""

    @property
    def exit(self) -> ExitCode:
        """The exit code: not green if no device was read, or if one did not respond or only in part."""
        states = {device.state for device in self.devices}
        if states & {ReadState.NOT_REACHED, ReadState.IN_PART}:
            return ExitCode.CHECKS_FAILED
        return ExitCode.DONE if ReadState.READ in states else ExitCode.NOTHING

    def device(self, name: str) -> DeviceRecord | None:
        """Return the record of a device; None if it has none."""
        return next((device for device in self.devices if device.name == name), None)

    def as_json(self) -> dict[str, Any]:
        """Return the saved object with derived values."""
        tables = [table.model_dump(mode="json") for table in report_tables(self)]
        return {**self.model_dump(mode="json"), "exit": int(self.exit), "errors": [], "tables": tables}


def mask_number(number: str, mask: NumberMask) -> str:
    """Mask a number that identifies a SIM or modem, as the inventory requires."""
    if mask is NumberMask.NONE:
        return number
    visible_digits = number[-4:] if mask is NumberMask.LAST4 and len(number) > 4 else ""  # noqa: PLR2004 - as its name says
    return "*" * (len(number) - len(visible_digits)) + visible_digits


def compare(record: AsBuiltRecord, before: AsBuiltRecord | None) -> AsBuiltRecord:
    """Return the record with its differences from the previous one, and last known values of unreached devices."""
    if before is None:
        return record
    devices = tuple(_with_last_known(device, before.device(device.name)) for device in record.devices)
    record = record.model_copy(update={"devices": devices, "since": before.id})
    return record.model_copy(update={"changes": tuple(_changes(record, before))})


def _with_last_known(device: DeviceRecord, before: DeviceRecord | None) -> DeviceRecord:
    """Fill in a device that was not read with the last record's values, marked as stored at their reading time."""
    if device.read_at is not None or before is None or before.read_at is None:
        return device
    stored_facts = {name: _mark_stored(fact, before.read_at) for name, fact in before.facts.items()}
    old_values = {"ports": before.ports, "elsewhere": before.elsewhere, "packages": before.packages}
    return device.model_copy(update={"facts": stored_facts | device.facts, "read_at": before.read_at, **old_values})


def _mark_stored(fact: Fact, read_at: datetime) -> Fact:
    if fact.origin is not Origin.READ:
        return fact
    return fact.model_copy(update={"origin": Origin.STORED, "at": fact.at or read_at})


def _changes(record: AsBuiltRecord, before: AsBuiltRecord) -> Iterator[Change]:
    """Yield differences only of values read in this run: unreached devices may be unchanged."""
    for device in record.devices:
        earlier = before.device(device.name)
        if device.state not in {ReadState.READ, ReadState.IN_PART} or earlier is None or earlier.read_at is None:
            continue
        excluded_names = _OF_RUNS | (_MADE_ANEW if record.rehearsed else frozenset())
        differences = [*_fact_differences(device, earlier, excluded_names), *_package_differences(device, earlier)]
        # The cards of an emulated computer are made when it starts, as its keys are.
        lasting = not record.rehearsed or device.kind not in _COMPUTERS
        differences += _port_differences(device, earlier) if lasting else ()
        yield from (Change(device=device.name, what=what, before=old, after=new) for what, old, new in differences)
        yield from _of_neighbours(device, earlier) if lasting else ()


_Difference = tuple[str, str | None, str | None]


def _fact_differences(now: DeviceRecord, before: DeviceRecord, excluded_names: frozenset[str]) -> Iterator[_Difference]:
    for name in FACTS:
        fact, old = now.facts.get(name), before.facts.get(name)
        if name in excluded_names or fact is None or fact.value is None:
            continue
        old_value = old.value if old is not None else None
        if fact.value != old_value:
            yield title_of(name), old_value, fact.value


def _port_differences(now: DeviceRecord, before: DeviceRecord) -> Iterator[_Difference]:
    old_ports = {port.name: port for port in before.ports}
    for port in now.ports:
        old = old_ports.pop(port.name, None)
        if old is None:
            yield msg(f"port {arg(port.name)}"), None, port.mac or port.link.value
            continue
        pairs = (("MAC", old.mac, port.mac), ("link", old.link.value, port.link.value))
        yield from (
            (msg(f"{arg(what)} of port {arg(port.name)}"), a, b) for what, a, b in pairs if a != b and b is not None
        )
        if port.speed is not None and old.speed not in {None, port.speed}:
            yield msg(f"speed of port {arg(port.name)}"), old.speed, port.speed
    yield from ((msg(f"port {arg(name)}"), old.mac or old.link.value, None) for name, old in old_ports.items())


def _of_neighbours(now: DeviceRecord, before: DeviceRecord) -> Iterator[Change]:
    """Yield new and missing neighbours of each port by MAC; an expired entry looks like a missing device."""
    ports = {port.name: port.neighbours for port in before.ports}
    for port in now.ports:
        here = {item.mac: neighbour_text(item) for item in port.neighbours}
        before_by_mac = {item.mac: neighbour_text(item) for item in ports.get(port.name, ())}
        pairs: list[tuple[str | None, str | None]] = [(None, here[mac]) for mac in here if mac not in before_by_mac]
        pairs += [(before_by_mac[mac], None) for mac in before_by_mac if mac not in here]
        for old, new in pairs:
            yield Change(device=now.name, what=msg(f"port {arg(port.name)}"), before=old, after=new, neighbour=True)


def _package_differences(now: DeviceRecord, before: DeviceRecord) -> Iterator[_Difference]:
    for name, version in now.packages.items():
        if before.packages and before.packages.get(name) != version:
            yield msg(f"package {arg(name)}"), before.packages.get(name), version


def neighbour_text(neighbour: PortNeighbour) -> str:
    """Return a neighbour as text, as far as it is known."""
    words = [neighbour.mac, *(item for item in (neighbour.address, neighbour.name) if item)]
    return " ".join(words) + msg(f" ({arg(neighbour.declared)})" if neighbour.declared else "")


_TITLES = {
    "model": "model",
    "serial": "serial number",
    "version": "software version",
    "boot_firmware": "boot loader firmware",
    "modem": "modem",
    "modem_firmware": "modem firmware",
    "imei": "IMEI",
    "iccid": "ICCID of the SIM",
    "os": "operating system",
    "kernel": "kernel",
    "certificate": "TLS certificate",
    "host_key": "SSH host key",
    "adopted": "adopted",
    "confirmed": "last confirmed run",
}


def title_of(name: str) -> str:
    """Return the title of a value for people."""
    return _TITLES[name]


class ReportTable(MessageModel):
    """A table of the communications report whose cells are unknown: typed, and filled only with read values."""

    number: int
    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str | None, ...], ...]


_HARDWARE = ("device", "kind", "model", "serial number", "software version")
_COMPUTERS = frozenset({"gateway", "vpn_server", "control_centre"})


def report_tables(record: AsBuiltRecord) -> tuple[ReportTable, ...]:
    """Return Tables 8, 9, 31 and 32 with this project's columns: the report's are lost (pilot.md, section 5)."""
    devices = [item for item in record.devices if item.state in {ReadState.READ, ReadState.IN_PART}]
    centre = any(device.kind in {"vpn_server", "control_centre"} for device in record.devices)
    checklist = record.checklist.value if record.checklist is not None else None
    tested_devices = devices if checklist is not None else []
    packages = [(device.name, name, version) for device in devices for name, version in device.packages.items()]
    return (
        _table(8, "hardware for testbed and support vessel", () if centre else map(_hardware, devices)),
        _table(9, "endpoints of the control centre", map(_hardware, devices) if centre else ()),
        _table(31, "tested devices", ((*_hardware(item), checklist) for item in tested_devices)),
        _table(32, "package inventory of the gateway computer", packages),
    )


def _table(number: int, title: str, rows: Iterable[tuple[str | None, ...]]) -> ReportTable:
    columns = {31: (*_HARDWARE, "signed checklist of the site"), 32: ("device", "package", "version")}.get(
        number, _HARDWARE
    )
    return ReportTable(number=number, title=title, columns=columns, rows=tuple(rows))


def _hardware(device: DeviceRecord) -> tuple[str | None, ...]:
    """Return the hardware row of a device, with values read in this run only."""
    names = ("model", "serial", "os" if device.kind in _COMPUTERS else "version")
    facts = [device.facts.get(name) for name in names]
    values = [fact.value if fact is not None and fact.origin is Origin.READ else None for fact in facts]
    return device.name, device.kind, *values
