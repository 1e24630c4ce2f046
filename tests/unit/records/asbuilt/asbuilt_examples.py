"""Records to try things on; every value is an example."""

from datetime import UTC, datetime, timedelta
from typing import Any

from atlantis_netcfg.inventory.model import NumberMask
from atlantis_netcfg.records.asbuilt.record import (
    AsBuiltRecord,
    CableState,
    DeviceRecord,
    Fact,
    Origin,
    PortNeighbour,
    PortRecord,
    ReadState,
)

AT = datetime(2026, 11, 25, 10, 0, tzinfo=UTC)
LATER = AT + timedelta(days=1)
GATEWAY = PortNeighbour(mac="02:00:5E:00:00:07", by=("bridge", "ARP"), address="10.64.1.7", declared="coastal-gateway")


def read(value: str) -> Fact:
    return Fact(value=value, origin=Origin.READ)


def port(name: str = "ether3", **more: Any) -> PortRecord:  # noqa: ANN401 - fields of PortRecord
    found = {"mac": "02:00:5E:00:01:03", "link": CableState.UP, "speed": "1Gbps", "belongs": "LAN of the site"}
    return PortRecord.model_validate({"name": name, **found, **more})


def router(serial: str = "EXAMPLE1", *ports: PortRecord, **more: Any) -> DeviceRecord:  # noqa: ANN401 - its fields
    facts = {"model": read("EXAMPLE-BOARD"), "serial": read(serial), "version": read("7.18.2 (stable)")}
    given = {"state": ReadState.READ, "read_at": AT, "facts": facts, "ports": ports or (port(),)}
    return DeviceRecord.model_validate({"name": "coastal-router", "kind": "router", **given, **more})


def away(**more: Any) -> DeviceRecord:  # noqa: ANN401 - fields of DeviceRecord
    given = {"state": ReadState.NOT_REACHED, "why": "no response", "hint": "look at its power"}
    return DeviceRecord.model_validate({"name": "coastal-router", "kind": "router", **given, **more})


def terminal() -> DeviceRecord:
    """What only a person can look at."""
    seen = Fact(value="1.2", origin=Origin.DECLARED, note="declared: EXAMPLE-person has seen it on its pages")
    blind = Fact(value=None, origin=Origin.NOT_READ, note="no documented interface for programs")
    return DeviceRecord(
        name="coastal-sat",
        kind="satellite_terminal",
        state=ReadState.BY_HAND,
        why="checked by a person at its pages",
        facts={"serial": blind, "version": seen},
    )


def record(*devices: DeviceRecord, **more: Any) -> AsBuiltRecord:  # noqa: ANN401 - fields of AsBuiltRecord
    given = {
        "id": "20261125T100000Z",
        "site": "coastal",
        "title": "Coastal testbed",
        "at": AT,
        "tool": "0.1.0",
        "inventory": "ab" * 32,
        "rehearsed": False,
        "time_zone": "Europe/Lisbon",
        "mask": NumberMask.LAST4,
        "devices": devices or (router(), terminal()),
    }
    return AsBuiltRecord.model_validate({**given, **more})
