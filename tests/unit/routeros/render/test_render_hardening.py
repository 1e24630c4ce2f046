"""Doors that are shut (MikroTik manual, "Securing your router"), and those that must stay open."""

import pytest
from render_declared import SITES, declaration
from test_render_text import parsed

SHUT = {
    "/ip/cloud": {"ddns-enabled": "auto", "update-time": "no"},
    "/ip/neighbor/discovery-settings": {"discover-interface-list": "none"},
    "/ip/proxy": {"enabled": "no"},
    "/ip/settings": {"accept-redirects": "no", "accept-source-route": "no", "rp-filter": "loose"},
    "/ip/socks": {"enabled": "no"},
    "/ip/ssh": {"forwarding-enabled": "no", "strong-crypto": "yes"},
    "/ip/upnp": {"enabled": "no"},
    "/ipv6/settings": {
        "accept-redirects": "no",
        "accept-router-advertisements": "no",
        "disable-ipv6": "yes",
        "forward": "no",
    },
    "/snmp": {"enabled": "no"},
    "/tool/bandwidth-server": {"enabled": "no"},
    "/tool/mac-server": {"allowed-interface-list": "none"},
    "/tool/mac-server/mac-winbox": {"allowed-interface-list": "none"},
    "/tool/mac-server/ping": {"enabled": "no"},
    "/tool/romon": {"enabled": "no"},
}


@pytest.mark.parametrize("site", SITES)
def test_unneeded_services_are_off(site: str) -> None:
    found = {row.menu: dict(row.values) for row in parsed(site).statements if row.menu in SHUT}
    assert found == SHUT


@pytest.mark.parametrize("site", SITES)
def test_only_encrypted_services_are_enabled_and_only_for_managers(site: str) -> None:
    services = {str(row.target): dict(row.values) for row in parsed(site).statements if row.menu == "/ip/service"}
    admitted = ",".join(str(prefix) for prefix in declaration().sites[site].management.admit)
    assert services == {
        **{name: {"disabled": "yes"} for name in ("api", "ftp", "telnet", "winbox", "www", "www-ssl")},
        "ssh": {"address": admitted, "disabled": "no", "port": "22"},
        "api-ssl": {
            "address": admitted,
            "certificate": "atlantis-api",
            "disabled": "no",
            "port": "8729",
            "tls-version": "only-1.2",
        },
    }


@pytest.mark.parametrize("site", SITES)
def test_user_accounts_are_not_rendered(site: str) -> None:
    menus = set(parsed(site).menus)
    assert "/ip/service" in menus
    assert not {menu for menu in menus if menu.startswith("/user")}


@pytest.mark.parametrize("site", ["coastal", "te4sea"])
def test_tunnel_verifies_the_declared_server(site: str) -> None:
    row = next(row for row in parsed(site).statements if row.menu == "/interface/ovpn-client")
    assert {
        "add-default-route": "no",
        "auth": "null",
        "cipher": "aes256-gcm",
        "connect-to": "vpn.example.org",
        "mode": "ip",
        "protocol": "udp",
        "route-nopull": "yes",
        "tls-version": "only-1.2",
        "use-peer-dns": "no",
        "user": f"{site}-router",
        "verify-server-certificate": "yes",
    }.items() <= dict(row.values).items()
    named = {row.get("name"): row.get("address") for row in parsed(site).statements if row.menu == "/ip/dns/static"}
    assert named["vpn.example.org"] == "203.0.113.2"
