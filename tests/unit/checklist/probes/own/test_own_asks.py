"""What the checks ask for: only reading, only what the devices know, and only what has been allowed."""

import re
from pathlib import Path

import pytest
import trees
from own_world import declaration, own_steps

from atlantis_netcfg.checklist.probes import (
    DdsDiscoverRequest,
    DhcpDiscoverRequest,
    LinkStatusRequest,
    ReflectRequest,
    RouterOsQuery,
    RouterSolicitRequest,
    RunProgram,
    site_checks,
)
from atlantis_netcfg.checklist.probes.site_checks.addresses import FILES
from atlantis_netcfg.checklist.probes.site_checks.certificates import IDENTITY
from atlantis_netcfg.cli.base.commands import COMMANDS
from atlantis_netcfg.computers import parts
from atlantis_netcfg.core.reading_programs import is_allowed
from atlantis_netcfg.emulator.routeros import schema
from atlantis_netcfg.inventory.model import REFLECTOR_PORT
from atlantis_netcfg.vpn import client

EVERY = [question for step in own_steps() if step.probe is not None for question in step.probe.asks()]
QUERIES = [one.query for one in EVERY if isinstance(one, RouterOsQuery)]
POE = "/interface/ethernet/poe"


@pytest.mark.parametrize("version", trees.VERSIONS)
def test_router_has_the_queried_commands(version: str) -> None:
    tree = trees.Tree(version)
    for query in QUERIES:
        if query.menu == POE:  # hardware that the trees' Cloud Hosted Router lacks
            added = {one.command: one.arguments for one in schema.ADDITIONS if one.menu == POE}
            assert {name for name, _ in query.words} <= {*added[query.command]}
            continue
        assert tree.has_command(query.menu, query.command)
        # The API takes a list of properties everywhere (Manual, API); menus of settings do not name it.
        words = {name.lstrip(".") for name, _ in query.words} - {"proplist"}
        assert words <= tree.arguments(query.menu, query.command)


def test_queried_properties_exist_in_their_menus() -> None:
    offered = trees.offered()
    for query in QUERIES:
        known = offered.get(f"{query.path} proplist")
        if known is not None:
            computed = {"dst-address", "protocol", "dst-port", "src-address", "src-port"}
            assert set(query.proplist) <= {*known, *computed}, query


def test_only_read_requests_are_sent() -> None:
    assert {query.command for query in QUERIES} == {"print", "monitor", "ping"}
    assert all(("arp-ping", "yes") in query.arguments for query in QUERIES if query.command == "ping")
    assert {type(one) for one in EVERY} == {
        RouterOsQuery,
        DdsDiscoverRequest,
        LinkStatusRequest,
        DhcpDiscoverRequest,
        ReflectRequest,
        RouterSolicitRequest,
        RunProgram,
    }
    asked = {name for query in QUERIES for name in query.proplist}
    assert not {name for name in asked if "password" in name or "secret" in name}


def test_every_program_is_allowed() -> None:
    programs = [one.argv for one in EVERY if isinstance(one, RunProgram)]
    assert programs
    assert [argv for argv in programs if not is_allowed(argv)] == []


@pytest.mark.parametrize(
    "words",
    [
        "cat /etc/shadow",
        "cat /etc/openvpn/client/atlantis.identity",
        "cat /etc/netplan/10-atlantis.yaml /etc/shadow",
        "cat /etc/netplan/10-atlantisXyaml",
        "cat /proc/net/udp6/../../1/environ",
        "openssl storeutl -noout -text -certs /etc/ssl/private/other.key",
        "openssl storeutl -text /etc/openvpn/client/atlantis.identity",
        "openssl storeutl -noout -text -keys /etc/openvpn/client/atlantis.identity",
        "ip -j addr add 10.0.0.1/8 dev eth0",
        "ip -j route del default",
        "ip -j neigh flush dev eth0",
        "timedatectl set-time 10:00",
        "chronyc -n -c makestep",
    ],
)
def test_unlisted_program_is_refused(words: str) -> None:
    assert not is_allowed(tuple(words.split()))


def test_paths_are_those_that_the_toolkit_writes() -> None:
    assert IDENTITY == client.IDENTITY
    assert set(FILES) == {tool.path for tool in parts._TOOLS.values()}


def test_pings_stay_within_the_site_and_vpn() -> None:
    """Five to the VPN's own server through the tunnel; ARP does not leave the LAN."""
    targets = {one.argv[-1] for one in EVERY if isinstance(one, RunProgram) and one.argv[0] == "ping"}
    server = declaration().hosts[declaration().pilot.vpn.server].device
    assert targets == {str(getattr(server, "vpn_address", None))}


def test_messages_go_only_to_the_control_centre() -> None:
    asked = [one for one in EVERY if isinstance(one, ReflectRequest)]
    centre = declaration().hosts["scc-control"].device
    assert [(one.source, one.address, one.port) for one in asked] == [
        ("10.80.0.21", str(getattr(centre, "vpn_address", None)), REFLECTOR_PORT)
    ]


def test_hints_name_existing_commands() -> None:
    text = "".join(path.read_text(encoding="utf-8") for path in Path(site_checks.__path__[0]).glob("*.py"))
    named = set(re.findall(r"`provision ((?:(?:vpn|device|measure|report|recover|robot) )?[a-z]+)[` ]", text))
    assert "vpn renew" in named
    assert named - COMMANDS.keys() == set()
