"""The VPN's commands with a real server: onboarded, connected, renewed, seen, revoked, dead."""

import shutil
from collections.abc import Iterator
from contextlib import ExitStack
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import pyrage
import pytest
from live_stand import LOG, NAME, Client, Record, Server
from local_link import LocalLink
from vpn_desk import PASSPHRASE, Desk, onboarding, over_a_pipe, seated
from waiting import wait_until

from atlantis_netcfg.cli import main
from atlantis_netcfg.cli.vpn import _common
from atlantis_netcfg.core.paths import checkout
from atlantis_netcfg.core.secret import Secret
from atlantis_netcfg.operations.guests import members_of
from atlantis_netcfg.operations.vpn import server as connected
from atlantis_netcfg.vpn.authority.authority import Authority
from atlantis_netcfg.vpn.enrolment_package import open_package
from atlantis_netcfg.vpn.enrolment_package.profile import read_identity
from atlantis_netcfg.vpn.server import FOLDER

pytestmark = [pytest.mark.slow, pytest.mark.namespace]

_MEMBER, _GUEST = "iqua-sparus2", "udg-lauv"
LAUV = ("name=lauv", "title=LAUV", "partner=udg", "kind=auv", "site=coastal", "cells=gps,wifi")
READ = _common.load_inventory
"""Before anything stands in its place."""
NAT = """\
table ip nat {
  chain forwarded {
    type nat hook prerouting priority -100
    ip daddr 203.0.113.2 dnat to 10.64.0.10
  }
}
"""
"""What the router of the server's site does with its public port."""


@pytest.fixture
def desk(
    tmp_path: Path,
    tmp_path_factory: pytest.TempPathFactory,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> Desk:
    return seated(tmp_path_factory.getbasetemp(), tmp_path, capsys, monkeypatch)


@pytest.fixture
def server(desk: Desk, monkeypatch: pytest.MonkeyPatch) -> Iterator[Server]:
    """Set up from the authority's folder, and asked by the commands as if it stood behind SSH."""
    with ExitStack() as stack:
        made = Server(stack, Record(Authority.open(desk.authority)))
        made.push()
        made.start()
        made.run("nft", "-f", "-", text=NAT)
        monkeypatch.setattr(connected, "over_ssh", lambda *_: lambda: LocalLink(NAME, made.enter))
        yield made


KEY = pyrage.x25519.Identity.generate()
"""Of the partner; with a key no second is lost to a passphrase."""
SEALED = (*onboarding("iqua", "sparus2", "robot")[:-1], f"recipient={KEY.to_public()}")


def opened(row: dict[str, Any]) -> str:
    """The profile, as the partner gets it: with the passphrase that was told by telephone, or with a key."""
    data = Path(row["copy"] or row["file"]).read_bytes()
    return open_package(data, Secret(row["passphrase"] or str(KEY)))[f"{_MEMBER}.ovpn"]


def use(client: Client, profile: str) -> None:
    """Start OpenVPN with the handed-out file as it is; where its log goes is all that is added."""
    client.run("ip", "route", "replace", "203.0.113.2/32", "via", "10.99.1.1")
    client.put("/etc/openvpn/client.conf", f"{profile}\nlog-append {LOG}\ndisable-dco\nverb 3\n", 0o600)
    client.start()


def told(found: dict[str, Any], verdict: str) -> str:
    return "\n".join(one["message"] for one in found["told"] if one["verdict"] == verdict)


@pytest.mark.smoke
def test_the_whole_life_of_a_member(desk: Desk, server: Server, tmp_path: Path) -> None:
    (tmp_path / "stick").mkdir()
    words = [*onboarding("iqua", "sparus2", "robot")[:-1], f"to={tmp_path / 'stick'}"]
    first = desk.told(*words, passphrase=PASSPHRASE)
    (row,) = first["members"]
    assert (first["deployed"], row["copy"]) == (True, f"{tmp_path / 'stick'}/{_MEMBER}.tar.age")
    again = desk.told(*words)
    assert (again["changes"], again["members"][0]["already"]) == ([], True)

    client = Client(server.stack, server, read_identity(opened(row)))
    use(client, opened(row))
    found = desk.told("status")
    assert (told(found, "FAIL"), told(found, "INCONCLUSIVE")) == ("", "")
    assert [one["common_name"] for one in found["server"]["sessions"]] == [_MEMBER]
    assert desk.told("show", f"name={_MEMBER}")["member"]["standing"] == "in use"

    (renewed,) = desk.told("renew", f"name={_MEMBER}", SEALED[-1], passphrase=PASSPHRASE)["members"]
    assert (renewed["common_name"], server.names()) == (f"{_MEMBER}.2", [_MEMBER])
    client.stop()
    use(client, opened(renewed))
    assert "is retired" in told(desk.told("status"), "PASS")
    certificates = desk.told("show", f"name={_MEMBER}")["member"]["certificates"]
    assert [one["standing"] for one in certificates] == ["superseded", "seen"]

    code, out, _ = desk.type("revoke", f"name={_MEMBER}", "reason=stolen", "--yes", passphrase=PASSPHRASE)
    assert (code, "verified: no session, and none of their traffic passes" in out) == (0, True), out
    assert client.ended() == 0
    wait_until(lambda: server.names() == [], lambda: "there still is a session")
    assert desk.told("revoke", f"name={_MEMBER}", "--yes", passphrase=PASSPHRASE)["already"] == [_MEMBER]
    assert desk.told("sync")["changes"] == []

    words_of_all = [one["words"] for one in desk.told("audit", "partner=iqua")["entries"]]
    for part in ("issued: robot of partner iqua", "handed out", f"{_MEMBER}.2 issued", "stolen"):
        assert any(part in one for one in words_of_all), (part, words_of_all)


def test_guest_connects_is_ended_and_leaves_no_trace(
    desk: Desk, server: Server, monkeypatch: pytest.MonkeyPatch
) -> None:
    shutil.copytree(checkout() / "inventory", desk.folder / "inventory")
    before = desk.files()
    monkeypatch.setattr(_common, "load_inventory", READ)
    day = datetime.now(UTC).date() + timedelta(days=20)
    typed(desk, "robot", "invite", *LAUV, f"until={day}", SEALED[-1])
    (sealed,) = desk.authority.glob("handouts/*/*.age")
    profile = open_package(sealed.read_bytes(), Secret(str(KEY)))[f"{_GUEST}.ovpn"]
    client = Client(server.stack, server, read_identity(profile))
    use(client, profile)
    assert server.names() == [_GUEST]
    (member,) = members_of(Authority.open(desk.authority), "lauv")
    assert str(member.address) in server.run("nft", "list", "ruleset")

    out = typed(desk, "robot", "dismiss", "name=lauv", "--yes")
    assert "verified: no session, and none of their traffic passes" in out
    assert "lauv: ended; not in the inventory, no valid certificate, no file left here" in out
    assert client.ended() == 0
    refused = "certificate revoked"
    count = server.log().count(refused)
    client.start(wait=False)
    server.said(refused, count + 1)
    assert (client.up, server.names()) == (False, [])
    client.stop()
    assert str(member.address) not in server.run("nft", "list", "ruleset")
    assert [path.name for path in server.at(f"{FOLDER}/ccd").iterdir() if _GUEST in path.name] == []
    assert {name for name in before if name.startswith("inventory/")} == {
        name for name, data in desk.files().items() if name.startswith("inventory/") and before[name] == data
    }
    assert list(desk.authority.glob("handouts/*")) == []
    assert (desk.told("sync")["changes"], desk.told("status")["queued"]) == ([], [])


def typed(desk: Desk, *words: str) -> str:
    """Type a command about the guest, which has to end well; what it prints."""
    line = [*words, f"inventory={desk.folder / 'inventory'}", f"authority={desk.authority}"]
    with over_a_pipe(PASSPHRASE) as number:
        code = main([*line, "--passphrase-fd", number])
    printed = desk.capsys.readouterr()
    assert code == 0, printed.out + printed.err
    return printed.out


def test_unreachable_server_delays_changes_but_loses_none(
    desk: Desk, server: Server, monkeypatch: pytest.MonkeyPatch
) -> None:
    there = connected.over_ssh
    monkeypatch.setattr(connected, "over_ssh", lambda *_: lambda: LocalLink(NAME, ("false",)))
    waits = desk.told(*SEALED, passphrase=PASSPHRASE, code=5)
    (row,) = waits["members"]
    assert (waits["deployed"], row["passphrase"]) == (False, None)
    assert f"`provision vpn sync authority={desk.authority}`" in waits["errors"][0]["hint"]
    assert told(desk.told("status", code=5), "INCONCLUSIVE").startswith("the server: ")

    monkeypatch.setattr(connected, "over_ssh", there)
    assert desk.told("sync")["deployed"]
    client = Client(server.stack, server, read_identity(opened(row)))
    use(client, opened(row))

    monkeypatch.setattr(connected, "over_ssh", lambda *_: lambda: LocalLink(NAME, ("false",)))
    cut = desk.told("revoke", "partner=iqua", "--yes", passphrase=PASSPHRASE, code=5)
    assert "open sessions may continue" in cut["errors"][0]["message"]
    assert desk.told("status", "--no-push", code=6)["queued"] == [_MEMBER]
    assert server.names() == [_MEMBER]

    monkeypatch.setattr(connected, "over_ssh", there)
    assert desk.told("sync")["queue"]["confirmed"]
    assert client.ended() == 0
    assert desk.told("status")["queued"] == []


def test_manual_change_on_server_is_reported_and_fixed_only_by_sync(desk: Desk, server: Server) -> None:
    desk.told(*SEALED, passphrase=PASSPHRASE)
    server.put(f"/etc/openvpn/atlantis/ccd/{_MEMBER}", "ifconfig-push 10.80.17.9 255.255.0.0\n")
    for _ in range(2):
        assert "its file on the server differs from the record" in told(desk.told("status", code=6), "FAIL")
    assert desk.told("sync")["changes"] != []
    assert told(desk.told("status"), "FAIL") == ""
