"""Every menu, argument and enumerated word of the text exists in RouterOS' own command trees."""

import gzip
import json
from functools import cache
from importlib import resources
from typing import Any

import pytest
from render_declared import SITES
from test_render_text import parsed

VERSIONS = ("7.18.2", "7.21.5")
# A Cloud Hosted Router, which the trees come from, has no port that feeds power.
NOT_IN_THE_TREES = {("/interface/ethernet", "poe-out"), ("/interface/ethernet", "poe-priority")}
# Arguments whose whole range of values the console offers; of the others it offers what one router happened to hold.
ENUMERATED = {
    "/interface/bridge/add": ("protocol-mode",),
    "/interface/ethernet/set": ("disabled",),
    "/interface/ovpn-client/add": (
        *("add-default-route", "auth", "cipher", "disabled", "mode", "protocol", "route-nopull", "tls-version"),
        *("use-peer-dns", "verify-server-certificate"),
    ),
    "/ip/cloud/set": ("ddns-enabled", "update-time"),
    "/ip/dns/set": ("allow-remote-requests",),
    "/ip/firewall/filter/add": ("action", "connection-nat-state", "connection-state", "protocol"),
    "/ip/firewall/mangle/add": ("action", "chain", "passthrough", "protocol", "tcp-flags"),
    "/ip/firewall/nat/add": ("action", "chain", "protocol"),
    "/ip/route/add": ("check-gateway",),
    "/ip/service/set": ("disabled", "tls-version"),
    "/ip/ssh/set": ("forwarding-enabled", "strong-crypto"),
    "/ipv6/settings/set": ("accept-redirects", "accept-router-advertisements", "disable-ipv6", "forward"),
    "/routing/rule/add": ("action",),
    "/system/clock/set": ("time-zone-autodetect", "time-zone-name"),
    "/system/logging/add": ("action", "topics"),
    "/system/note/set": ("show-at-login",),
    "/tool/mac-server/set": ("allowed-interface-list",),
    "/tool/mac-server/mac-winbox/set": ("allowed-interface-list",),
}


@cache
def loaded(name: str) -> dict[str, Any]:
    packed = resources.files("atlantis_netcfg.emulator.routeros").joinpath("data", f"{name}.json.gz").read_bytes()
    tree: dict[str, Any] = json.loads(gzip.decompress(packed))
    return tree


@pytest.mark.parametrize("version", VERSIONS)
@pytest.mark.parametrize("site", SITES)
def test_every_menu_and_argument_exists(site: str, version: str) -> None:
    for row in parsed(site).statements:
        node = loaded(version)
        for word in (*row.menu.strip("/").split("/"), row.verb):
            assert word in node, f"{row.menu} {row.verb} is not in {version}"
            node = node[word]
        unknown = {name for name, _ in row.values if name not in node and (row.menu, name) not in NOT_IN_THE_TREES}
        assert not unknown, f"{row.menu} {row.verb} of {version} does not know {unknown}"


@pytest.mark.parametrize("site", SITES)
def test_every_enumerated_word_is_offered_by_the_console(site: str) -> None:
    offered = loaded("7.21.5.values")
    checked = 0
    for row in parsed(site).statements:
        command = f"{row.menu}/{row.verb}"
        for name in ENUMERATED.get(command, ()):
            value = row.get(name)
            if value is None:
                continue
            assert set(value.removeprefix("!").split(",")) <= set(offered[f"{command} {name}"]), (command, name, value)
            checked += 1
    assert checked > 30
