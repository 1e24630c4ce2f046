"""Sites that are declared otherwise than the shipped example."""

from dataclasses import replace
from typing import Any

from own_broken import LEAVE, lines_of, with_address
from own_world import NETPLAN, SITE, World, computer, declaration, judged_here

from atlantis_netcfg.checklist.probes import Cell, DhcpDiscoverRequest, Step
from atlantis_netcfg.checklist.probes.site_checks import steps
from atlantis_netcfg.computers.parts import computer_network
from atlantis_netcfg.inventory import Inventory
from atlantis_netcfg.inventory.model import AddressBy, ComputerNetwork, Gateway, NetworkTool, Poe, PoeMode, Router

NETWORK = ComputerNetwork(by=NetworkTool.NETPLAN, interface="eth7")


def with_gateway(**changes: Any) -> Inventory:  # noqa: ANN401 - fields of Gateway
    whole = declaration()
    host = whole.hosts[f"{SITE}-gateway"]
    device = host.device.model_copy(update=changes)
    return replace(whole, hosts={**whole.hosts, host.name: replace(host, device=device)})


def own(whole: Inventory) -> tuple[Step, ...]:
    return judged_here(steps(Cell(whole, SITE, None, "site")))


def of(world: World, name: str) -> list[str]:
    return list(world.findings()[name])


def with_file(text: str | None) -> World:
    files = {} if text is None else {NETPLAN: text}
    spec = computer().model_copy(update={"files": files})
    return World(pc=spec, steps=own(with_gateway(network=NETWORK)))


def test_declared_network_file_is_compared_exactly() -> None:
    whole = with_gateway(network=NETWORK)
    promised = computer_network(whole, whole.hosts[f"{SITE}-gateway"])
    assert promised is not None
    assert promised.path == NETPLAN
    router = "PASS router-as-declared: coastal-router has its 5 addresses of the inventory, none of them leased"
    fine = "PASS gateway-as-declared: coastal-gateway has 10.64.1.10/24, also after a restart"
    assert of(with_file(promised.content), "static-addresses") == [router, fine]
    differs = (
        f"FAIL file-differs: {NETPLAN} of coastal-gateway differs from the inventory: a restart changes its address"
    )
    assert of(with_file(promised.content.replace("10.64.1.10", "10.64.1.11")), "static-addresses") == [router, differs]
    gone = (
        f"FAIL no-file: coastal-gateway has 10.64.1.10/24, but {NETPLAN} is missing: the address is lost after a "
        "restart"
    )
    assert of(with_file(None), "static-addresses") == [router, gone]


def test_dhcp_offers_are_requested_on_the_declared_interface() -> None:
    step = next(one for one in own(with_gateway(network=NETWORK)) if one.name == "rogue-dhcp")
    assert step.probe is not None
    assert [one.interface for one in step.probe.asks() if isinstance(one, DhcpDiscoverRequest)] == ["eth7"]


def leased() -> tuple[Step, ...]:
    device = declaration().hosts[f"{SITE}-gateway"].device
    assert isinstance(device, Gateway)
    assert device.image is not None
    return own(with_gateway(image=device.image.model_copy(update={"address_by": AddressBy.DHCP})))


def test_gateway_address_by_reservation_is_judged() -> None:
    router = "PASS router-as-declared: coastal-router has its 5 addresses of the inventory, none of them leased"
    fine = "PASS gateway-as-declared: coastal-gateway has 10.64.1.10/24, also after a restart"
    world = World(pc=with_address("10.64.1.10/24", 3000, instead=True), steps=leased())
    assert of(world, "static-addresses") == [router, fine]
    by_hand = "WARN address-by-hand: coastal-gateway has 10.64.1.10/24 set manually, but the inventory says DHCP"
    assert of(World(steps=leased()), "static-addresses") == [router, by_hand]


def test_worse_link_that_is_not_metered_only_warns() -> None:
    whole = declaration()
    site = whole.sites[SITE]
    free = tuple(one.model_copy(update={"metered": False, "billing": None}) for one in site.bearers)
    changed = replace(whole, sites={**whole.sites, SITE: site.model_copy(update={"bearers": free})})
    assert of(World(script=LEAVE, steps=own(changed)), "default-route") == [
        "WARN not-the-best: traffic leaves by 4g, although wifi-ptp is up and better",
        "PASS gateway-by-the-router: the default route of coastal-gateway leads to the router 10.64.1.1",
    ]


def test_ports_that_feed_no_declared_device_pass() -> None:
    whole = declaration()
    hosts = {
        name: replace(host, device=host.device.model_copy(update={"powered_by": None}))
        for name, host in whole.hosts.items()
    }
    world = lines_of(
        "/interface/ethernet/poe", *({"name": f"ether{n}", "poe-out-status": "waiting-for-load"} for n in (1, 2, 3))
    )
    world.steps = own(replace(whole, hosts=hosts))
    assert of(world, "poe") == [
        "PASS no-fault: no port that supplies power has a fault; the inventory has no device powered by one"
    ]


def certificates_of_scc(whole: Inventory) -> list[str]:
    world = lines_of("/certificate", {"name": "atlantis-api", "invalid-after": "2036-11-18 10:00:00"})
    world.steps = tuple(one for one in steps(Cell(whole, "scc", None, "site")) if one.name == "certificates")
    return of(world, "certificates")


def test_site_with_one_certificate_passes() -> None:
    whole = declaration()
    control = whole.hosts["scc-control"]
    outside = replace(control, device=control.device.model_copy(update={"vpn_address": None}))
    found = certificates_of_scc(replace(whole, hosts={**whole.hosts, control.name: outside}))
    assert found == ["PASS valid: the only certificate is valid until 2036-11-18"]


def test_control_centre_in_the_vpn_needs_its_own_identity() -> None:
    (line,) = certificates_of_scc(declaration())
    assert line.startswith("FAIL other-identity: the VPN identity of scc-control contains EXAMPLE VPN authority and")
    assert line.endswith("coastal-gateway, but no certificate of scc-control")


def test_port_forced_on_does_not_prove_that_it_feeds() -> None:
    whole = declaration()
    router = whole.hosts[f"{SITE}-router"]
    assert isinstance(router.device, Router)
    forced = Poe(out=PoeMode.FORCED_ON)
    ports = tuple(
        one.model_copy(update={"poe": forced}) if one.name == "ether2" else one for one in router.device.ports
    )
    changed = replace(router, device=router.device.model_copy(update={"ports": ports}))
    rows = [{"name": f"ether{n}", "poe-out-status": "powered-on"} for n in (1, 2, 3)]
    told = {"poe-out-current": "120mA"}
    fed = own(replace(whole, hosts={**whole.hosts, router.name: changed}))
    for measured, expected in (
        (
            {},
            (
                "INCONCLUSIVE draw-untold: ether2 of coastal-router, which powers coastal-4g, is always powered, "
                "and the router does not report the power drawn"
            ),
        ),
        (
            told,
            (
                "PASS powered: coastal-cpe (value not reported), coastal-4g (120mA) and "
                "coastal-sat (value not reported) draw"
            ),
        ),
    ):
        world = lines_of("/interface/ethernet/poe", rows[0], {**rows[1], **measured}, rows[2])
        world.steps = fed
        (line,) = of(world, "poe")
        assert line.startswith(expected)


def test_vpn_server_without_an_address_is_not_asked() -> None:
    whole = declaration()
    server = whole.hosts[whole.pilot.vpn.server]
    unknown = replace(server, device=server.device.model_copy(update={"vpn_address": None}))
    steps = own(replace(whole, hosts={**whole.hosts, server.name: unknown}))
    *_, line = of(World(steps=steps), "vpn")
    assert line == (
        "INCONCLUSIVE server-not-asked: the address at which coastal-gateway would ping the server is unknown"
    )
