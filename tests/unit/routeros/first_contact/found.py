"""Devices as first contact finds them, as data."""

from dataclasses import replace
from datetime import UTC, datetime
from typing import Any

from atlantis_netcfg.core.secret import Secret
from atlantis_netcfg.core.versions import Version
from atlantis_netcfg.routeros.first_contact.steps import CLEARED_MENUS, AdoptionTarget, BoxFacts
from atlantis_netcfg.routeros.rsc import parse

NOW = datetime(2026, 6, 1, 12, tzinfo=UTC)
PORTS = tuple(f"ether{number}" for number in range(1, 9))
WISH = AdoptionTarget(
    name="coastal-router",
    user="provision",
    password=Secret('a "b" $c'),
    address="10.64.101.1/24",
    technician="10.64.101.10",
    port="ether8",
    ports=PORTS,
)
DEFAULTS = """\
/interface bridge
add comment=defconf name=bridge
/interface bridge port
add bridge=bridge comment=defconf interface=ether2
add bridge=bridge comment=defconf interface=ether8
/ip pool
add name=default-dhcp ranges=192.168.88.10-192.168.88.254
/ip neighbor discovery-settings
set discover-interface-list=LAN
/ip address
add address=192.168.88.1/24 comment=defconf interface=bridge
/ip dns
set allow-remote-requests=yes
/ip firewall filter
add action=drop chain=input comment="defconf: drop invalid" connection-state=invalid
add action=drop chain=input comment="defconf: drop all not coming from LAN" in-interface-list=!LAN
"""


def rows(export: str, menu: str) -> tuple[dict[str, str], ...]:
    found = [one for one in parse(export).statements if one.menu == menu and one.verb == "add"]
    return tuple(
        {".id": f"*{number:X}", **{name: value or "" for name, value in one.values}}
        for number, one in enumerate(found, start=1)
    )


def facts(export: str = DEFAULTS, **changes: Any) -> BoxFacts:  # noqa: ANN401 - fields of Facts
    """A device whose rows are those of its export."""
    found = BoxFacts(
        version=Version(7, 18, 2),
        board="RB5009UPr+S+",
        architecture="arm64",
        packages=("routeros",),
        device_mode={"mode": "advanced", "flagged": "false", "scheduler": "true"},
        now=NOW,
        users=({".id": "*1", "name": "admin", "group": "full", "disabled": "false"},),
        certificates=(),
        services=({".id": "*7", "name": "api-ssl", "certificate": "none", "port": "8729", "disabled": "false"},),
        ethernets=tuple({".id": f"*{port[-1]}", "name": port, "default-name": port} for port in PORTS),
        rows={menu: rows(export, menu) for menu in CLEARED_MENUS},
        export=parse(export),
        text=export,
    )
    return replace(found, **changes)


def adopted(export: str = "", **changes: Any) -> BoxFacts:  # noqa: ANN401 - fields of Facts
    management = '/ip address\nadd address=10.64.101.1/24 comment="atlantis: management" interface=ether8\n'
    return facts(
        export + management,
        **{
            "users": (
                {".id": "*1", "name": "admin", "group": "full", "disabled": "true"},
                {".id": "*2", "name": "provision", "group": "full", "disabled": "false"},
            ),
            "certificates": ({".id": "*1", "name": "atlantis-api", "fingerprint": "ab" * 32},),
            "services": ({".id": "*7", "name": "api-ssl", "certificate": "atlantis-api", "port": "8729"},),
            **changes,
        },
    )
