"""The coastal site in this process: its router as a twin that holds its declared text, its gateway as a twin, too."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime, timedelta
from functools import cache
from pathlib import Path
from typing import Any

from atlantis_netcfg.checklist import probes
from atlantis_netcfg.checklist.probes.site_checks import steps
from atlantis_netcfg.checklist.probes.site_checks.link_qualified import NAME as LINK_QUALIFIED
from atlantis_netcfg.core.events import Verdict
from atlantis_netcfg.emulator import linux
from atlantis_netcfg.emulator.routeros.certificates import issue
from atlantis_netcfg.emulator.routeros.device import Device
from atlantis_netcfg.emulator.routeros.environment import update_surroundings
from atlantis_netcfg.emulator.routeros.spec import Environment, Load, ManagementSpec, Radio, RouterSpec, User, Validity
from atlantis_netcfg.inventory import Inventory, load
from atlantis_netcfg.routeros.render import router

SITE = "coastal"
NOW = datetime(2026, 11, 22, 10, 0, tzinfo=UTC)
ROUTER_MAC = "02:00:5E:10:01:01"
IDENTITY = "/etc/openvpn/client/atlantis.identity"
NETPLAN = "/etc/netplan/10-atlantis.yaml"
YEARS = Validity(since=NOW - timedelta(days=100), until=NOW + timedelta(days=900))
CARDS = {"10.64.1.10": "02:00:5E:00:01:10", "10.64.1.23": "02:00:5E:00:01:23", "10.64.1.24": "02:00:5E:00:01:24"}
AROUND: dict[str, Any] = {
    "cards": CARDS,
    "loads": {f"ether{number}": Load(milliamps=100 + 10 * number) for number in (1, 2, 3)},
    "tunnels": {"ovpn-scc": "10.80.0.11/16"},
    "time_server": "192.0.2.123",
    "validity": {"atlantis-api": YEARS, "atlantis-vpn": YEARS},
}
NEIGHBOURS = ("10.10.0.1", "198.51.100.11", "198.51.100.12", "10.10.1.1", "10.10.2.1")
LOOKS: dict[str, dict[str, Any]] = {
    "wifi-ptp": {"state": "up", "active": True, "quality": {}},
    "4g": {"state": "up", "active": False, "quality": {}},
    "satellite": {"state": "unknown", "active": False, "quality": {"kept_off_packets": 12}},
}

PREFIX = b"it who asks."
SAID: dict[probes.RouterOsQuery, probes.Rows] = {}


@cache
def declaration() -> Inventory:
    return load(Path(__file__).resolve().parents[5] / "inventory")


def computer() -> linux.ComputerSpec:
    others = {address: mac for address, mac in CARDS.items() if address != "10.64.1.10"}
    found = linux.lan_computer(
        "coastal-gateway",
        address="10.64.1.10/24",
        mac="02:00:5E:00:01:10",
        router=("10.64.1.1", ROUTER_MAC),
        others=others,
        tunnel="10.80.0.21/16",
        server="10.80.0.1",
    )
    told = {"not_before": NOW - timedelta(days=10), "not_after": NOW + timedelta(days=900)}
    certificates = (
        linux.CertificateSpec(subject="EXAMPLE VPN authority", **told),
        linux.CertificateSpec(subject="coastal-gateway", **told),
    )
    return found.model_copy(
        update={
            "files": {**found.files, NETPLAN: "network:\n  addresses: [10.64.1.10/24]\n"},
            "certificates": {IDENTITY: certificates},
            "udp": (
                linux.UdpSpec(port=7410),
                linux.UdpSpec(port=7411),
                linux.UdpSpec(port=5353),
                linux.UdpSpec(port=32784),
            ),
            "dds": (linux.DdsSpec(addresses=("10.80.0.21",)),),
            "reflectors": {"10.80.0.2": linux.ReflectorSpec(host="scc-control")},
        }
    )


@dataclass
class World:
    """What is asked, and how late it is; healthy unless somebody breaks it."""

    pc: linux.ComputerSpec = field(default_factory=computer)
    around: dict[str, Any] = field(default_factory=lambda: dict(AROUND))
    clock: datetime = NOW
    script: str = ""
    """Typed into the router afterwards."""
    looks: dict[str, dict[str, Any]] = field(default_factory=lambda: {name: dict(look) for name, look in LOOKS.items()})
    neighbours: tuple[str, ...] = NEIGHBOURS
    answers: Callable[[probes.Question, probes.Answer], probes.Answer] = field(default=lambda _question, answer: answer)
    """Last word on every answer."""
    steps: tuple[probes.Step, ...] = ()
    """Of a site that is declared otherwise; none: those of the shipped example."""

    def __post_init__(self) -> None:
        around = Environment.model_validate(self.around)
        changed = self.clock != NOW or self.neighbours != NEIGHBOURS
        self.device = device(self.clock, self.neighbours) if changed else kept()
        update_surroundings(self.device.core, around.model_dump())
        self.caller = self.device.login("provision", "", via="api-ssl", address="10.64.101.10")
        if self.script:
            assert self.device.run(self.caller, ["/safe-mode/take"])[-1].kind == "!done"
            (reply,) = self.device.run(self.caller, ["/execute", f"=script={self.script}", "=as-string="])
            assert reply.words[0] == "=ret=", reply.words
        self.computer = linux.Computer(self.pc, NOW.timestamp)

    def ask(self, question: probes.Question) -> probes.Answer:
        return self.answers(question, self._answer(question))

    def _answer(self, question: probes.Question) -> probes.Answer:
        stamps = {"request_time": NOW.timestamp() - 0.2, "response_time": NOW.timestamp() + 0.3}
        if isinstance(question, probes.RouterOsQuery):
            return replace(
                self._rows(question), request_time=stamps["request_time"], response_time=stamps["response_time"]
            )
        if isinstance(question, probes.RunProgram):
            rc, out, err = self.computer.answer(question.argv)
            trouble = probes.Trouble.MISSING if rc == 127 else None
            return probes.CommandResult(trouble, "", rc, out, err, began=self.computer.now, **stamps)
        if isinstance(question, probes.DhcpDiscoverRequest | probes.RouterSolicitRequest):
            return self._of_segment(question)
        if isinstance(question, probes.DdsDiscoverRequest):
            heard = self.computer.participants(question.domain, question.address, PREFIX)
            return (
                probes.DdsDiscoverResult(probes.Trouble.UNREACHABLE)
                if heard is None
                else probes.DdsDiscoverResult(None, "", PREFIX, heard)
            )
        if isinstance(question, probes.ReflectRequest):
            return self._reflected(question)
        assert isinstance(question, probes.LinkStatusRequest)
        return probes.LinkStatusResult(None, "", self.looks[question.link])

    def _of_segment(self, question: probes.DhcpDiscoverRequest | probes.RouterSolicitRequest) -> probes.Answer:
        if isinstance(question, probes.RouterSolicitRequest):
            heard = self.computer.routers(question.interface) or ()
            routers = (probes.RouterAdvertisement(one.address, one.mac, one.lifetime_s, one.prefixes) for one in heard)
            return probes.RouterAdvertisements(None, "", tuple(routers))
        found = self.computer.offers(question.interface, question.cards) or ()
        offers = (probes.DhcpOffer(one.server, one.mac.lower(), one.address, one.router) for one in found)
        return probes.DhcpOffers(None, "", tuple(offers))

    def _reflected(self, question: probes.ReflectRequest) -> probes.ReflectResult:
        sent = tuple(f"{number:032x}" for number in range(question.count))
        came = self.computer.reflect(question.source, question.address, sent)
        if came is None:
            return probes.ReflectResult(
                probes.Trouble.UNREACHABLE, f"{question.source}: Cannot assign requested address"
            )
        return probes.ReflectResult(None, "", sent, tuple(probes.ReflectReply(*one) for one in came))

    def _rows(self, question: probes.RouterOsQuery) -> probes.Rows:
        """A router as it should be says the same to everybody, so that it is asked once."""
        if self.script or self.around != AROUND or self.device is not kept():
            return self._told(question)
        if question not in SAID:
            SAID[question] = self._told(question)
        return SAID[question]

    def _told(self, question: probes.RouterOsQuery) -> probes.Rows:
        words = [question.query.path, *(f"={name}={value}" for name, value in question.query.words)]
        replies = self.device.run(self.caller, words)
        if refused := [reply for reply in replies if reply.kind == "!trap"]:
            return probes.Rows(None, " ".join(refused[0].words), None)
        told = [reply for reply in replies if reply.kind == "!re"]
        return probes.Rows(None, "", tuple(dict(word[1:].partition("=")[::2] for word in one.words) for one in told))

    def judged(self, step: probes.Step) -> probes.ProbeResult:
        assert step.probe is not None
        questions = step.probe.asks()
        assert len({question.name for question in questions}) == len(questions)
        return step.probe.judge({question.name: self.ask(question) for question in questions})

    def findings(self) -> Mapping[str, list[str]]:
        """Judge everything, and let the router be as it was: safe mode takes back what was typed."""
        found = {step.name: self.judged(step) for step in self.steps or own_steps() if not step.unless}
        if self.script:
            assert self.device.run(self.caller, ["/safe-mode/unroll"])[-1].kind == "!done"
        assert all(one.hint or one.verdict is Verdict.PASS for judged in found.values() for one in judged.findings)
        return {name: lines(judged) for name, judged in found.items()}


def lines(judged: probes.ProbeResult) -> list[str]:
    return [f"{one.verdict} {one.code}: {one.message}" for one in judged.findings]


def device(clock: datetime, neighbours: tuple[str, ...]) -> Device:
    host = declaration().hosts[f"{SITE}-router"]
    spec = RouterSpec(
        name=host.name,
        users=(User(name="provision"),),
        management=ManagementSpec(),
        packages=("routeros", "wifi-qcom"),
        radios=(Radio(name="wifi1"),),
        certificates=("atlantis-api", "atlantis-vpn"),
        neighbours=neighbours,
        clock=clock,
        seed=seed(),
    )
    made = Device(spec, lambda: 1000.0)
    for name in spec.certificates:
        made.give_certificate(name, pem(host.name))
    return made


@cache
def kept() -> Device:
    """One router for all who only move what stands around it: to make one takes a tenth of a second."""
    return device(NOW, NEIGHBOURS)


@cache
def own_steps() -> tuple[probes.Step, ...]:
    return judged_here(steps(probes.Cell(declaration(), SITE, None, "site")))


def judged_here(every: tuple[probes.Step, ...]) -> tuple[probes.Step, ...]:
    """Those that ask the site; measured links are read from this computer, in test_own_link_qualified.py."""
    return tuple(step for step in every if not step.name.startswith(LINK_QUALIFIED))


@cache
def seed() -> str:
    text = router(declaration(), declaration().hosts[f"{SITE}-router"])
    # The management address stands on an adopted router already.
    return "".join(
        line for line in text.splitlines(keepends=True) if 'comment="atlantis: management" interface' not in line
    )


@cache
def pem(name: str) -> str:
    return issue({"common-name": name, "key-size": "prime256v1"}, now=NOW)


def timed(spec: linux.ComputerSpec, **changes: Any) -> linux.ComputerSpec:  # noqa: ANN401 - fields of TimeSpec
    return spec.model_copy(update={"time": linux.TimeSpec(**changes)})
