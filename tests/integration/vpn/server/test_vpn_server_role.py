"""The server of the VPN on a real computer with systemd, and what OpenVPN's own clients find there.

One machine for all of it: every test leaves the server as the record says.
"""

import json
import os
import shutil
import signal
from contextlib import suppress
from datetime import UTC, datetime, timedelta
from typing import Any

import pytest
from vpn_server_stand import FOLDER, NAME, TUNNEL, Stand, below, stand  # noqa: F401 - a fixture
from waiting import HANG_S, wait_until

from atlantis_netcfg.vpn import pki
from atlantis_netcfg.vpn.identity import KeyType, MemberLink

pytestmark = [pytest.mark.namespace, pytest.mark.slow]
EXPOSURE = 2.6
"""At most, of 10, as `systemd-analyze security` counts it; Debian's own unit has 7.5."""


@pytest.fixture(scope="module")
def first(stand: Stand) -> dict[str, Any]:  # noqa: F811
    """Four members, the result of the first run, and what was printed then."""
    for device in ("one", "two", "gone"):
        stand.laptop(device)
    stand.laptop("slow", "iqua", MemberLink.SATELLITE)
    told = stand.run("-vvv", "--diff")
    assert told["status"] == "changed", f"{told['message']}\n{stand.said[-2000:]}"
    return told | {"said": stand.said}


@pytest.fixture(scope="module")
def server(stand: Stand, first: dict[str, Any]) -> Stand:  # noqa: ARG001, F811
    """The server after its first run: any test may be the first one of a worker."""
    return stand


def settled(server: Stand) -> list[str]:
    """Bring the server to the record; gives what was changed. The tunnel goes on unless its own files were others."""
    told = server.run()
    assert told["exit"] == 0, told["message"]
    changes: list[str] = told["changes"]
    return changes


def test_run_is_idempotent_and_shows_no_secrets(server: Stand, first: dict[str, Any]) -> None:
    again = server.run()
    assert (again["status"], again["changes"]) == ("unchanged", [])
    seen = json.dumps(first) + server.said + server.machine.run("journalctl -o cat --no-pager").stdout
    seen += server.machine.run("cat /proc/[0-9]*/cmdline /proc/[0-9]*/environ | tr '\\0' '\\n'", check=False).stdout
    assert [line for line in server.secrets if line in seen] == []
    owned = f"{FOLDER}/*.key {FOLDER} {FOLDER}/ccd /etc/atlantis/vpn.nft"
    modes = [line.split() for line in server.machine.run(f"stat -c '%a %U:%G %n' {owned}").stdout.splitlines()]
    assert {mode for mode, _, name in modes if name.endswith((".key", ".nft"))} == {"600"}
    assert {owner for _, owner, _ in modes} == {"root:root"}
    socket = server.machine.run("test -S /run/atlantis-vpn/management.sock && stat -c %a /run/atlantis-vpn").stdout
    assert socket.strip() == "710"


def test_service_is_hardened_and_restarts_after_a_kill(server: Stand) -> None:
    told = server.machine.run(f"systemd-analyze security --no-pager {TUNNEL} | tail -1").stdout
    assert float(told.split(":")[1].split()[0]) <= EXPOSURE, told
    before = server.pid()
    server.machine.run(f"kill -KILL {before}")
    wait_until(lambda: server.pid() not in {before, "0"}, lambda: "it is not started again")


def test_security_updates_are_automatic_and_restart_openvpn(server: Stand) -> None:
    """Debian's package leaves the running program as it is; there is no archive here, so the update is made by hand."""
    timers = "apt-daily.timer apt-daily-upgrade.timer"
    assert server.machine.run(f"systemctl is-active {timers}").stdout.split() == ["active", "active"]
    origins = server.machine.run("unattended-upgrade --dry-run --verbose").stdout
    assert "label=Debian-Security" in origins, origins
    assert 'APT::Periodic::Unattended-Upgrade "1"' in server.machine.run("apt-config dump").stdout
    before = server.pid()
    server.machine.run("systemctl start apt-daily-upgrade.service")
    assert server.pid() == before
    server.machine.run("cp -a /usr/sbin/openvpn /usr/sbin/.new && mv /usr/sbin/.new /usr/sbin/openvpn")
    server.machine.run("systemctl start apt-daily-upgrade.service")
    assert server.pid() not in {before, "0"}
    assert settled(server) == []


def test_members_get_the_addresses_of_the_record(server: Stand) -> None:
    fast, slow = (server.client(name).connect() for name in ("inesc-one", "iqua-slow"))
    members = server.authority.membership().members
    for client, name in ((fast, "inesc-one"), (slow, "iqua-slow")):
        assert f"ifconfig {members[name].address} 255.255.0.0" in client.log
        assert client.pings()
    assert not fast.pings(str(members["iqua-slow"].address)), "partners are apart"
    assert "dev tun0" in server.machine.run("ip route show 10.64.1.0/24").stdout, "the LAN of another site"
    assert "ping 170,ping-restart 600" in slow.log
    assert "ping 10,ping-restart 60" in fast.log
    server.machine.run("until grep -q inesc-one /run/atlantis-vpn/status; do sleep 0.2; done", timeout_s=HANG_S)
    server.machine.run("systemctl start atlantis-vpn-seen.service")
    seen = json.loads(server.read("/var/lib/atlantis/vpn/seen.json"))
    assert seen["seen"]["inesc-one"]["address"] == str(members["inesc-one"].address)
    slow.end()


def test_revoked_member_is_out_and_others_stay_connected(server: Stand) -> None:
    stays, goes = (server.client(name).connect() for name in ("inesc-two", "inesc-gone"))
    before, listed = server.pid(), int(server.machine.run(f"stat -c %Y {FOLDER}/crl.pem").stdout)
    server.revoke("inesc-gone")
    changes = settled(server)
    assert f"absent {FOLDER}/ccd/inesc-gone" in changes
    assert "unit atlantis-vpn-firewall.service reloaded" in changes
    assert not [change for change in changes if TUNNEL in change]
    assert int(server.machine.run(f"stat -c %Y {FOLDER}/crl.pem").stdout) > listed
    assert server.pid() == before
    assert stays.pings()
    assert not goes.pings(), "its address is admitted no more"
    goes.end()
    goes.start()
    revoked = "certificate revoked: CN=inesc-gone"
    wait_until(lambda: revoked in server.journal(), lambda: server.journal()[-2000:])
    goes.end()
    stays.end()


def test_member_without_file_or_with_expired_certificate_is_refused(server: Stand) -> None:
    late = server.client(server.laptop("late"))  # the record has it, the server has not
    late.start()
    wait_until(lambda: "AUTH_FAILED" in late.log, lambda: late.log[-2000:])
    late.end()
    text = server.profiles["inesc-one"]
    key, past = pki.new_key(KeyType.EC), datetime.now(UTC) - timedelta(days=10)
    old = pki.new_client(server.ca, key.public_key(), "inesc-one", pki.new_serial(), 1, past)
    for name, pem in (("cert", pki.cert_pem(old)), ("key", pki.key_pem(key).reveal())):
        head, _, tail = text.partition(f"<{name}>")
        text = f"{head}<{name}>\n{pem.strip()}\n{tail[tail.index(f'</{name}>') :]}"
    expired = server.client("inesc-one", text)
    expired.start()
    wait_until(
        lambda: "certificate has expired" in server.journal(), lambda: server.journal()[-2000:] + expired.log[-2000:]
    )
    expired.end()
    settled(server)
    late.connect().end()


def test_manually_changed_file_is_reported_and_restored(server: Stand) -> None:
    path, stranger, site = f"{FOLDER}/ccd/inesc-one", f"{FOLDER}/ccd/nobody", ("site=scc", f"device={NAME}")
    right, before = server.read(path), server.pid()
    server.machine.put(path, "ifconfig-push 10.80.0.2 255.255.0.0\n", mode="0640")
    server.machine.put(stranger, "")
    told = server.provision("report", "drift", *site)
    assert told["exit"] == 6, told
    assert {one["subject"] for one in told["devices"][NAME]["differences"]} == {f"file {path}", f"absent {stranger}"}
    done = server.provision(*site, "--yes")
    assert (done["exit"], done["devices"][NAME]["changes"]) == (0, [f"file {path}", f"absent {stranger}"])
    assert (server.read(path), server.pid()) == (right, before)
    away = server.vpn.rename(server.vpn.with_name("away"))
    told = server.provision(*site, "--yes")
    away.rename(server.vpn)
    assert told["exit"] == 3
    assert "provision vpn init" in told["errors"][0]["hint"]


def test_vulnerable_openvpn_is_not_started(server: Stand) -> None:
    before = server.pid()
    server.machine.run("mv /usr/sbin/openvpn /usr/sbin/openvpn.kept")
    server.machine.put("/usr/sbin/openvpn", "#!/bin/sh\necho OpenVPN 2.6.10 x86_64-pc-linux-gnu\n", mode="0755")
    told = server.run()
    server.machine.run("mv /usr/sbin/openvpn.kept /usr/sbin/openvpn")
    assert told["status"] == "left-as-found"
    assert "openvpn 2.6.10 has known vulnerabilities" in told["message"]
    assert server.pid() == before


def test_firewall_is_restored_and_tunnel_requires_it(server: Stand) -> None:
    table = "nft list table inet p_atlantis_vpn"
    server.machine.run("systemctl restart nftables.service")  # begins with `flush ruleset`
    assert "p_members" in server.machine.run(table).stdout
    server.machine.run("nft flush ruleset; systemctl start atlantis-vpn-guard.service")
    assert "p_members" in server.machine.run(table).stdout
    server.machine.run("systemctl stop atlantis-vpn-firewall.service")
    assert "p_members" in server.machine.run(table).stdout
    assert server.pid() == "0"
    assert f"unit {TUNNEL} started" in settled(server)
    before = server.pid()
    server.machine.run("systemctl reload nftables.service")
    assert "p_members" in server.machine.run(table).stdout
    assert server.pid() == before


@pytest.mark.campaign
def test_power_cut_during_setup_is_completed_by_the_next_run(server: Stand) -> None:
    server.machine.run(f"systemctl stop {TUNNEL}; rm -rf {FOLDER} /etc/openvpn/server/atlantis.conf /etc/atlantis")
    with server.starting() as process:
        server.machine.run(f"until [ -e {FOLDER}/.ca.crt.atlantis-new ]; do :; done", timeout_s=HANG_S)
        server.machine.power_cut()
        for one in (process.pid, *below(process.pid)):  # a task has a session of its own, and holds the lock as well
            with suppress(ProcessLookupError):
                os.kill(one, signal.SIGKILL)
    shutil.rmtree(server.folder / "kept", ignore_errors=True)  # connections that were kept open
    server.ground.command(("ip", "neighbour", "flush", "all"))
    gone = server.provision("site=all", f"device={NAME},coastal-gateway", "--yes")
    assert {name: one["status"] for name, one in gone["devices"].items()} == {
        NAME: "left-as-found",
        "coastal-gateway": "left-as-found",
    }, "a server that does not respond leaves the gateways their turn"
    server.machine.power_on()
    settled(server)
    assert settled(server) == []
    server.machine.power_cut()
    server.machine.power_on()
    server.client("inesc-one").connect().end()
