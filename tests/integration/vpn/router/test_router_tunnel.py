"""A router of a rehearsal joins the VPN with a real OpenVPN client: with the rehearsal's keys, and with no others."""

import asyncio
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, cast

import pytest
from router_stand import HOST, SHIPPED, Stand, router
from tunnel_stand import Ground, ground, vpn_server
from waiting import HANG_S, wait_until

from atlantis_netcfg.core.errors import DeviceError, ExitCode
from atlantis_netcfg.core.events import ignore
from atlantis_netcfg.emulator import lab
from atlantis_netcfg.emulator.routeros.dataplane import tunnel as dataplane_tunnel
from atlantis_netcfg.operations.common.jobs import device_job
from atlantis_netcfg.operations.common.rehearsal import Rehearsal
from atlantis_netcfg.operations.computers._emulation import RehearsedComputers, create_authority
from atlantis_netcfg.operations.vpn.router import enrol_routers, identity_for
from atlantis_netcfg.routeros.apply import converge
from atlantis_netcfg.runs import NoJournal
from atlantis_netcfg.vpn.rehearsal import rehearsed_identity

if TYPE_CHECKING:
    from atlantis_netcfg.emulator.routeros import SpawnedSite

pytestmark = [
    pytest.mark.slow,
    pytest.mark.namespace,
    pytest.mark.skipif(os.geteuid() != 0, reason="making a network namespace needs root"),
]
NAME, SERVER, ADDRESS = "ovpn-scc", "10.80.0.1", "10.80.0.11/16"


@pytest.fixture(scope="module")
def authority(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return create_authority(SHIPPED, tmp_path_factory.mktemp("authority") / "vpn")


@pytest.fixture
def stand(tmp_path: Path) -> Iterator[Stand]:
    with router(tmp_path) as made:
        yield made


def rehearsal(stand: Stand, authority: Path | None) -> Rehearsal:
    emulators = cast("SpawnedSite", stand.twins)
    return Rehearsal(stand.request.targets, (), emulators, computers=RehearsedComputers(authority=authority))


def configure(stand: Stand) -> None:
    """As `provision site=coastal` does."""
    result = asyncio.run(converge(device_job(SHIPPED, HOST, stand.request, NoJournal(), ignore)))
    assert result.exit is ExitCode.DONE, result.message


def change(stand: Stand, *words: str) -> None:
    """Change a row, as a person does on the console."""
    answers = stand.twins.do(HOST.name, "console", words=list(words))
    assert [kind for kind, *_ in answers] == ["!done"], answers


def ping(place: Ground) -> str:
    return place.router.run("ping", "-c", "1", "-W", "5", SERVER)


def routes(place: Ground) -> str:
    """Return the way to the server's site, which its rows lead through the tunnel."""
    return place.router.run("ip", "route", "show", "10.64.0.0/24")


def addresses(stand: Stand) -> set[str]:
    return {row["address"] for row in stand.rows("/ip/address") if row["interface"] == NAME}


def test_router_joins_the_rehearsed_vpn(stand: Stand, authority: Path, tmp_path: Path) -> None:
    enrol_routers(SHIPPED, rehearsal(stand, authority), SHIPPED.hosts.values(), stand.request)
    request = stand.request.model_copy(update={"authority": authority})
    identity = identity_for(SHIPPED, HOST, request)
    assert identity.ca == (authority / "ca.crt").read_text()
    configure(stand)
    with ground(stand.twins, tmp_path) as place:
        tunnel = place.tunnels.tunnels[NAME]
        with vpn_server(place, authority):
            assert tunnel.wait(HANG_S) == ADDRESS, tunnel.failure
            assert "1 received" in ping(place)
            assert (stand.interface()["running"], addresses(stand)) == ("true", {ADDRESS})
            # The same rows: the client stays.
            place.apply()
            assert place.tunnels.tunnels[NAME] is tunnel
            # A person disables it, and enables it again.
            change(stand, "/interface/ovpn-client/set", f"=numbers={NAME}", "=disabled=yes")
            place.apply()
            assert not place.tunnels.tunnels
            assert stand.twins.do(HOST.name, "tunnel", interface=NAME) is None
            assert addresses(stand) == set()
            change(stand, "/interface/ovpn-client/set", f"=numbers={NAME}", "=disabled=no")
            place.apply()
            assert place.tunnels.tunnels[NAME].wait(HANG_S) == ADDRESS
            assert "1 received" in ping(place)


def test_tunnel_and_its_routes_follow_the_server(stand: Stand, authority: Path, tmp_path: Path) -> None:
    enrol_routers(SHIPPED, rehearsal(stand, authority), [HOST], stand.request)
    configure(stand)
    with ground(stand.twins, tmp_path) as place:
        tunnel = place.tunnels.tunnels[NAME]
        with vpn_server(place, authority):
            assert tunnel.wait(HANG_S) == ADDRESS, tunnel.failure
            assert routes(place)
        wait_until(lambda: tunnel.address is None)
        wait_until(lambda: addresses(stand) == set())
        assert stand.interface()["running"] == "false"
        assert NAME not in routes(place)
        with vpn_server(place, authority):
            assert tunnel.wait(HANG_S) == ADDRESS, tunnel.failure
            assert routes(place)
            assert stand.interface()["running"] == "true"


def test_foreign_authority_is_refused(stand: Stand, authority: Path, tmp_path: Path) -> None:
    request = stand.request.model_copy(update={"authority": authority})
    foreign = replace(rehearsed_identity(SHIPPED, HOST), wrap_key=identity_for(SHIPPED, HOST, request).wrap_key)
    assert stand.install(foreign).exit is ExitCode.DONE
    configure(stand)
    with ground(stand.twins, tmp_path) as place, vpn_server(place, authority):
        tunnel = place.tunnels.tunnels[NAME]
        wait_until(lambda: tunnel.failure)
        assert "VERIFY ERROR" in str(tunnel.failure)
        assert (tunnel.address, stand.interface()["running"]) == (None, "false")


def test_certificate_of_another_server_name_is_refused(stand: Stand, authority: Path, tmp_path: Path) -> None:
    enrol_routers(SHIPPED, rehearsal(stand, authority), [HOST], stand.request)
    configure(stand)
    change(stand, "/interface/ovpn-client/set", f"=numbers={NAME}", "=connect-to=other.example.org")
    change(stand, "/ip/dns/static/add", "=name=other.example.org", "=address=203.0.113.2", "=type=A")
    with ground(stand.twins, tmp_path) as place, vpn_server(place, authority):
        tunnel = place.tunnels.tunnels[NAME]
        assert tunnel.settings.address == "203.0.113.2"
        wait_until(lambda: tunnel.failure)
        assert "VERIFY SCRIPT ERROR" in str(tunnel.failure)


def test_expired_certificate_has_no_tunnel(stand: Stand, authority: Path) -> None:
    enrol_routers(SHIPPED, rehearsal(stand, authority), [HOST], stand.request)
    settings = stand.twins.do(HOST.name, "tunnel", interface=NAME)
    assert (settings["connect_to"], settings["address"]) == ("vpn.example.org", "vpn.example.org")
    assert (settings["cipher"], settings["auth"], settings["port"]) == ("AES-256-GCM", "SHA256", 1194)
    validity = {"atlantis-vpn": {"since": "2020-01-01T00:00:00Z", "until": "2021-01-01T00:00:00Z"}}
    stand.twins.do(HOST.name, "around", validity=validity)
    assert stand.twins.do(HOST.name, "tunnel", interface=NAME) is None


def test_missing_program_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert dataplane_tunnel.why_not() is None
    monkeypatch.setenv("PATH", str(tmp_path))
    assert dataplane_tunnel.why_not() == "missing: apt install openvpn openssl"


def test_enrolment_raises_what_the_device_says(tmp_path: Path) -> None:
    with router(tmp_path, "7.16.2") as stand, pytest.raises(DeviceError, match=r"7\.16\.2"):
        enrol_routers(SHIPPED, rehearsal(stand, None), [HOST], stand.request)


OWNER = """\
import sys, time
from pathlib import Path
from atlantis_netcfg.emulator import lab
from atlantis_netcfg.emulator.lab import hosts
from atlantis_netcfg.emulator.routeros.dataplane import tunnel, tunnel_rows
from atlantis_netcfg.inventory import load
from atlantis_netcfg.vpn.rehearsal import rehearsed_identity
inventory = load(Path(sys.argv[2]))
identity = rehearsed_identity(inventory, inventory.hosts["coastal-router"])
settings = tunnel_rows.TunnelSettings(
    name="vpn", connect_to="127.0.0.1", address="127.0.0.1", port=1194, protocol="udp", cipher="AES-256-GCM",
    auth="SHA256", tls_version="any", max_mtu=1500, is_server_verified=True, has_pulled_routes=False, notifies=True,
    user="somebody", password="", identity=identity.key.reveal() + identity.cert, authorities=identity.ca,
    wrap=identity.wrap_key.reveal(),
)
with lab.reserve_name() as name:
    hosts.add_namespace(name)
    hosts.program("ip", "-n", name, "tuntap", "add", "dev", "vpn", "mode", "tun")
    client = tunnel.RouterTunnel(name, "vpn", settings, Path(sys.argv[1]))
    print(name, client._process.pid, flush=True)
    time.sleep(600)
"""


@pytest.mark.parametrize("has_keeper", [True, False])
def test_killed_rehearsal_leaves_no_client(tmp_path: Path, has_keeper: bool) -> None:  # noqa: FBT001 - a parameter
    words = (sys.executable, "-c", OWNER, str(tmp_path), str(Path(__file__).parents[4] / "inventory"))
    with subprocess.Popen(words, stdout=subprocess.PIPE, text=True) as owner:
        assert owner.stdout is not None
        name, client = owner.stdout.readline().split()
        place = Path("/proc", client)
        wait_until(lambda: "openvpn" in (place / "cmdline").read_text())
        if not has_keeper:
            children = Path(f"/proc/{owner.pid}/task/{owner.pid}/children").read_text().split()
            keeper = next(each for each in children if "reaper.py" in Path(f"/proc/{each}/cmdline").read_text())
            os.kill(int(keeper), signal.SIGKILL)
        owner.kill()
    if not has_keeper:
        assert "openvpn" in (place / "cmdline").read_text()
        with lab.reserve_name():
            pass
    wait_until(lambda: not place.exists() and not Path("/run/netns", name).exists())
