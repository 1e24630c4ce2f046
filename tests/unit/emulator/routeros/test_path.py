"""What shuts the technician out, and what does not."""

import pytest
from row_subtests import for_each_row
from twin_bench import make

ACCEPT = "/ip firewall filter add chain=input connection-state=established,related"
SHUT = {
    "port disabled": "/interface ethernet disable ether8",
    "address disabled": "/ip address disable *1",
    "address removed": "/ip address remove *1",
    "address elsewhere": "/ip address set *1 interface=ether7",
    "port in a bridge": "/interface bridge add name=b\n/interface bridge port add bridge=b interface=ether8",
    "a list in a bridge": (
        "/interface list add name=L\n/interface list member add list=L interface=ether8\n"
        "/interface bridge add name=b\n/interface bridge port add bridge=b interface=L"
    ),
    "no ARP": "/interface ethernet set ether8 arp=disabled",
    "input dropped": "/ip firewall filter add chain=input action=drop",
    "dropped by list": (
        "/interface list add name=LAN\n/ip firewall filter add chain=input action=drop in-interface-list=!LAN"
    ),
    "dropped by address list": (
        "/ip firewall address-list add list=ok address=10.9.0.0/24\n"
        "/ip firewall filter add chain=input action=drop src-address-list=!ok"
    ),
    "dropped in a chain of ours": (
        "/ip firewall filter add chain=input action=jump jump-target=mine\n"
        "/ip firewall filter add chain=mine action=drop protocol=tcp dst-port=8000-9000"
    ),
    "rejected": "/ip firewall filter add chain=input action=reject protocol=tcp dst-port=8729",
    "perhaps dropped": "/ip firewall filter add chain=input action=drop limit=10/1s,5:packet",
    "perhaps accepted": (
        "/ip firewall filter add chain=input action=accept time=8h-18h,mon\n"
        "/ip firewall filter add chain=input action=drop"
    ),
    "answers dropped": "/ip firewall filter add chain=output action=drop out-interface=ether8",
    "raw": "/ip firewall raw add chain=prerouting action=drop src-address=10.64.101.0/24",
    "redirected": "/ip firewall nat add chain=dstnat action=redirect to-ports=22 protocol=tcp dst-port=8729",
    "new ones dropped": f"{ACCEPT}\n/ip firewall filter add chain=input action=drop",
    "service off": "/ip service disable api-ssl",
    "service for others": "/ip service set api-ssl address=10.9.0.0/24",
    "answers led astray": "/ip route add dst-address=10.64.101.10/32 gateway=ether1",
    "answers led astray by a rule": "/routing rule add action=unreachable dst-address=10.64.101.0/24",
    "answers into a table": (
        "/routing table add fib name=t\n"
        "/routing rule add action=lookup-only-in-table table=t src-address=10.64.101.1/32"
    ),
}
OPEN = {
    "nothing": "",
    "somebody else dropped": "/ip firewall filter add chain=input action=drop src-address=10.9.0.0/24",
    "another chain": "/ip firewall filter add chain=forward action=drop",
    "accepted first": (
        "/ip firewall filter add chain=input src-address=10.64.101.0/24 protocol=tcp dst-port=8729\n"
        "/ip firewall filter add chain=input action=drop"
    ),
    "a disabled rule": "/ip firewall filter add chain=input action=drop disabled=yes",
    "returned": (
        "/ip firewall filter add chain=input action=jump jump-target=mine\n"
        "/ip firewall filter add chain=mine action=return dst-port=8729 protocol=tcp\n"
        "/ip firewall filter add chain=mine action=drop"
    ),
    "service for us": "/ip service set api-ssl address=10.9.0.0/24,10.64.101.0/24",
    "renamed port": "/interface ethernet set ether8 name=management",
    "address on the bridge": (
        "/interface bridge add name=b\n/interface bridge port add bridge=b interface=ether8\n"
        "/ip address set *1 interface=b"
    ),
    "a rule for others": "/routing rule add action=unreachable dst-address=10.9.0.0/24",
    "main first": "/routing rule add action=lookup table=main min-prefix=0\n/routing rule add action=unreachable",
    "other bridge": "/interface bridge add name=b\n/interface bridge port add bridge=b interface=ether7",
}


@for_each_row("script", SHUT.values(), ids=SHUT.keys())
def test_access_is_blocked(script: str) -> None:
    router = make()
    assert router.reaches()
    assert router.script(script) == ""
    assert not router.reaches()


@pytest.mark.parametrize("script", OPEN.values(), ids=OPEN.keys())
def test_access_is_allowed(script: str) -> None:
    router = make()
    assert router.script(script) == ""
    assert router.reaches()


@pytest.mark.parametrize("name", ["new ones dropped", "service off", "service for others", "redirected"])
def test_tracked_session_stays_open(name: str) -> None:
    router = make()
    router.script(SHUT[name])
    assert router.reaches(established=True)


@pytest.mark.parametrize("name", ["port disabled", "address removed", "input dropped", "answers dropped"])
def test_tracked_session_is_cut(name: str) -> None:
    router = make()
    router.script(SHUT[name])
    assert not router.reaches(established=True)


def test_services_have_the_configured_port_and_state() -> None:
    router = make()
    router.script("/ip service set api-ssl port=18729 tls-version=only-1.2\n/ip service disable api")
    services = router.device.services()
    assert services["api-ssl"].port == 18729
    assert services["api-ssl"].certificate == "atlantis-api"
    assert services["api-ssl"].tls_version == "only-1.2"
    assert not services["api"].is_enabled
    assert services["api"].certificate is None
    assert router.reaches("api-ssl")
    assert not router.reaches("api")
