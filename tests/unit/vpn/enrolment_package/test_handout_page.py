"""The page of each kind of device, word for word; and that it says of reach what the firewall does."""

import json
import re
from dataclasses import replace
from html.parser import HTMLParser
from itertools import product
from pathlib import Path

import pytest
from handout_mint import Wanted, identity

from atlantis_netcfg.core.errors import UsageError
from atlantis_netcfg.inventory import Inventory, load
from atlantis_netcfg.inventory.model import RosDistribution
from atlantis_netcfg.vpn.enrolment_package import contents
from atlantis_netcfg.vpn.enrolment_package.page import reach
from atlantis_netcfg.vpn.identity import ClientSystem, KeyType, MemberKind, MemberLink, MembershipList, Wrap
from atlantis_netcfg.vpn.policy import Flow, Party, Protocol, policy

PAGES = Path(__file__).with_name("pages")
CONTACT = "Example Person, +00 000, vpn@example.org"
KINDS = {
    "laptop": Wanted(),
    "laptop-of-2.4-by-satellite": Wanted(wrap=Wrap.TLS_CRYPT, link=MemberLink.SATELLITE, generation=2),
    "robot": Wanted("udg-sparus2", MemberKind.ROBOT, "udg", "10.80.19.1", MemberLink.SATELLITE, vehicle="sparus"),
    "robot-foxy": Wanted(
        "inesc-zarco", MemberKind.ROBOT, vehicle="zarco", wrap=Wrap.TLS_CRYPT, distribution=RosDistribution.FOXY
    ),
    "laptop-linux": Wanted(system=ClientSystem.LINUX),
    "laptop-ubuntu-desktop": Wanted(system=ClientSystem.UBUNTU_DESKTOP, distribution=RosDistribution.JAZZY),
    "laptop-windows": Wanted(system=ClientSystem.WINDOWS),
    "laptop-macos": Wanted(system=ClientSystem.MACOS, distribution=RosDistribution.HUMBLE),
    "laptop-android": Wanted(system=ClientSystem.ANDROID),
    "laptop-ios": Wanted(system=ClientSystem.IOS),
    "router": Wanted("vtt-router1", MemberKind.ROUTER, "vtt", "10.80.20.1", wrap=Wrap.TLS_CRYPT, key=KeyType.RSA),
    "host": Wanted("coastal-gateway", MemberKind.HOST, None, "10.80.0.21"),
}


@pytest.fixture(scope="module")
def declaration() -> Inventory:
    return load(Path(__file__).parents[4] / "inventory")


@pytest.mark.parametrize("kind", KINDS)
def test_text_page_matches_the_golden_file(kind: str, declaration: Inventory) -> None:
    told = contents(declaration, identity(KINDS[kind]), contact=CONTACT)["README.txt"]
    assert told == (PAGES / f"{kind}.txt").read_text()
    assert [line for line in told.splitlines() if len(line) > 80 and not line.startswith("    ")] == []
    assert max(map(len, told.splitlines())) <= 100


class Reader(HTMLParser):
    """Elements that are open, and what would be loaded from elsewhere."""

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.loads: list[str] = []
        self.text = ""

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        if tag != "meta":
            self.open.append(tag)
        self.loads += [str(value) for name, value in attrs if name in {"src", "href"}]

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        if "body" in self.open:
            self.text += data


@pytest.mark.parametrize("kind", KINDS)
def test_html_page_has_the_same_text(kind: str, declaration: Inventory) -> None:
    told = contents(declaration, identity(KINDS[kind]), contact=CONTACT)
    reader = Reader()
    reader.feed(told["README.html"])
    assert (reader.open, reader.loads) == ([], [])
    assert '<html lang="en">' in told["README.html"]
    marks = re.compile(r"^(=+|-+|- (.*))$", re.MULTILINE)
    text = marks.sub(r"\2", told["README.txt"]).replace("`", "")
    assert reader.text.split() == text.split()


def test_operator_input_is_escaped_in_html(declaration: Inventory) -> None:
    told = contents(declaration, identity(), contact="<script>alert(1)</script> & Sons")["README.html"]
    assert "&lt;script&gt;alert(1)&lt;/script&gt; &amp; Sons" in told
    assert "<script>" not in told


@pytest.mark.parametrize("contact", ["", "  ", "two\nlines", "bell\x07", "x" * 201])
def test_invalid_contact_is_refused(contact: str, declaration: Inventory) -> None:
    with pytest.raises(UsageError, match="the contact for a partner must be one line of at most 200 characters"):
        contents(declaration, identity(), contact=contact)


@pytest.mark.parametrize("kind", KINDS)
def test_keys_are_only_in_the_profile_file(kind: str, declaration: Inventory) -> None:
    told = identity(KINDS[kind])
    secrets = [line for text in (told.key, told.wrap_key) for line in text.reveal().splitlines() if "-" not in line]
    holding = {
        name
        for name, text in contents(declaration, told, contact=CONTACT).items()
        if any(secret in text for secret in secrets)
    }
    assert holding == {f"{told.member.name}.{'identity' if kind == 'host' else 'ovpn'}"}


FLOWS = {
    "ping": Flow(Protocol.ICMP),
    "DDS": Flow(Protocol.UDP, 7410),
    "EXAMPLE-web-page": Flow(Protocol.TCP, 8443),
    "example-websocket": Flow(Protocol.TCP, 18081),
}


@pytest.mark.parametrize("kind", [kind for kind in KINDS if kind != "host"])
def test_page_lists_exactly_the_hosts_the_firewall_allows(kind: str, declaration: Inventory) -> None:
    addresses = {name: getattr(host.device, "vpn_address", None) for name, host in declaration.hosts.items()}
    wanted = [Wanted(name, MemberKind.HOST, None, str(address)) for name, address in addresses.items() if address]
    others = {one.name: identity(one).member for one in wanted if one.name != KINDS[kind].name}
    member = identity(KINDS[kind]).member
    matrix = policy(
        declaration, MembershipList({member.name: member, **others}, 0, "", member.certificates[0].not_after, ())
    )
    said: dict[str, set[str]] = {name: set() for name in others}
    for one in reach(declaration, member):
        for (name, _), word in product(one.hosts, one.traffic):
            said.setdefault(name, set()).add(word.partition(" ")[0])
    own = Party(member.name, member.address)
    for name, other in others.items():
        allowed = {word for word, flow in FLOWS.items() if matrix.allows(own, Party(name, other.address), flow)}
        assert said[name] == allowed


def test_page_lists_partners_that_see_a_robot_and_robots_a_partner_sees(declaration: Inventory) -> None:
    partner = declaration.partners["vtt"].model_copy(update={"sees": ("sparus", "zarco")})
    seeing = replace(declaration, partners={**declaration.partners, "vtt": partner})
    robot = contents(seeing, identity(KINDS["robot"]), contact=CONTACT)["README.txt"]
    other = contents(seeing, identity(KINDS["router"]), contact=CONTACT)["README.txt"]
    assert "This robot can also be reached, by ping and DDS, by: VTT." in " ".join(robot.split())
    assert "- the robots Sparus, Zarco: ping, DDS (UDP 7410 to 7429)\n" in other
    assert "This robot can also be reached" not in other


def test_page_without_dds_or_services(declaration: Inventory) -> None:
    vpn = declaration.pilot.vpn.model_copy(update={"services": ()})
    plain = replace(declaration, pilot=declaration.pilot.model_copy(update={"dds": None, "vpn": vpn}))
    told = contents(plain, identity(), contact=CONTACT)
    assert "DDS" not in told["README.txt"].partition("What you can reach")[2]
    assert json.loads(told["self-test.json"])["dds_port"] is None
    assert "- the control centre (scc-control 10.80.0.2): ping\n" in told["README.txt"]
