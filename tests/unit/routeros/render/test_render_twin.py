"""The router twin takes the whole text, row by row and by /import, and keeps the technician's way in open."""

from collections.abc import Iterator
from ipaddress import IPv4Interface

import pytest
from render_declared import SITES, declaration
from test_render_text import parsed

from atlantis_netcfg.emulator.routeros import Device, ManagementSpec, RouterSpec
from atlantis_netcfg.emulator.routeros.answers import Caller
from atlantis_netcfg.emulator.routeros.spec import Radio
from atlantis_netcfg.inventory.model import Router
from atlantis_netcfg.routeros import rsc
from atlantis_netcfg.routeros.render import prerequisites
from atlantis_netcfg.routeros.rsc import Statement

VERSIONS = ("7.18.2", "7.21.5")
DECLARED = declaration()


def adopted(site: str, version: str) -> tuple[Device, Caller]:
    host, management = DECLARED.router(site), DECLARED.sites[site].management
    assert isinstance(host.device, Router)
    address = IPv4Interface((host.device.access.address, management.network.prefixlen))
    spec = RouterSpec(
        name=host.name,
        version=version,
        packages=("routeros", "wifi-qcom"),
        radios=(Radio(name="wifi1"),),
        ports=tuple(row.name for row in prerequisites(DECLARED, host) if row.menu == "/interface/ethernet"),
        certificates=tuple(row.name for row in prerequisites(DECLARED, host) if row.menu == "/certificate"),
        management=ManagementSpec(address=str(address), port="ether8", technician=str(management.technician)),
    )
    device = Device(spec, lambda: 0.0)
    return device, device.login("provision", "", via="api-ssl", address=str(management.technician))


def rows(site: str) -> Iterator[Statement]:
    """Yield all rows but the address that is there since the adoption."""
    for row in parsed(site).statements:
        if (row.menu, row.get("comment")) != ("/ip/address", "atlantis: management"):
            yield row


def sentence(device: Device, caller: Caller, row: Statement) -> list[str]:
    words = [f"{row.menu}/{row.verb}"]
    if row.find is not None:
        found = device.run(caller, [f"{row.menu}/print", *(f"?{name}={value}" for name, value in row.find)])
        (number,) = [word for answer in found for word in answer.words if word.startswith("=.id=")]
        words.append(number)
    if row.target is not None:
        words.append(f"=.id={row.target}")
    return [*words, *(f"={name}={value or ''}" for name, value in row.values)]


def reaches(device: Device, site: str, sender: str) -> bool:
    router = DECLARED.router(site).device
    assert isinstance(router, Router)
    return device.path_open(sender, str(router.access.address), "api-ssl")


@pytest.mark.parametrize("version", VERSIONS)
@pytest.mark.parametrize("site", SITES)
def test_every_row_is_accepted_and_management_stays_reachable(site: str, version: str) -> None:
    device, caller = adopted(site, version)
    technician = str(DECLARED.sites[site].management.technician)
    for row in rows(site):
        answers = device.run(caller, sentence(device, caller, row))
        assert not [answer for answer in answers if answer.kind == "!trap"], row
        assert reaches(device, site, technician), row
    assert not reaches(device, site, str(DECLARED.sites[site].lan.network[21]))


@pytest.mark.parametrize("site", SITES)
def test_the_text_can_be_imported(site: str) -> None:
    device, caller = adopted(site, "7.21.5")
    export = rsc.Export(statements=tuple(rows(site)))
    contents = rsc.print_export(export)
    assert len(contents) < 60_000
    device.run(caller, ["/file/add", "=name=router.rsc", f"=contents={contents}"])
    answers = device.run(caller, ["/import", "=file-name=router.rsc"])
    assert not [answer for answer in answers if answer.kind == "!trap"]
    imported = rsc.parse(device.export(show_sensitive=True))
    kept = {(row.menu, row.get("comment")) for row in imported.statements if row.verb == "add"}
    assert {(row.menu, row.get("comment")) for row in export.statements if row.verb == "add"} <= kept
