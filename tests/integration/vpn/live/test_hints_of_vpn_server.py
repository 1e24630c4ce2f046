"""What is advised where the server of the VPN answers otherwise than it should is typed, and helps."""

import shutil
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path

import live_stand
import pytest
from hints_said import advised, said
from live_stand import NAME, Record, Server
from local_link import LocalLink
from test_hints_of_vpn import LAPTOP, Laptop, prepared, real
from vpn_desk import PASSPHRASE

from atlantis_netcfg.ansible_collections.atlantis.netcfg.plugins.module_utils import vpn_serve
from atlantis_netcfg.core.secret import Secret
from atlantis_netcfg.operations.computers.remote_session import SshLink
from atlantis_netcfg.operations.vpn import live
from atlantis_netcfg.operations.vpn import server as connected
from atlantis_netcfg.vpn.authority.authority import Authority
from atlantis_netcfg.vpn.server import CCD, FOLDER

pytestmark = [pytest.mark.slow, pytest.mark.namespace]


@pytest.fixture
def laptop(
    tmp_path: Path,
    tmp_path_factory: pytest.TempPathFactory,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> Laptop:
    """As beside the authority alone, with a way to the server."""
    return prepared(tmp_path, tmp_path_factory.getbasetemp(), capsys, monkeypatch)


@pytest.fixture
def server(laptop: Laptop) -> Iterator[Server]:
    with ExitStack() as stack:
        made = Server(stack, Record(Authority.open(laptop.folder / "vpn")))
        made.push()
        made.start()
        reached(laptop, made)
        yield made


def reached(at: Laptop, server: Server) -> None:
    at.monkeypatch.setattr(connected, "over_ssh", lambda *_: lambda: LocalLink(NAME, server.enter))


def nobody_answers(*_: object) -> Callable[[], SshLink]:
    access = {"host": "127.0.0.1", "port": 1, "user": "root", "become": False, "ssh_args": "-F none"}
    return lambda: SshLink(NAME, access)


def away(at: Laptop, _server: Server) -> str:
    """Nobody answers at its address."""
    at.monkeypatch.setattr(connected, "over_ssh", nobody_answers)
    return at.type(*LAPTOP, code=5)


def lost(at: Laptop, server: Server) -> str:
    """The connection ends between question and answer."""
    server.put("/usr/local/sbin/python3", f"#!/bin/sh\nprintf '{vpn_serve.MARK}hello\\n'\nread x\n", 0o755)
    try:
        return at.type(*LAPTOP, code=5)
    finally:
        server.at("/usr/local/sbin/python3").unlink()


def changed_by_hand(at: Laptop, server: Server) -> str:
    at.type(*LAPTOP)
    server.put(f"{CCD}/iqua-laptop", "ifconfig-push 10.80.17.9 255.255.0.0\n")
    return at.type("vpn", "status", code=6)


def revoked_meanwhile(at: Laptop, server: Server) -> str:
    """It was recorded while the server was away."""
    at.type(*LAPTOP)
    at.monkeypatch.setattr(connected, "over_ssh", nobody_answers)
    at.type("vpn", "revoke", "name=iqua-laptop", "--yes", code=5)
    printed = at.type("vpn", "status", code=6)
    reached(at, server)
    return printed


def connected_and_put_out(at: Laptop, server: Server) -> str:
    """It was recorded while the server was away, and nobody has told the server when it is looked at."""
    at.monkeypatch.setattr(live_stand, "_PASSPHRASE", Secret(PASSPHRASE))
    (name,) = server.record.onboard()
    server.push()
    client = server.client(name)
    client.start()
    server.record.revoke(name)
    with at.monkeypatch.context() as patch:
        patch.setattr(live, "finish_revocations", lambda *_: None)
        printed = at.type("vpn", "status", code=6)
    assert server.names() == [name]
    return printed


def not_dead(at: Laptop, _server: Server) -> str:
    """The server does not say that they are gone."""
    at.type(*LAPTOP)
    with at.monkeypatch.context() as patch:
        patch.setattr(live.RevocationEvidence, "is_confirmed", property(lambda _: False))
        return at.type("vpn", "revoke", "name=iqua-laptop", "--yes", code=5)


def never_set_up(at: Laptop, server: Server) -> str:
    server.at(f"{FOLDER}/ca.crt").unlink()
    return at.type("vpn", "sync", code=4)


def of_another_authority(at: Laptop, server: Server) -> str:
    shutil.rmtree(at.folder / "vpn")
    assert server.lives
    at.type("vpn", "init")
    return at.type("vpn", "sync", code=4)


def by_an_older_copy(at: Laptop, _server: Server) -> str:
    """Somebody was put out with the newest copy, and one of before is put back."""
    at.type(*LAPTOP)
    shutil.copytree(at.folder / "vpn", at.folder / "backup")
    at.type("vpn", "revoke", "name=iqua-laptop", "--yes")
    shutil.rmtree(at.folder / "vpn")
    (at.folder / "backup").rename(at.folder / "vpn")
    return at.type("vpn", "sync", code=4)


SITUATIONS: dict[str, tuple[Callable[[Laptop, Server], str], str, str]] = {
    "away": (
        away,
        "check its power and your connection to it; recorded changes are pending, and `provision vpn sync` continues",
        "",
    ),
    "away, and recorded": (
        away,
        "everything is recorded; to update the server: `provision vpn sync`",
        "iqua-laptop",
    ),
    "lost": (lost, "the request may have been completed: `provision vpn sync` checks and continues", ""),
    "changed by hand": (
        changed_by_hand,
        "`provision vpn sync` updates the server from the record",
        "on the server",
    ),
    "revoked meanwhile": (revoked_meanwhile, "run `provision vpn sync` when the server is reachable", "verified"),
    "connected and put out": (connected_and_put_out, "`provision vpn sync` ends its session", "verified"),
    "not dead": (not_dead, "`provision vpn sync` tries again and checks", "verified"),
    "an older copy": (
        by_an_older_copy,
        (
            "use the newest copy of the authority with `authority=FOLDER`; with this one nothing was signed or "
            "sent. If that copy is lost: `provision vpn sync --sign --take-list`"
        ),
        "imported from the server's list: iqua-laptop",
    ),
    "never set up": (
        never_set_up,
        "`provision site=…` does that; then run the same command again",
        "no differences from the inventory",
    ),
    "of another authority": (
        of_another_authority,
        "the server was set up by another authority: `provision site=…` installs this one",
        "no differences from the inventory",
    ),
}


@pytest.mark.smoke("away")
@pytest.mark.parametrize("name", SITUATIONS)
def test_recommended_command_works_when_typed(name: str, laptop: Laptop, server: Server) -> None:
    brings, hint, says = SITUATIONS[name]
    printed = brings(laptop, server)
    reached(laptop, server)
    (words,) = advised(said(printed, hint))
    assert says in laptop.type(*words)
    if words[:2] == ["vpn", "sync"]:
        assert "PASS" in laptop.type("vpn", "status")
        assert (
            live.drift(
                live.observe(server.link), live.desired_files(real(), laptop.authority), laptop.authority.membership()
            )
            == ()
        )
        assert server.names() == []
    else:
        assert words == ["site=scc"]
        assert any(NAME in hosts for hosts, _ in laptop.plays)
