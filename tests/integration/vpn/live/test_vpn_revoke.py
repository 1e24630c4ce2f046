"""A member is thrown out of a running server: seen by an echo through the tunnel, by the server's word, by a return."""

import fcntl
import hashlib
import json
import shutil
import socket
from collections.abc import Iterator
from contextlib import closing
from urllib.parse import unquote

import pytest
from live_stand import NAME, Client, Echo, Record, Server, declaration, record, server_of
from local_link import LocalLink

from atlantis_netcfg.operations.computers.remote_session import ServerRefusal
from atlantis_netcfg.operations.vpn import live
from atlantis_netcfg.operations.vpn.server_state import PLACE
from atlantis_netcfg.routeros.render import template_folder
from atlantis_netcfg.vpn.server import CCD, FIREWALL, FOLDER, MANAGEMENT

pytestmark = [pytest.mark.slow, pytest.mark.namespace]

ORDER = [
    *("list installed", "no longer admitted", "client told to stop", "firewall closed", "session ended"),
    *("written to disk", "verified"),
]


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Record:
    return record(tmp_path_factory.mktemp("authority") / "vpn")


@pytest.fixture(scope="module")
def server(made: Record) -> Iterator[Server]:
    with server_of(made) as started:
        yield started
        assert started.lives, "nothing that was done to it has ended the server"


def connected(server: Server, count: int = 1) -> tuple[list[str], list[Client]]:
    """New members, admitted and connected."""
    names = server.record.onboard(count)
    server.push()
    clients = [server.client(name) for name in names]
    for one in clients:
        one.start()
    return names, clients


def refused(server: Server, client: Client, why: str) -> None:
    """It tries once more, and does not come in."""
    client.stop()
    before = server.log().count(why)
    client.start(wait=False)
    server.said(why, before + 1)
    assert not client.up
    client.stop()


@pytest.mark.smoke
def test_revoked_member_is_cut_off_at_once_and_cannot_reconnect(server: Server) -> None:
    (other, *names), (bystander, *clients) = connected(server, 6)
    with Echo(bystander) as beside:
        for name, client in zip(names, clients, strict=True):
            with Echo(client) as echo:
                echo.goes()
                asked = server.link.round_trips
                evidence = server.throw_out(name)
                assert echo.answers() == 0
            assert server.link.round_trips == asked + 1
            assert evidence.is_confirmed, evidence
            assert (evidence.left, evidence.notes) == ((), ())
            assert [step for step, _ in evidence.steps] == ORDER
            assert [one.common_name for one in evidence.ended] == [name]
            assert all(reply.startswith("SUCCESS: ") for replies in evidence.replies for reply in replies)
            assert live.verify(server.link, evidence).is_confirmed
        for client in clients:
            assert client.ended() == 0, "it was told, and does not ask again"
            refused(server, client, "certificate revoked")
        beside.goes()
    assert server.names() == [other]
    assert server.run("nft", "list", "tables") == "table inet p_atlantis_vpn\n"
    assert server.push().changes == ()
    assert server.drift() == ()


def test_unresponsive_client_is_cut_off_too(server: Server) -> None:
    """As behind a dead link, or where somebody has made a client that heeds nothing."""
    (name,), (client,) = connected(server)
    client.pause()
    evidence = server.throw_out(name)
    assert evidence.is_confirmed
    assert [len(replies) for replies in evidence.replies] == [2]
    assert name not in server.names()


def test_revocation_leaves_what_the_role_expects(server: Server) -> None:
    (name,), _ = connected(server)
    server.throw_out(name)
    for file in live.desired_files(declaration(), server.record.authority):
        there = server.at(file.path)
        assert (there.read_text(), f"{there.stat().st_mode & 0o7777:04o}") == (file.content, file.mode), file.path
    stamps = {
        unquote(path.name): json.loads(path.read_text()) for path in server.at("/var/lib/atlantis/applied").iterdir()
    }
    ruleset = hashlib.sha256(server.at(FIREWALL).read_bytes()).hexdigest()
    assert stamps == {"unit atlantis-vpn-firewall.service": {FIREWALL: ruleset}}


def test_revocations_in_the_same_second_are_all_enforced(server: Server) -> None:
    names, clients = connected(server, 3)
    times = []
    for name in names:
        server.throw_out(name)
        times.append(int(server.at(f"{FOLDER}/crl.pem").stat().st_mtime))
    assert times == sorted(set(times)), "OpenVPN compares whole seconds"
    for client in clients:
        refused(server, client, "certificate revoked")


def test_blocked_management_socket_does_not_delay_the_cut_off(server: Server) -> None:
    (name,), (client,) = connected(server)
    with closing(socket.socket(socket.AF_UNIX)) as holder, Echo(client) as echo:
        holder.connect(str(server.at(MANAGEMENT)))
        assert holder.recv(5) == b">INFO"
        echo.goes()
        server.record.revoke(name)
        evidence = server.go_on()
        assert evidence is not None
        assert (evidence.out, evidence.dead, evidence.is_confirmed) == (True, False, False)
        assert "has not responded for 2 s" in evidence.notes[0]
        assert evidence.notes[1] == "no session is confirmed as ended: the server does not respond"
        assert echo.answers() == 0
        assert server.record.authority.membership().queued_names == (name,)
        assert "cannot report who is connected" in " ".join(server.drift())
    evidence = server.go_on()
    assert evidence is not None
    assert evidence.is_confirmed
    assert [one.common_name for one in evidence.ended] == [name]
    assert server.record.authority.membership().queued_names == ()
    assert server.go_on() is None


def test_stopped_server_has_no_sessions_only_if_that_is_certain(server: Server) -> None:
    (one, other), (client, _) = connected(server, 2)
    server.stop()
    try:
        server.put("/run/no-systemd", "")
        server.record.revoke(one)
        evidence = server.go_on()
        assert evidence is not None
        assert (evidence.out, evidence.dead) == (True, False)
        assert evidence.notes == (
            (
                "no session is confirmed as ended: the server has no management socket, "
                "and it is unknown whether it is down"
            ),
        )
        server.at("/run/no-systemd").unlink()
        server.record.revoke(other)
        evidence = server.go_on()
        assert evidence is not None
        assert evidence.is_confirmed, evidence
        assert set(evidence.common_names) == {one, other}
        assert "the server is not running:" in " ".join(server.drift())
    finally:
        server.start()
    refused(server, client, "certificate revoked")


def test_revocation_works_after_server_restart(server: Server) -> None:
    (name,), (client,) = connected(server)
    assert name in server.names()
    server.stop()
    server.start()
    client.stop()
    client.start()
    evidence = server.throw_out(name)
    assert evidence.is_confirmed
    assert [one.common_name for one in evidence.ended] == [name]


def test_member_connecting_during_revocation_is_cut_off(server: Server) -> None:
    """At any moment of its handshake; one that has read the list of before finds no admission."""
    names = server.record.onboard(6)
    server.push()
    clients = [server.client(name) for name in names]
    for client, name in zip(clients, names, strict=True):
        client.start(wait=False)
        again = live.verify(server.link, server.throw_out(name))
        assert again.is_confirmed, again
        client.stop()


def test_both_certificates_of_a_member_are_revoked(server: Server) -> None:
    (name,), (old,) = connected(server)
    second = server.record.renew(name)
    server.push()
    new = server.client(second)
    new.start()
    assert {name, second} <= set(server.names())
    evidence = server.throw_out(name)
    assert evidence.is_confirmed
    assert {one.common_name for one in evidence.ended} == {name, second}
    for client in (old, new):
        refused(server, client, "certificate revoked")


def test_revocation_killed_half_way_is_finished_by_the_next_command(server: Server, made: Record) -> None:
    (name,), (client,) = connected(server)
    made.revoke(name)
    with LocalLink(NAME, server.enter) as link:
        (queued,) = made.authority.membership().queued_names
        assert queued == name
        evidence = live.finish_revocations(declaration(), made.authority, link)
    assert evidence is not None
    assert evidence.is_confirmed
    assert made.authority.membership().queued_names == ()
    assert client.ended() == 0


def test_manual_edits_are_reported_and_reverted_and_strangers_cut_off(server: Server) -> None:
    (name, other), (_, stranger) = connected(server, 2)
    address = server.record.address(name)
    server.put(f"{CCD}/{name}", f"ifconfig-push {address} 255.255.0.0\nping 9\n", 0o640)
    server.put(f"{CCD}/stranger", "ifconfig-push 10.80.0.99 255.255.0.0\n", 0o640)
    server.run("nft", "add", "element", "inet", "p_atlantis_vpn", "p_members", "{ 10.80.0.99 }")
    server.put(f"{FOLDER}/crl.pem", "no list\n")
    assert server.drift() == (
        f"{name}: its file on the server differs from the record ({CCD}/{name})",
        f"stranger must not be admitted, but the server has a file that admits it ({CCD}/stranger)",
        "the server has no readable revocation list: nobody can connect",
        "the loaded firewall differs from its file, for example after a change with nft",
    )
    pushed = server.push()
    assert set(pushed.changes) == {
        f"file {CCD}/{name}",
        f"file {FOLDER}/crl.pem",
        f"absent {CCD}/stranger",
        "firewall loaded",
    }
    assert server.drift() == ()
    server.put(f"{CCD}/visitor", "ifconfig-push 10.80.0.98 255.255.0.0\n", 0o640)
    server.at(f"{CCD}/visitor").rename(server.at(f"{CCD}/{other}"))
    assert server.push().ended_sessions == (), "who is admitted stays connected, whatever his file said"
    assert other in server.names()
    assert not stranger.log().count("Halt")


def test_concurrent_run_delays_a_push_but_no_revocation(server: Server) -> None:
    (name,), (client,) = connected(server)
    with server.at("/run/lock/atlantis-configure").open("r+") as busy, Echo(client) as echo:
        fcntl.flock(busy, fcntl.LOCK_EX)
        with pytest.raises(ServerRefusal, match="another run is active on this computer:"):
            server.push()
        echo.goes()
        evidence = server.throw_out(name)
        assert echo.answers() == 0
    assert evidence.is_confirmed
    assert "another run is active on this computer:" in evidence.notes[0]
    assert server.push().changes == ()


@pytest.mark.smoke
def test_unloadable_firewall_does_not_let_a_revoked_member_pass(server: Server) -> None:
    (name,), (client,) = connected(server)
    common_names, address = server.record.revoke(name), server.record.address(name)
    with Echo(client) as echo:
        echo.goes()
        told = server.link.ask(
            "revoke",
            place=dict(PLACE),
            files=[{"path": FIREWALL, "content": "no ruleset\n"}],
            common_names=list(common_names),
            addresses=[address],
        )
        assert echo.answers() == 0
    assert (told["out"], told["dead"]) == (False, True)
    assert told["left"] == [f"{FIREWALL} does not have the expected content"]
    assert "the firewall of the VPN could not be loaded and is unchanged (exit" in told["told"][0]
    assert server.at(FIREWALL).read_text() != "no ruleset\n"
    evidence = server.go_on()
    assert evidence is not None
    assert evidence.is_confirmed


def test_enabled_icmp_redirects_are_reported_and_disabled(server: Server) -> None:
    server.run("sysctl", "-qw", "net.ipv4.conf.all.send_redirects=1", "net.ipv4.conf.tun0.send_redirects=1")
    assert server.drift() == (
        "the server's kernel may send ICMP redirects, by all, tun0: members could bypass the server",
    )
    assert server.push().changes == ("ICMP redirects disabled",)
    assert server.drift() == ()
    assert server.push().changes == ()


def test_client_ignores_pushed_routes_not_in_the_inventory(server: Server) -> None:
    """By hand into the member's file on the server; the words of the client are those of both profiles."""
    (name,) = server.record.onboard()
    server.push()
    own = server.at(f"{CCD}/{name}").read_text()
    more = ("route 10.99.99.0 255.255.255.0", "redirect-gateway def1", "dhcp-option DNS 192.0.2.9")
    server.put(f"{CCD}/{name}", own + "".join(f'push "{line}"\n' for line in more), 0o640)
    lines = {}
    for template in ("openvpn/client.conf.j2", "handout/profile.ovpn.j2"):
        text = (template_folder() / template).read_text()
        lines[template] = tuple(line for line in text.splitlines() if line.startswith("pull-filter "))
    assert len(set(lines.values())) == 1
    for words, taken in (((), True), (lines["openvpn/client.conf.j2"], False)):
        client = server.client(name)
        client.become(server.record.identities[name], *words)
        client.start()
        routes = client.run("ip", "route")
        assert ("10.99.99.0/24" in routes, "0.0.0.0/1" in routes) == (taken, taken), routes
        assert "10.80.0.0/16 dev tun0" in routes
        client.stop()
    assert server.push().changes == (f"file {CCD}/{name}",)


def test_revocation_list_of_another_authority_is_refused(
    server: Server, tmp_path_factory: pytest.TempPathFactory
) -> None:
    foreign = record(tmp_path_factory.mktemp("other") / "vpn")
    foreign.onboard()
    before = server.at(f"{FOLDER}/crl.pem").read_bytes()
    with pytest.raises(ServerRefusal, match="another authority"):
        live.push(declaration(), foreign.authority, server.link)
    assert server.at(f"{FOLDER}/crl.pem").read_bytes() == before
    assert server.drift() == ()


@pytest.mark.smoke
def test_an_older_copy_of_the_authority_is_refused(server: Server, tmp_path_factory: pytest.TempPathFactory) -> None:
    copy = tmp_path_factory.mktemp("copy") / "vpn"
    shutil.copytree(server.record.authority.folder, copy)
    (name,), _ = connected(server)
    server.throw_out(name)
    with pytest.raises(ServerRefusal, match="but the server has number"):
        live.push(declaration(), type(server.record.authority).open(copy), server.link)
