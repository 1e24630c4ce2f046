"""Ways in which a site is broken, one at a time; what is to be said of each stands in `own_cases.yml`."""

from collections.abc import Callable
from dataclasses import replace
from datetime import timedelta
from typing import Any

from own_world import AROUND, CARDS, IDENTITY, LOOKS, NETPLAN, NOW, World, computer, timed

from atlantis_netcfg.checklist.probes import (
    Answer,
    CommandResult,
    DdsDiscoverRequest,
    DdsDiscoverResult,
    DhcpDiscoverRequest,
    DhcpOffers,
    LinkStatusResult,
    Place,
    Question,
    ReflectRequest,
    ReflectResult,
    RouterAdvertisements,
    RouterOsQuery,
    RouterSolicitRequest,
    Rows,
    RunProgram,
    Trouble,
)
from atlantis_netcfg.emulator import linux
from atlantis_netcfg.emulator.routeros.spec import DiscoveryNeighbour, Load, Validity

ROGUE = linux.OfferSpec(server="192.168.8.1", mac="02:00:5E:00:01:24", address="192.168.8.100", router="192.168.8.1")
ADVERTISED = linux.AdvertisementSpec(address="fe80::ff:fe00:124", mac="02:00:5e:00:01:24")
OWN = computer().dhcp["eth0"][0]


def pc(**changes: Any) -> World:  # noqa: ANN401 - fields of ComputerSpec
    return World(pc=computer().model_copy(update=changes))


def dds(*addresses: str) -> tuple[linux.DdsSpec, ...]:
    """One participant, and where it says that it is reached."""
    return (linux.DdsSpec(addresses=addresses),)


def udp(*ports: int) -> tuple[linux.UdpSpec, ...]:
    return tuple(linux.UdpSpec(port=port) for port in ports)


def around(**changes: Any) -> World:  # noqa: ANN401 - fields of Around
    return World(around={**AROUND, **changes})


def typed(script: str) -> World:
    return World(script=script)


def looks(**changes: dict[str, Any]) -> World:
    return World(looks={name: {**look, **changes.get(name.replace("-", "_"), {})} for name, look in LOOKS.items()})


def with_address(address: str, lease_s: int | None = None, *, instead: bool = False) -> linux.ComputerSpec:
    spec = computer()
    lan, *others = spec.interfaces
    kept = () if instead else lan.addresses
    changed = lan.model_copy(update={"addresses": (*kept, linux.AddressSpec(address=address, lease_s=lease_s))})
    return spec.model_copy(update={"interfaces": (changed, *others)})


def without_tunnel() -> linux.ComputerSpec:
    spec = computer()
    return spec.model_copy(update={"interfaces": spec.interfaces[:1], "echoes": {}})


def with_tunnel(address: str) -> linux.ComputerSpec:
    spec = computer()
    lan, tunnel = spec.interfaces
    changed = tunnel.model_copy(update={"addresses": (linux.AddressSpec(address=address),)})
    return spec.model_copy(update={"interfaces": (lan, changed)})


def seen(address: str, mac: str) -> tuple[linux.NeighbourSpec, ...]:
    return (*computer().neighbours, linux.NeighbourSpec(address=address, dev="eth0", mac=mac))


def stale(address: str, mac: str) -> tuple[linux.NeighbourSpec, ...]:
    return (linux.NeighbourSpec(address=address, dev="eth0", mac=mac, state="STALE"),)


def valid(name: str, since: int, until: int) -> World:
    """Of a certificate of the router; days from now."""
    dates = Validity(since=NOW + timedelta(days=since), until=NOW + timedelta(days=until))
    return around(validity={**AROUND["validity"], name: dates})


def identity(since: int, until: int) -> World:
    told = linux.CertificateSpec(
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
    if isinstance(question, RouterOsQuery):
        return Rows(None, rows=({"x": "\x00?"},))
    if isinstance(question, RunProgram):
        return CommandResult(None, out="\x1b[31m{ not json\n", began=0.0)
    if isinstance(question, ReflectRequest) and isinstance(_answer, ReflectResult):
        return replace(_answer, answers=tuple(replace(one, data=b"\x00{") for one in _answer.answers))
    if isinstance(question, DdsDiscoverRequest):
        return DdsDiscoverResult(None, "", b"?" * 12, (("10.80.0.21", b"RTPS\x02\x01 no, it is not"),))
    if isinstance(question, RouterSolicitRequest):
        return RouterAdvertisements(None)
    return (
        DhcpOffers(None)
        if isinstance(question, DhcpDiscoverRequest)
        else LinkStatusResult(None, link={"state": "sideways"})
    )


def wrong_shape(_question: Question, answer: Answer) -> Answer:
    return LinkStatusResult(None, link=None) if not isinstance(answer, LinkStatusResult) else Rows(None, rows=())


def refused(question: Question, answer: Answer) -> Answer:
    return Rows(None, "no such command prefix", None) if isinstance(question, RouterOsQuery) else answer


def failing(question: Question, answer: Answer) -> Answer:
    return CommandResult(None, rc=1, err="sh: something\nit broke\n") if isinstance(question, RunProgram) else answer


def answered(change: Callable[[DdsDiscoverResult], DdsDiscoverResult]) -> World:
    return answers(lambda _, answer: change(answer) if isinstance(answer, DdsDiscoverResult) else answer)


def centre(**changes: Any) -> World:  # noqa: ANN401 - fields of ReflectorSpec
    return pc(reflectors={"10.80.0.2": linux.ReflectorSpec(host="scc-control").model_copy(update=changes)})


def reflected(trouble: Trouble | None = None, words: str = "", **changes: Any) -> World:  # noqa: ANN401 - of Reflected
    """Each answer of the control centre is otherwise, or there is a trouble."""

    def change(question: Question, answer: Answer) -> Answer:
        if not isinstance(question, ReflectRequest) or not isinstance(answer, ReflectResult):
            return answer
        if trouble is not None:
            return ReflectResult(trouble, words)
        return replace(answer, answers=tuple(replace(one, **changes) for one in answer.answers))

    return answers(change)


def echoed(said: DdsDiscoverResult) -> DdsDiscoverResult:
    """A program that sends back whatever it gets."""
    return replace(said, datagrams=(("10.80.0.21", b"RTPS\x02\x01\0\0" + said.prefix + said.datagrams[0][1][20:]),))


def lines_of(menu: str, *rows: dict[str, str]) -> World:
    def change(question: Question, answer: Answer) -> Answer:
        asked = isinstance(question, RouterOsQuery) and question.query.menu == menu
        return replace(answer, rows=rows) if asked and isinstance(answer, Rows) else answer

    return answers(change)


def ran(name: str, **changes: Any) -> World:  # noqa: ANN401 - fields of Ran
    def change(question: Question, answer: Answer) -> Answer:
        return replace(answer, **changes) if question.name == name and isinstance(answer, CommandResult) else answer

    return answers(change)


def late(_question: Question, answer: Answer) -> Answer:
    """Over a satellite answers take a while, and prove less of a clock."""
    if isinstance(answer, Rows | CommandResult):
        return replace(answer, request_time=NOW.timestamp() - 30, response_time=NOW.timestamp() + 45)
    return answer


def slow(_question: Question, answer: Answer) -> Answer:
    if isinstance(answer, Rows | CommandResult):
        return replace(answer, request_time=NOW.timestamp() - 5, response_time=NOW.timestamp() + 5)
    return answer


def unstamped(_question: Question, answer: Answer) -> Answer:
    return replace(answer, request_time=0.0, response_time=0.0) if isinstance(answer, Rows | CommandResult) else answer


API = {"name": "atlantis-api", "invalid-after": "2029-05-10 10:00:00", "private-key": "true"}
TUNNEL = {**API, "name": "atlantis-vpn", "common-name": "coastal-router"}
DOWN = '[{"dst":"default","gateway":"10.64.1.1","dev":"eth0","flags":["linkdown"]}]\n'
PINGED = (
    "PING 10.80.0.1 (10.80.0.1) from 10.80.0.21 tun0: 56(84) bytes of data.\n"
    + "".join(f"64 bytes from 10.80.0.1: icmp_seq={number} ttl=64 time=62.0 ms\n" for number in range(1, 6))
    + "\n--- 10.80.0.1 ping statistics ---\n5 packets transmitted, {} received, {}0% packet loss, time 4006ms\n"
)
IN_USE = {
    "state": "up",
    "active": True,
    "findings": [
        {"verdict": "WARN", "code": "in-use-for-a-time", "message": "4g is in use until 20:30", "hint": "type `end`"}
    ],
}
"""4G, as `provision links` tells it while it is in use."""
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
    "a DHCP server that answers known cards only": lambda: pc(
        dhcp={"eth0": (OWN, ROGUE.model_copy(update={"knows": ("02:00:5E:00:01:24",)}))}
    ),
    "a DHCP server that answers a card that is not declared": lambda: pc(
        dhcp={"eth0": (OWN, ROGUE.model_copy(update={"knows": ("02:00:5E:AA:00:77",)}))}
    ),
    "another card offers as the router, which is silent": lambda: pc(
        dhcp={"eth0": (OWN.model_copy(update={"mac": "02:00:5E:AA:00:01"}),)}
    ),
    # addresses
    # IPv6 routers
    "another IPv6 router": lambda: pc(routers={"eth0": (ADVERTISED,)}),
    "another IPv6 router of two prefixes": lambda: pc(
        routers={"eth0": (ADVERTISED.model_copy(update={"prefixes": ("2001:db8:1::/64", "fd00:1::/64")}),)}
    ),
    "another IPv6 router that is no way out": lambda: pc(
        routers={"eth0": (ADVERTISED.model_copy(update={"lifetime_s": 0, "mac": "02:00:5e:aa:00:01"}),)}
    ),
    "an address with two cards": lambda: pc(
        neighbours=(
            linux.NeighbourSpec(address="10.64.1.150", dev="eth0", mac="02:00:5E:AA:00:01"),
            linux.NeighbourSpec(address="10.64.1.150", dev="eth0", mac="02:00:5E:AA:00:02"),
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
        lambda question, answer: CommandResult(Trouble.DENIED) if question.name == NETPLAN else answer
    ),
    "an address of the router is switched off": lambda: typed('/ip address disable [find address="10.10.1.2/29"]'),
    "the router has another mask": lambda: typed('/ip address set [find address="10.64.1.1/24"] address=10.64.1.1/16'),
    "the router lacks an address": lambda: typed('/ip address remove [find address="10.10.2.2/29"]'),
    "an address of the router is on another port": lambda: typed(
        '/ip address set [find address="10.10.2.2/29"] interface=ether5'
    ),
    "the gateway's address is on its loopback": lambda: pc(
        interfaces=(
            *computer().interfaces[1:],
            linux.InterfaceSpec(name="lo", addresses=(linux.AddressSpec(address="10.64.1.10/24"),)),
        )
    ),
    "the router tells no address": lambda: lines_of("/ip/address"),
    "the router tells an address that nobody understands": lambda: lines_of(
        "/ip/address", {"address": "10.64.1.1/24", "interface": "bridge-lan"}, {"address": "::ffff", "interface": "?"}
    ),
    "the gateway tells no address": lambda: World(
        answers=lambda question, answer: (
            replace(answer, out="[]\n")
            if isinstance(answer, CommandResult)
            and isinstance(question, RunProgram)
            and question.argv == ("ip", "-j", "addr", "show")
            else answer
        )
    ),
    # factory settings
    "a device on a factory address answers ARP": lambda: World(neighbours=(*World().neighbours, "192.168.2.2")),
    "a device on a factory address is a neighbour": lambda: pc(neighbours=seen("192.168.88.1", "02:00:5E:AA:00:03")),
    "a device with a factory name": lambda: World(
        around={
            **AROUND,
            "called": (
                DiscoveryNeighbour(
                    identity="MikroTik", interface="bridge-lan", mac="02:00:5E:AA:00:04", address="10.64.1.77"
                ),
            ),
        },
        script="/ip neighbor discovery-settings set discover-interface-list=all",
    ),
    "the router asks nobody by ARP": lambda: answers(
        lambda question, answer: Rows(None, "not permitted", None) if question.name.startswith("ping 1") else answer
    ),
    "the router has sent no question by ARP": lambda: lines_of("/tool", {"status": "no interface", "sent": "0"}),
    # routes
    "a better link is up and not used": lambda: World(script=LEAVE),
    "a link is in use for a time": lambda: World(looks={**LOOKS, "4g": IN_USE}, script=LEAVE),
    "the better link is down": lambda: World(
        looks={**LOOKS, "wifi-ptp": {"state": "down", "active": False}}, script=LEAVE
    ),
    "whether the better link works is not known": lambda: World(
        looks={**LOOKS, "wifi-ptp": {"state": "unknown", "active": False}}, script=LEAVE
    ),
    "no default route": lambda: typed('/ip route disable [find dst-address="0.0.0.0/0"]'),
    "a default route to a stranger": lambda: typed("/ip route add dst-address=0.0.0.0/0 gateway=10.64.1.77 distance=1"),
    "traffic split over two links": lambda: typed("/ip route add dst-address=0.0.0.0/0 gateway=10.10.1.1 distance=10"),
    "the gateway's default route leads elsewhere": lambda: pc(routes=(linux.RouteSpec(via="10.64.1.77", dev="eth0"),)),
    "the gateway has no default route": lambda: pc(routes=()),
    "the gateway has two equal default routes": lambda: pc(
        routes=(linux.RouteSpec(via="10.64.1.1", dev="eth0"), linux.RouteSpec(via="192.168.4.1", dev="wlan0"))
    ),
    "the gateway has a spare default route": lambda: pc(
        routes=(
            linux.RouteSpec(via="10.64.1.1", dev="eth0"),
            linux.RouteSpec(via="192.168.4.1", dev="wlan0", protocol="dhcp", metric=600),
        )
    ),
    "half of a default route that goes before it": lambda: typed(
        "/ip route add dst-address=0.0.0.0/1 gateway=10.64.1.77; "
        "/ip route add dst-address=128.0.0.0/1 gateway=10.64.1.77"
    ),
    "halves of a default route that go before the gateway's": lambda: pc(
        routes=(
            *computer().routes,
            linux.RouteSpec(to="0.0.0.0/1", dev="tun0"),
            linux.RouteSpec(to="128.0.0.0/1", dev="tun0"),
        )
    ),
    "the gateway's default route has no link": lambda: answers(
        lambda question, answer: (
            replace(answer, out=DOWN)
            if isinstance(answer, CommandResult)
            and isinstance(question, RunProgram)
            and "route" in question.argv
            and "get" not in question.argv
            else answer
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
        around={**AROUND, "time_server": None}, pc=timed(computer(), is_synchronised=False)
    ),
    "the router asks no time server": lambda: typed("/system ntp client set enabled=no"),
    "a clock of before 7.10": lambda: lines_of(
        "/system/clock", {"date": "nov/22/2026", "time": "10:00:00", "gmt-offset": "+00:00"}
    ),
    "a router that woke up in 1970": lambda: lines_of(
        "/system/clock", {"date": "jan/02/1970", "time": "00:00:09", "gmt-offset": "+00:00"}
    ),
    "an impossible date": lambda: lines_of("/system/clock", {"date": "foo/40/2026", "time": "10:00:00"}),
    "the router says nothing of its NTP client": lambda: answers(
        lambda question, answer: Rows(None, "not permitted", None) if question.name == "ntp" else answer
    ),
    "the router's NTP client has no rows": lambda: lines_of("/system/ntp/client"),
    "the router's NTP client reaches nobody": lambda: lines_of(
        "/system/ntp/client", {"enabled": "true", "status": "unreachable"}
    ),
    "the router's NTP client does not say how it is": lambda: lines_of("/system/ntp/client", {"enabled": "true"}),
    "the router's NTP client is off, and its clock was set before": lambda: lines_of(
        "/system/ntp/client", {"enabled": "false", "status": "synchronized"}
    ),
    "a time server that is not declared": lambda: lines_of(
        "/system/ntp/client", {"enabled": "true", "status": "synchronized", "synced-server": "198.51.100.7"}
    ),
    "the router does not say which time server": lambda: lines_of(
        "/system/ntp/client", {"enabled": "true", "status": "synchronized"}
    ),
    "nothing sets the gateway's clock": lambda: World(pc=timed(computer(), ntp=False)),
    "the gateway does not say what sets its clock": lambda: ran("timedatectl", out="NTPSynchronized=yes\n"),
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
    "an address of the tunnel that is not in force": lambda: answers(
        lambda question, answer: (
            replace(answer, rows=tuple({**row, "invalid": "true"} for row in answer.rows or ()))
            if question.name == "addresses" and isinstance(answer, Rows)
            else answer
        )
    ),
    "answers of the VPN server come twice": lambda: ran("ping", out=PINGED.format("5", "+5 duplicates, ")),
    "the ping of the VPN server was cut short": lambda: ran(
        "ping", out=PINGED.replace("5 packets", "1 packets").format("1", "")
    ),
    "the VPN server loses pings": lambda: pc(echoes={"10.80.0.1": linux.EchoSpec(loss_percent=40, rtt_ms=650)}),
    # data
    "the control centre is silent": lambda: pc(reflectors={}),
    "the control centre is silent over a satellite": lambda: World(
        pc=computer().model_copy(update={"reflectors": {}}),
        looks={
            **LOOKS,
            "wifi-ptp": {**LOOKS["wifi-ptp"], "active": False},
            "satellite": {**LOOKS["satellite"], "active": True},
        },
    ),
    "a message is lost": lambda: centre(loss_percent=40),
    "an answer takes too long": lambda: centre(rtt_ms=3200),
    "what is sent arrives outside of the VPN": lambda: centre(arrives_by="eth0"),
    "an answer comes back outside of the VPN": lambda: reflected(interface="eth0"),
    "another computer has the control centre's address": lambda: centre(host="somebody"),
    "another address answers": lambda: reflected(sender="10.80.0.77"),
    "an answer without the token": lambda: reflected(data=b'{"token":"' + b"e" * 32 + b'","host":"scc-control"}'),
    "nothing answers at the control centre": lambda: reflected(Trouble.REFUSED, "10.80.0.2: Connection refused"),
    "nothing can be sent": lambda: reflected(Trouble.UNREACHABLE, "10.80.0.2: Network is unreachable"),
    "data would leave by the cable": lambda: pc(
        routes=(*computer().routes, linux.RouteSpec(to="10.80.0.2/32", via="10.64.1.77", dev="eth0"))
    ),
    "there is no route to the control centre": lambda: ran(
        "way scc-control", rc=2, out="", err="RTNETLINK answers: Network is unreachable\n"
    ),
    # DDS
    "nobody speaks DDS": lambda: pc(udp=(linux.UdpSpec(port=5353),), dds=()),
    "DDS in another domain": lambda: pc(
        udp=udp(7650, 7660, 7661), dds=(linux.DdsSpec(domain=1, addresses=("10.80.0.21",)),)
    ),
    "DDS in another domain without its profile": lambda: pc(udp=udp(7650, 7651, 59363), dds=()),
    "DDS without its profile, Fast DDS": lambda: pc(udp=udp(7400, 7410, 7411, 45896)),
    "DDS without its profile, Cyclone DDS": lambda: pc(udp=udp(7400, 7401, 59318), dds=()),
    "DDS with and without its profile, Fast DDS": lambda: pc(udp=udp(7400, 7410, 7411, 7412, 7413)),
    "DDS with and without its profile, Cyclone DDS": lambda: pc(udp=udp(7400, 7400, 7401, 7401, 7410, 7411)),
    "others at ports of DDS": lambda: pc(udp=udp(7400, 7660, 14550, 32784), dds=()),
    "more participants than declared": lambda: pc(
        udp=tuple(linux.UdpSpec(port=7410 + 2 * number) for number in range(12))
    ),
    "announcements were dropped": lambda: ran(
        "sockets",
        out="  sl  local_address rem_address\n"
        " 1000: 00000000:1CF2 00000000:0000 07 00000000:00000000 00:00000000 00000000  1000        0 20000 2 0000 17\n",
    ),
    "any program at the ports of DDS": lambda: pc(dds=()),
    "a program that sends back what it gets at a port of DDS": lambda: answered(echoed),
    "an announcement of DDS that was meant for somebody else": lambda: answered(
        lambda said: replace(said, prefix=b"another one.")
    ),
    "an announcement of DDS, and nothing that is addressed to us": lambda: answered(
        lambda said: replace(said, datagrams=tuple((who, data[:20] + data[36:]) for who, data in said.datagrams[:1]))
    ),
    "DDS on the loopback alone": lambda: pc(dds=dds("127.0.0.1")),
    "DDS at the address of the LAN": lambda: pc(dds=dds("10.64.1.10")),
    "DDS on the loopback, and one that is reached": lambda: pc(
        dds=(*dds("127.0.0.1"), *dds("10.64.1.10", "10.80.0.21"))
    ),
    "DDS of which nobody knows who answers": lambda: answers(
        lambda question, answer: (
            DdsDiscoverResult(Trouble.DENIED) if isinstance(question, DdsDiscoverRequest) else answer
        )
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
    "a certificate is revoked": lambda: lines_of("/certificate", API, {**TUNNEL, "revoked": "true"}),
    "a certificate without its key": lambda: lines_of("/certificate", {**API, "private-key": "false"}, TUNNEL),
    "the certificate of another router": lambda: lines_of(
        "/certificate", API, {**TUNNEL, "common-name": "te4sea-router"}
    ),
    "the gateway has the identity of another one": lambda: pc(
        certificates={
            IDENTITY: (
                computer().certificates[IDENTITY][0],
                computer().certificates[IDENTITY][1].model_copy(update={"subject": "te4sea-gateway"}),
            )
        }
    ),
    "the gateway's identity was cut": lambda: pc(certificates={IDENTITY: computer().certificates[IDENTITY][:1]}),
    # PoE
    "nobody draws power": lambda: around(loads={"ether1": Load(), "ether3": Load()}),
    "a short circuit": lambda: load(status="short-circuit"),
    "an overload": lambda: load(status="overload"),
    "a word for power that nobody knows": lambda: load(status="meditating"),
    "a box draws nothing": lambda: load(milliamps=0),
    "power is switched off": lambda: typed("/interface ethernet set ether2 poe-out=off"),
    "a port that feeds has another name": lambda: typed("/interface ethernet set ether2 name=starlink"),
    "two ports that feed have swapped their names": lambda: typed(
        "/interface ethernet set ether2 name=x; /interface ethernet set ether3 name=ether2;"
        " /interface ethernet set x name=ether3"
    ),
    "two links are on each other's sockets, under names that were swapped": lambda: typed(
        "/interface ethernet set ether2 name=x; /interface ethernet set ether3 name=ether2;"
        " /interface ethernet set x name=ether3; /ip address set [find interface=ether2] comment=was interface=ether4;"
        " /ip address set [find interface=ether3] interface=ether2; /ip address set [find comment=was] interface=ether3"
    ),
    "a port that feeds nobody has another name": lambda: typed("/interface ethernet set ether8 name=laptop"),
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
    "only some packets come to the allow-list": lambda: typed(
        "/ip firewall filter set [find chain=forward jump-target=to-satellite] in-interface=ether5"
    ),
    "only new connections come to the allow-list": lambda: typed(
        "/ip firewall filter set [find chain=forward jump-target=to-satellite] connection-state=new"
    ),
    "the allow-list drops some packets only": lambda: typed(
        "/ip firewall filter set [find chain=to-satellite action=drop] src-address-list=lan"
    ),
    "the allow-list leads elsewhere": lambda: typed(
        "/ip firewall filter add chain=to-satellite action=jump jump-target=guests "
        "place-before=[find chain=to-satellite action=drop]"
    ),
    "the allow-list lets a target through at times only": lambda: typed(
        "/ip firewall filter set [find chain=to-satellite dst-address=192.0.2.124] src-address=10.64.1.10"
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
    "answers take as long as over a satellite": lambda: answers(slow),
    "nobody has looked at the time": lambda: answers(unstamped),
}
