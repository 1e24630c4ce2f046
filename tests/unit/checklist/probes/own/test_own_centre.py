"""Whether data reach the gateways, as the control centre asks them."""

import json
from dataclasses import replace

from own_world import declaration, lines

from atlantis_netcfg.checklist import probes
from atlantis_netcfg.checklist.probes.site_checks import steps
from atlantis_netcfg.checklist.report import ItemKind
from atlantis_netcfg.inventory.model import ServerComputer

GATEWAYS = {"coastal-gateway": "10.80.0.21", "te4sea-gateway": "10.80.0.22"}
OWN = "10.80.0.2"
TOKENS = ("aa", "bb", "cc")
HAS_TUNNEL = json.dumps([{"ifname": "tun0", "addr_info": [{"family": "inet", "local": OWN, "prefixlen": 16}]}])


def answered(name: str, address: str) -> probes.ReflectResult:
    rows = ({"token": token, "host": name, "from": OWN, "to": address, "by": "tun0"} for token in TOKENS)
    came = tuple(probes.ReflectReply(address, "tun0", 0.7, json.dumps(row).encode()) for row in rows)
    return probes.ReflectResult(None, "", TOKENS, came)


def told(**silent: probes.ReflectResult) -> list[str]:
    """What is said when both gateways answer, but for these."""
    (step,) = (one for one in steps(probes.Cell(declaration(), "scc", None, "site")) if one.name == "data-reaches-scc")
    assert step.probe is not None
    assert step.concerns == ("scc-control", *GATEWAYS)
    asked = {one.name: one for one in step.probe.asks() if isinstance(one, probes.ReflectRequest)}
    assert {(one.source, one.address) for one in asked.values()} == {(OWN, address) for address in GATEWAYS.values()}
    answers = {f"data {name}": answered(name, address) for name, address in GATEWAYS.items()}
    ways = {f"way {name}": probes.CommandResult(None, out='[{"dev": "tun0"}]') for name in GATEWAYS}
    links = {"look uplink": probes.LinkStatusResult(None, "", {"state": "up", "active": True})}
    rest = {f"data {name.replace('_', '-')}": one for name, one in silent.items()}
    return lines(
        step.probe.judge({"addresses": probes.CommandResult(None, out=HAS_TUNNEL), **ways, **links, **answers, **rest})
    )


def test_every_gateway_is_asked_and_has_its_finding() -> None:
    assert told() == [
        f"PASS data-reaches: {name} responded to 3 of 3 messages through the VPN over uplink, the slowest in 700 ms"
        for name in GATEWAYS
    ]


def test_silent_gateway_is_inconclusive() -> None:
    assert told(te4sea_gateway=probes.ReflectResult(None, "", TOKENS))[1:] == [
        "INCONCLUSIVE gateway-silent: te4sea-gateway responded to none of 3 messages: it may be off"
    ]


def test_response_of_another_gateway_does_not_count() -> None:
    other = answered("coastal-gateway", "10.80.0.22")
    assert told(te4sea_gateway=other)[1:] == [
        "FAIL other-computer: coastal-gateway responds at 10.80.0.22, the address of te4sea-gateway"
    ]


def test_missing_vpn_members_leave_the_step_to_a_person() -> None:
    shipped = declaration()
    hosts = {
        name: replace(host, device=host.device.model_copy(update={"vpn_address": None}))
        if isinstance(host.device, ServerComputer)
        else host
        for name, host in shipped.hosts.items()
    }
    for site in ("coastal", "scc"):
        made = steps(probes.Cell(replace(shipped, hosts=hosts), site, None, "site"))
        (step,) = (one for one in made if one.name == "data-reaches-scc")
        assert step.kind is ItemKind.PERSON
        assert step.do.startswith("No program can send data through the VPN from")
