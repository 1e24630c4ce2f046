"""Ways in which a site is broken, one at a time; what is to be said of each stands in `own_cases.yml`."""

from __future__ import annotations

from dataclasses import replace
from datetime import timedelta
from typing import TYPE_CHECKING, Any

from own_world import AROUND, CARDS, IDENTITY, LOOKS, NETPLAN, NOW, World, computer, timed

from atlantis_netcfg.probes import Ask, Looked, Offered, Place, Probing, Ran, Rows, Run, Trouble
from atlantis_netcfg.twin.around import Called, Load, Validity
from atlantis_netcfg.twin.computer import (
    AddressSpec,
    CertificateSpec,
    EchoSpec,
    NeighbourSpec,
    OfferSpec,
    RouteSpec,
    UdpSpec,
)

if TYPE_CHECKING:
    from collections.abc import Callable

    from atlantis_netcfg.probes import Answer, Question
    from atlantis_netcfg.twin.computer import ComputerSpec

ROGUE = OfferSpec(server="192.168.8.1", mac="02:00:5E:00:01:24", address="192.168.8.100", router="192.168.8.1")
OWN = computer().dhcp["eth0"][0]


def pc(**changes: Any) -> World:  # noqa: ANN401 - fields of ComputerSpec
    return World(pc=computer().model_copy(update=changes))


def udp(*ports: int) -> tuple[UdpSpec, ...]:
    return tuple(UdpSpec(port=port) for port in ports)


def around(**changes: Any) -> World:  # noqa: ANN401 - fields of Around
    return World(around={**AROUND, **changes})


def typed(script: str) -> World:
    return World(script=script)


def looks(**changes: dict[str, Any]) -> World:
    return World(looks={name: {**look, **changes.get(name.replace("-", "_"), {})} for name, look in LOOKS.items()})


def with_address(address: str, lease_s: int | None = None, *, instead: bool = False) -> ComputerSpec:
    spec = computer()
    lan, *others = spec.interfaces
    kept = () if instead else lan.addresses
    changed = lan.model_copy(update={"addresses": (*kept, AddressSpec(address=address, lease_s=lease_s))})
    return spec.model_copy(update={"interfaces": (changed, *others)})


def without_tunnel() -> ComputerSpec:
    spec = computer()
    return spec.model_copy(update={"interfaces": spec.interfaces[:1], "echoes": {}})


def with_tunnel(address: str) -> ComputerSpec:
    spec = computer()
    lan, tunnel = spec.interfaces
    changed = tunnel.model_copy(update={"addresses": (AddressSpec(address=address),)})
    return spec.model_copy(update={"interfaces": (lan, changed)})


def seen(address: str, mac: str) -> tuple[NeighbourSpec, ...]:
    return (*computer().neighbours, NeighbourSpec(address=address, dev="eth0", mac=mac))


def stale(address: str, mac: str) -> tuple[NeighbourSpec, ...]:
    return (NeighbourSpec(address=address, dev="eth0", mac=mac, state="STALE"),)


def valid(name: str, since: int, until: int) -> World:
    """Of a certificate of the router; days from now."""
    dates = Validity(since=NOW + timedelta(days=since), until=NOW + timedelta(days=until))
    return around(validity={**AROUND["validity"], name: dates})


def identity(since: int, until: int) -> World:
    told = CertificateSpec(
        subject="coastal-gateway", not_before=NOW + timedelta(days=since), not_after=NOW + timedelta(days=until)
    )
    return pc(certificates={IDENTITY: (computer().certificates[IDENTITY][0], told)})


def load(**changes: Any) -> World:  # noqa: ANN401 - fields of Load
    return around(loads={**AROUND["loads"], "ether2": Load(**changes)})


def answers(change: Callable[[Question, Answer], Answer]) -> World:
    return World(answers=change)


def at(place: Place, trouble: Trouble, words: str = "") -> Callable[[Question, Answer], Answer]:
    """Nobody at a place gives a whole answer."""

    def change(question: Question, answer: Answer) -> Answer:
        if question.place is not place:
            return answer
        return type(answer)(trouble, words)

    return change


def garbage(question: Question, _answer: Answer) -> Answer:
    if isinstance(question, Ask):
        return Rows(None, rows=({"x": "\x00?"},))
    if isinstance(question, Run):
        return Ran(None, out="\x1b[31m{ not json\n", began=0.0)
    return Offered(None) if isinstance(question, Probing) else Looked(None, bearer={"state": "sideways"})


def wrong_shape(_question: Question, answer: Answer) -> Answer:
    return Looked(None, bearer=None) if not isinstance(answer, Looked) else Rows(None, rows=())


def refused(question: Question, answer: Answer) -> Answer:
    return Rows(None, "no such command prefix", None) if isinstance(question, Ask) else answer


def failing(question: Question, answer: Answer) -> Answer:
    return Ran(None, rc=1, err="sh: something\nit broke\n") if isinstance(question, Run) else answer


def lines_of(menu: str, *rows: dict[str, str]) -> World:
    def change(question: Question, answer: Answer) -> Answer:
        asked = isinstance(question, Ask) and question.query.menu == menu
        return replace(answer, rows=rows) if asked and isinstance(answer, Rows) else answer

    return answers(change)


def ran(name: str, **changes: Any) -> World:  # noqa: ANN401 - fields of Ran
    def change(question: Question, answer: Answer) -> Answer:
        return replace(answer, **changes) if question.name == name and isinstance(answer, Ran) else answer

    return answers(change)


def late(_question: Question, answer: Answer) -> Answer:
    """Over a satellite answers take a while, and prove less of a clock."""
    if isinstance(answer, Rows | Ran):
        return replace(answer, asked=NOW.timestamp() - 30, heard=NOW.timestamp() + 45)
    return answer


def unstamped(_question: Question, answer: Answer) -> Answer:
    return replace(answer, asked=0.0, heard=0.0) if isinstance(answer, Rows | Ran) else answer


LEAVE = "; ".join(
    f"/ip route disable [find gateway={gateway}]"
    for gateway in ("198.51.100.11", "198.51.100.12", "10.10.0.1 distance=11")
)
"""Take the router's default routes over the Wi-Fi bridge away."""
BROKEN: dict[str, Callable[[], World]] = {
    "healthy": World,
    # DHCP
    "another DHCP server": lambda: pc(dhcp={"eth0": (OWN, ROGUE)}),
    "another DHCP server, and the router is silent": lambda: pc(dhcp={"eth0": (ROGUE,)}),
    "nobody offers an address": lambda: pc(dhcp={}),
    "two cards offer as the router": lambda: pc(
        dhcp={"eth0": (OWN, OWN.model_copy(update={"mac": "02:00:5E:AA:00:01"}))}
    ),
    "the router has seen another DHCP server": lambda: World(
        around={**AROUND, "dhcp_servers": {"bridge-lan": ("02:00:5E:00:01:24",)}},
        script="/ip dhcp-server alert add interface=bridge-lan disabled=no",
    ),
    # addresses
    "an address with two cards": lambda: pc(
        neighbours=(
            NeighbourSpec(address="10.64.1.150", dev="eth0", mac="02:00:5E:AA:00:01"),
            NeighbourSpec(address="10.64.1.150", dev="eth0", mac="02:00:5E:AA:00:02"),
        )
    ),
    "an address that another card had before": lambda: pc(neighbours=stale("10.64.1.24", "02:00:5E:AA:00:01")),
    "an address that nobody has asked for lately": lambda: pc(neighbours=stale("10.64.1.151", "02:00:5E:AA:00:01")),
    "a card at a reserved address, some time ago": lambda: pc(neighbours=stale("10.64.1.26", "02:00:5E:AA:00:01")),
    "another card at a reserved address": lambda: around(cards={**CARDS, "10.64.1.24": "02:00:5E:AA:00:09"}),
    "a robot took the address of another": lambda: around(cards={**CARDS, "10.64.1.24": "02:00:5E:00:01:23"}),
    "a robot has an address that is not its own": lambda: pc(neighbours=seen("10.64.1.150", "02:00:5E:00:01:26")),
    "a lease that somebody else holds": lambda: around(leases={"10.64.1.23": "busy", "10.64.1.24": "bound"}),
    "nobody was seen in the LAN": lambda: World(
        pc=computer().model_copy(update={"neighbours": ()}), around={**AROUND, "cards": {}}
    ),
    "a leased address beside the static one": lambda: World(pc=with_address("10.64.1.137/24", 3000)),
    "two addresses of one subnet on the router": lambda: typed(
        "/ip address add address=10.64.1.2/24 interface=bridge-lan"
    ),
    "a disabled second address": lambda: typed(
        "/ip address add address=10.64.1.2/24 interface=bridge-lan disabled=yes"
    ),
    "the gateway has a leased address": lambda: World(pc=with_address("10.64.1.10/24", 3000, instead=True)),
    "the gateway has another mask": lambda: World(pc=with_address("10.64.1.10/16", instead=True)),
    "the gateway has another address": lambda: World(pc=with_address("10.64.1.99/24", instead=True)),
    "no file says the gateway's address": lambda: pc(files={"/etc/network/interfaces": "# 10.64.1.10/24\nauto lo\n"}),
    "files of the gateway may not be read": lambda: answers(
        lambda question, answer: Ran(Trouble.DENIED) if question.name == NETPLAN else answer
    ),
    "an address of the router is switched off": lambda: typed('/ip address disable [find address="10.10.1.2/29"]'),
    "the router has another mask": lambda: typed('/ip address set [find address="10.64.1.1/24"] address=10.64.1.1/16'),
    "the router lacks an address": lambda: typed('/ip address remove [find address="10.10.2.2/29"]'),
    # factory settings
    "a device on a factory address answers ARP": lambda: World(neighbours=(*World().neighbours, "192.168.2.2")),
    "a device on a factory address is a neighbour": lambda: pc(neighbours=seen("192.168.88.1", "02:00:5E:AA:00:03")),
    "a device with a factory name": lambda: World(
        around={
            **AROUND,
            "called": (
                Called(identity="MikroTik", interface="bridge-lan", mac="02:00:5E:AA:00:04", address="10.64.1.77"),
            ),
        },
        script="/ip neighbor discovery-settings set discover-interface-list=all",
    ),
    # routes
    "a better link is up and not used": lambda: World(script=LEAVE),
    "the better link is down": lambda: World(
        looks={**LOOKS, "wifi-ptp": {"state": "down", "active": False}},
        script=LEAVE,
    ),
    "whether the better link works is not known": lambda: World(
        looks={**LOOKS, "wifi-ptp": {"state": "unknown", "active": False}},
        script=LEAVE,
    ),
    "no default route": lambda: typed('/ip route disable [find dst-address="0.0.0.0/0"]'),
    "a default route to a stranger": lambda: typed("/ip route add dst-address=0.0.0.0/0 gateway=10.64.1.77 distance=1"),
    "traffic split over two links": lambda: typed("/ip route add dst-address=0.0.0.0/0 gateway=10.10.1.1 distance=10"),
    "the gateway's default route leads elsewhere": lambda: pc(routes=(RouteSpec(via="10.64.1.77", dev="eth0"),)),
    "the gateway has no default route": lambda: pc(routes=()),
    "the gateway has two equal default routes": lambda: pc(
        routes=(RouteSpec(via="10.64.1.1", dev="eth0"), RouteSpec(via="192.168.4.1", dev="wlan0"))
    ),
    "the gateway has a spare default route": lambda: pc(
        routes=(
            RouteSpec(via="10.64.1.1", dev="eth0"),
            RouteSpec(via="192.168.4.1", dev="wlan0", protocol="dhcp", metric=600),
        )
    ),
    # clocks
    "the gateway's clock is an hour behind": lambda: World(pc=timed(computer(), offset_s=-3600)),
    "the router's clock is wrong": lambda: World(clock=NOW + timedelta(days=3)),
    "this computer's clock is wrong": lambda: World(
        clock=NOW + timedelta(hours=1), pc=timed(computer(), offset_s=3600.4)
    ),
    "timedatectl says something else": lambda: ran("timedatectl", out="Failed to query server\n"),
    "the gateway's clock is behind, and timedatectl fails": lambda: ran(
        "timedatectl", rc=1, out="", err="Failed to connect to bus: Host is down\n", began=NOW.timestamp() - 60
    ),
    "time zones are others": lambda: World(
        pc=timed(computer(), zone="Etc/UTC"), script="/system clock set time-zone-name=Europe/Brussels"
    ),
    "no time server answers": lambda: World(
        around={**AROUND, "time_server": None}, pc=timed(computer(), synchronised=False)
    ),
    "the router asks no time server": lambda: typed("/system ntp client set enabled=no"),
    "a clock of before 7.10": lambda: lines_of(
        "/system/clock", {"date": "nov/22/2026", "time": "10:00:00", "gmt-offset": "+00:00"}
    ),
    "a router that woke up in 1970": lambda: lines_of(
        "/system/clock", {"date": "jan/02/1970", "time": "00:00:09", "gmt-offset": "+00:00"}
    ),
    "an impossible date": lambda: lines_of("/system/clock", {"date": "foo/40/2026", "time": "10:00:00"}),
    # VPN
    "the router's tunnel is down": lambda: around(tunnels={}),
    "the router's tunnel is switched off": lambda: typed("/interface ovpn-client disable ovpn-scc"),
    "the router has no tunnel": lambda: lines_of("/interface/ovpn-client"),
    "the router has another tunnel address": lambda: around(tunnels={"ovpn-scc": "10.80.0.99/16"}),
    "the gateway has no tunnel": lambda: World(pc=without_tunnel()),
    "the gateway has another tunnel address": lambda: World(pc=with_tunnel("10.80.0.99/16")),
    "the VPN server is silent": lambda: pc(echoes={}),
    "the VPN server is silent over a satellite": lambda: World(
        pc=computer().model_copy(update={"echoes": {}}),
        looks={**LOOKS, "satellite": {**LOOKS["satellite"], "active": True}},
    ),
    "the VPN server loses pings": lambda: pc(echoes={"10.80.0.1": EchoSpec(loss_percent=40, rtt_ms=650)}),
    # DDS
    "nobody speaks DDS": lambda: pc(udp=(UdpSpec(port=5353),)),
    "DDS in another domain": lambda: pc(udp=(UdpSpec(port=7650), UdpSpec(port=7660), UdpSpec(port=7661))),
    "DDS in another domain without its profile": lambda: pc(udp=udp(7650, 7651, 59363)),
    "DDS without its profile, Fast DDS": lambda: pc(udp=udp(7400, 7410, 7411, 45896)),
    "DDS without its profile, Cyclone DDS": lambda: pc(udp=udp(7400, 7401, 59318)),
    "DDS with and without its profile, Fast DDS": lambda: pc(udp=udp(7400, 7410, 7411, 7412, 7413)),
    "DDS with and without its profile, Cyclone DDS": lambda: pc(udp=udp(7400, 7400, 7401, 7401, 7410, 7411)),
    "others at ports of DDS": lambda: pc(udp=udp(7400, 7660, 14550, 32784)),
    "more participants than declared": lambda: pc(udp=tuple(UdpSpec(port=7410 + 2 * number) for number in range(12))),
    "announcements were dropped": lambda: ran(
        "sockets",
        out="  sl  local_address rem_address\n"
        " 1000: 00000000:1CF2 00000000:0000 07 00000000:00000000 00:00000000 00000000  1000        0 20000 2 0000 17\n",
    ),
    # certificates
    "a certificate has expired": lambda: valid("atlantis-vpn", -400, -1),
    "a certificate expires soon": lambda: valid("atlantis-api", -300, 12),
    "a certificate is not valid yet": lambda: valid("atlantis-vpn", 2, 900),
    "a certificate is missing": lambda: lines_of(
        "/certificate", {"name": "atlantis-api", "invalid-after": "2029-05-10 10:00:00"}
    ),
    "an old certificate lies about": lambda: lines_of(
        "/certificate",
        {"name": "atlantis-api", "invalid-after": "2029-05-10 10:00:00"},
        {"name": "atlantis-vpn", "invalid-after": "2029-05-10 10:00:00"},
        {"name": "old", "invalid-after": "jan/01/2020 10:00:00", "expired": "true"},
    ),
    "a router that takes a certificate for expired": lambda: lines_of(
        "/certificate",
        {"name": "atlantis-api", "invalid-after": "2029-05-10 10:00:00", "expired": "true"},
        {"name": "atlantis-vpn", "invalid-after": "some day"},
    ),
    "the gateway's identity has expired": lambda: identity(-100, -3),
    "the gateway's identity is not valid yet": lambda: identity(1, 300),
    "the gateway has no identity": lambda: pc(certificates={}),
    "the gateway has no openssl": lambda: pc(lacks=("openssl",)),
    # PoE
    "nobody draws power": lambda: around(loads={"ether1": Load(), "ether3": Load()}),
    "a short circuit": lambda: load(status="short-circuit"),
    "an overload": lambda: load(status="overload"),
    "a word for power that nobody knows": lambda: load(status="meditating"),
    "a box draws nothing": lambda: load(milliamps=0),
    "power is switched off": lambda: typed("/interface ethernet set ether2 poe-out=off"),
    "a router that tells the power of one port only": lambda: lines_of(
        "/interface/ethernet/poe", {"name": "ether1", "poe-out-status": "powered-on"}
    ),
    # the satellite's allow-list
    "the drop of the allow-list is switched off": lambda: typed(
        "/ip firewall filter disable [find chain=to-satellite action=drop]"
    ),
    "the allow-list is not asked": lambda: typed(
        "/ip firewall filter disable [find chain=forward jump-target=to-satellite]"
    ),
    "a rule goes past the allow-list": lambda: typed(
        "/ip firewall filter add chain=forward action=accept out-interface-list=WAN "
        "place-before=[find chain=forward jump-target=to-satellite]"
    ),
    "the allow-list lets more through": lambda: typed(
        "/ip firewall filter add chain=to-satellite action=accept dst-address=198.51.100.99 "
        "place-before=[find chain=to-satellite action=drop]"
    ),
    "the allow-list lets everything through": lambda: typed(
        "/ip firewall filter add chain=to-satellite action=return place-before=[find chain=to-satellite action=drop]"
    ),
    "the allow-list lacks a target": lambda: typed(
        "/ip firewall filter disable [find chain=to-satellite dst-address=192.0.2.124]"
    ),
    "the counters of the allow-list are not known": lambda: looks(satellite={"quality": {"kept_off_packets": None}}),
    # nobody answers, or not so
    "the gateway is not reached": lambda: answers(at(Place.GATEWAY, Trouble.NO_PLACE, "10.64.1.10: no route to host")),
    "the router is not reached": lambda: answers(
        at(Place.ROUTER, Trouble.NO_PLACE, "coastal-router: connection timed out")
    ),
    "the gateway is slow": lambda: answers(at(Place.GATEWAY, Trouble.SILENT)),
    "the router is slow": lambda: answers(at(Place.ROUTER, Trouble.SILENT)),
    "we may not on the gateway": lambda: answers(at(Place.GATEWAY, Trouble.DENIED)),
    "the gateway lacks its programs": lambda: answers(at(Place.GATEWAY, Trouble.MISSING)),
    "the programs are busy": lambda: answers(at(Place.GATEWAY, Trouble.BUSY)),
    "garbage": lambda: answers(garbage),
    "answers of another shape": lambda: answers(wrong_shape),
    "the router refuses": lambda: answers(refused),
    "programs fail": lambda: answers(failing),
    "answers come late": lambda: answers(late),
    "nobody has looked at the time": lambda: answers(unstamped),
}
