"""Part `openvpn_server`: its configuration, the files of members, and what of it starts the tunnel anew."""

import json
import subprocess
from dataclasses import replace
from datetime import UTC, datetime
from ipaddress import IPv4Address
from pathlib import Path
from typing import Any

import pytest

from atlantis_netcfg.core.errors import UsageError
from atlantis_netcfg.inventory import Inventory, load
from atlantis_netcfg.vpn.identity import (
    TIMERS,
    Certificate,
    CertificateStatus,
    KeyType,
    Member,
    MemberKind,
    MemberLink,
    MembershipList,
    Wrap,
)
from atlantis_netcfg.vpn.server import CCD, FIREWALL, ccd, live_files, openvpn_server, server_conf

SHIPPED = load(Path(__file__).parents[4] / "inventory")
SERVER = SHIPPED.hosts["scc-vpn"]
NOW = datetime(2026, 11, 22, tzinfo=UTC)
CANARY = "a line of a private key that stands nowhere else"
SECRETS = ("server/server.key", "server/tls-crypt-v2.key", "server/tls-crypt.key")


def certificate(common_name: str, standing: CertificateStatus = CertificateStatus.ISSUED) -> Certificate:
    return Certificate(common_name, 1, "00", NOW, NOW, Wrap.TLS_CRYPT_V2, KeyType.EC, standing)


def member(name: str, address: str, *certificates: Certificate, **told: Any) -> Member:  # noqa: ANN401 - of a member
    fields = {
        "kind": MemberKind.LAPTOP,
        "partner": "inesc",
        "device": name,
        "link": MemberLink.FIBRE,
        "vehicle": None,
        **told,
    }
    return Member(name=name, address=IPv4Address(address), certificates=certificates or (certificate(name),), **fields)


def membership(*members: Member) -> MembershipList:
    return MembershipList({one.name: one for one in members}, 1, "00", NOW, ())


@pytest.fixture
def authority(tmp_path: Path) -> Path:
    """A folder that looks like an authority's."""
    (tmp_path / "server").mkdir()
    for name in ("ca.crt", "crl.pem", "server/server.crt"):
        (tmp_path / name).write_text(f"{name}\n")
    for name in SECRETS:
        (tmp_path / name).write_text(CANARY)
    return tmp_path


def pilot(**vpn: Any) -> Inventory:  # noqa: ANN401 - of the VPN
    changed = SHIPPED.pilot.vpn.model_copy(update=vpn)
    return replace(SHIPPED, pilot=SHIPPED.pilot.model_copy(update={"vpn": changed}))


def test_result_is_final_data_without_secrets(authority: Path) -> None:
    told = openvpn_server(SHIPPED, SERVER, membership(member("inesc-a", "10.80.16.1")), authority).as_dict()
    text = json.dumps(told)
    assert json.loads(text) == told
    assert CANARY not in text
    assert "{{" not in text
    assert {Path(path).name for path in told["secrets"]} == {Path(name).name for name in SECRETS}
    assert all(Path(source).read_text() == CANARY for source in told["secrets"].values())


@pytest.mark.parametrize("name", ["ca.crt", "crl.pem", *SECRETS])
def test_incomplete_authority_is_refused(authority: Path, name: str) -> None:
    (authority / name).unlink()
    with pytest.raises(UsageError, match=name) as refused:
        openvpn_server(SHIPPED, SERVER, membership(), authority)
    assert "provision vpn init" in (refused.value.hint or "")


def test_kernel_ignores_redirects_and_router_advertisements(authority: Path) -> None:
    files = openvpn_server(SHIPPED, SERVER, membership(), authority).configuration.files
    text = next(file.content for file in files if file.path == "/etc/sysctl.d/60-atlantis-vpn.conf")
    for interface in ("all", "default", "*"):
        assert f"-net.ipv4.conf.{interface}.accept_redirects = 0" in text.splitlines()
        assert f"-net.ipv6.conf.{interface}.accept_ra = 0" in text.splitlines()


def test_tunnel_restarts_only_for_its_own_files(authority: Path) -> None:
    configuration = openvpn_server(SHIPPED, SERVER, membership(), authority).configuration
    tunnel = next(unit for unit in configuration.units if unit.name.startswith("openvpn-server@"))
    live = {file.path for file in live_files(SHIPPED, membership(member("inesc-a", "10.80.16.1")), b"")}
    assert live.isdisjoint(tunnel.after)
    assert {"/etc/openvpn/server/atlantis.conf", "/etc/openvpn/atlantis/server.key"} <= set(tunnel.after)
    firewall = next(unit for unit in configuration.units if FIREWALL in unit.after)
    assert firewall.reload
    assert configuration.only == (CCD,)


def test_configuration_isolates_members() -> None:
    lines = server_conf(SHIPPED, SERVER).splitlines()
    for line in (
        *("proto udp4", "local 10.64.0.10", "port 1194", "dev tun0", "topology subnet", "ccd-exclusive"),
        *("ifconfig 10.80.0.1 255.255.0.0", "remote-cert-tls client", "tls-version-min 1.2", "tran-window 300"),
        *("crl-verify /etc/openvpn/atlantis/crl.pem", "explicit-exit-notify 1", "status-version 3"),
        *("route 10.64.1.0 255.255.255.0", "route 10.64.101.0 255.255.255.0", "route 10.64.2.0 255.255.255.0"),
        "data-ciphers AES-256-GCM:CHACHA20-POLY1305:AES-128-GCM",
    ):
        assert line in lines
    words = {line.split()[0] for line in lines if line and not line.startswith("#")}
    assert words.isdisjoint({"client-to-client", "ifconfig-pool", "duplicate-cn", "server", "compress", "comp-lzo"})
    assert not [line for line in lines if line.startswith("route 10.64.0.")], "its own LAN is no route of the tunnel"


def test_declared_cipher_is_first_and_tcp_has_no_exit_notify() -> None:
    text = server_conf(pilot(cipher="aes128-gcm", transport=SHIPPED.pilot.vpn.transport.__class__("tcp")), SERVER)
    assert "data-ciphers AES-128-GCM:AES-256-GCM:CHACHA20-POLY1305\n" in text
    assert "proto tcp4-server\n" in text
    assert "explicit-exit-notify" not in text


def test_openvpn_accepts_the_configuration(tmp_path: Path) -> None:
    (tmp_path / "server.conf").write_text(server_conf(SHIPPED, SERVER))
    words = ["openvpn", "--config", str(tmp_path / "server.conf"), "--show-ciphers"]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout


def test_a_server_without_an_address_in_its_own_vpn_is_refused() -> None:
    bare = replace(SERVER, device=SERVER.device.model_copy(update={"vpn_address": None}))
    with pytest.raises(UsageError, match="no address in its own VPN"):
        server_conf(SHIPPED, bare)


@pytest.mark.parametrize("link", list(MemberLink))
def test_timers_follow_the_link(link: MemberLink) -> None:
    one = member("inesc-a", "10.80.16.1", link=link)
    lines = ccd(one, one.certificates[0], SHIPPED).splitlines()
    assert lines[0] == "ifconfig-push 10.80.16.1 255.255.0.0"
    ping, restart = TIMERS[link]
    told = [f"ping {ping}", f"ping-restart {restart}", "push-remove ping", "push-remove ping-restart"]
    assert lines[1:] == (
        [] if link is MemberLink.FIBRE else [*told, f'push "ping {ping}"', f'push "ping-restart {restart}"']
    )


def test_site_router_brings_the_networks_of_its_site() -> None:
    router = member("coastal-router", "10.80.0.11", kind=MemberKind.ROUTER, partner=None)
    text = ccd(router, router.certificates[0], SHIPPED)
    assert "iroute 10.64.1.0 255.255.255.0\niroute 10.64.101.0 255.255.255.0\n" in text
    for other in (member("coastal-router", "10.80.16.1"), member("coastal-gateway", "10.80.0.21", partner=None)):
        assert "iroute" not in ccd(other, other.certificates[0], SHIPPED), "a partner's device has no network of ours"


def test_each_valid_certificate_has_a_file_and_no_other() -> None:
    old, new = certificate("inesc-a", CertificateStatus.SEEN), certificate("inesc-a.2")
    gone = certificate("inesc-b", CertificateStatus.REVOKED), certificate("inesc-c", CertificateStatus.SUPERSEDED)
    members = (
        member("inesc-a", "10.80.16.1", old, new),
        member("inesc-b", "10.80.16.2", gone[0]),
        member("inesc-c", "10.80.16.3", gone[1], certificate("inesc-c.2")),
    )
    files = {file.path: file.content for file in live_files(SHIPPED, membership(*members), b"list\n")}
    assert {path for path in files if path.startswith(CCD)} == {
        f"{CCD}/{name}" for name in ("inesc-a", "inesc-a.2", "inesc-c.2")
    }
    assert files[f"{CCD}/inesc-a"] == files[f"{CCD}/inesc-a.2"]
    assert files["/etc/openvpn/atlantis/crl.pem"] == "list\n"
    assert "p_members" in files[FIREWALL]


@pytest.mark.parametrize(
    "name", ["", "..", "../x", "inesc-a\n", "inesc-a\0b", ".hidden", "Inesc-a", "inesc-a.0", "a/b"]
)
def test_invalid_common_name_is_refused(name: str) -> None:
    one = member("inesc-a", "10.80.16.1", certificate(name))
    with pytest.raises(UsageError, match="no common name"):
        live_files(SHIPPED, membership(one), b"")


def test_an_address_outside_the_vpn_is_refused() -> None:
    one = member("inesc-a", "10.90.16.1")
    with pytest.raises(UsageError, match="outside the VPN's network"):
        ccd(one, one.certificates[0], SHIPPED)
