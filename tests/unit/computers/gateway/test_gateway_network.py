"""The interface of the LAN in the language of each tool, as a technician would write it by hand."""

import json
from pathlib import Path

import pytest
from network_pilots import coast

from atlantis_netcfg.ansible_collections.atlantis.netcfg.plugins.module_utils.network_desired import (
    OURS,
    has_same_settings,
)
from atlantis_netcfg.computers.base import gateway_base
from atlantis_netcfg.computers.image.facts import ImageFacts, ImageFile
from atlantis_netcfg.computers.image.plan import plan
from atlantis_netcfg.computers.parts import computer_network
from atlantis_netcfg.operations.image import wish_of

GOLDEN = Path(__file__).parent / "golden"
PLACES = {
    "netplan": ("/etc/netplan/10-atlantis.yaml", "0600", "yaml"),
    "ifupdown": ("/etc/network/interfaces", "0644", "txt"),
    "networkd": ("/etc/systemd/network/05-atlantis.network", "0644", "txt"),
}
PROGRAMS = {"netplan": "/usr/sbin/netplan", "ifupdown": "/usr/sbin/ifup", "networkd": "/lib/systemd/systemd-networkd"}
FILES = {
    "/etc/passwd": "root:x:0:0:root:/root:/bin/bash\n",
    "/etc/shadow": "root:*:1::::::\n",
    "/etc/ssh/sshd_config": "",
}
EVERY = pytest.mark.parametrize("by", list(PLACES))
BOTH = pytest.mark.parametrize("address_by", ["static", "dhcp"])


@EVERY
@BOTH
def test_the_file_of_each_tool(by: str, address_by: str) -> None:
    part = computer_network(*coast(by, address_by))
    assert part is not None
    path, mode, kind = PLACES[by]
    assert (part.path, part.mode) == (path, mode)
    assert part.content == (GOLDEN / f"network-{by}-{address_by}.{kind}").read_text()
    assert part.content.startswith(OURS)


@EVERY
@BOTH
def test_fresh_image_has_the_declared_network(by: str, address_by: str) -> None:
    """`provision gateway image` has put the same files there: names, modes, and words but for the comment."""
    declaration, host = coast(by, address_by)
    part = computer_network(declaration, host)
    zone = f"/usr/share/zoneinfo/{declaration.pilot.time_zone}"
    edits = plan(ImageFacts(FILES, frozenset({PROGRAMS[by], zone})), wish_of(declaration, host, "x.img"))
    card = {edit.path: edit for edit in edits if isinstance(edit, ImageFile)}
    assert part is not None
    assert has_same_settings(card[part.path].content.decode(), part.content)
    assert card[part.path].mode == int(part.mode, 8)
    resolver = card.get("/etc/resolv.conf")
    assert has_same_settings(None if resolver is None else resolver.content.decode(), part.resolver)


def test_result_is_plain_data() -> None:
    part = computer_network(*coast("networkd", rollback_s=90, replaces=("/etc/network/interfaces",)))
    assert part is not None
    told = part.as_dict()
    assert json.loads(json.dumps(told)) == told
    assert told["rollback_s"] == 90
    assert told["replaces"] == ["/etc/network/interfaces"]
    assert told["resolver"] == "# Written by `provision`.\nsearch coastal.example.org\nnameserver 10.64.1.1\n"


def test_dhcp_needs_no_resolver_file() -> None:
    part = computer_network(*coast("ifupdown", "dhcp"))
    assert part is not None
    assert "resolver" not in part.as_dict()


def test_undeclared_network_is_left_alone() -> None:
    assert computer_network(*coast(None)) is None


def test_base_role_receives_the_network() -> None:
    told = gateway_base(*coast("netplan")).as_dict()
    part = computer_network(*coast("netplan"))
    assert part is not None
    assert told["network"] == part.as_dict()
    assert "network" not in gateway_base(*coast(None)).as_dict()
