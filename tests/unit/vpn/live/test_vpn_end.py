"""How a session is ended: told, unheard, silent, killed; a server that would fall over it is never asked to kill."""

from __future__ import annotations

from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, cast

import pytest

from atlantis_netcfg.ansible_collections.atlantis.netcfg.plugins.module_utils import vpn_disconnect
from atlantis_netcfg.ansible_collections.atlantis.netcfg.plugins.module_utils.programs import ProgramResult
from atlantis_netcfg.ansible_collections.atlantis.netcfg.plugins.module_utils.vpn_disconnect import (
    ClientBlock,
    SessionTermination,
    peer,
)
from atlantis_netcfg.ansible_collections.atlantis.netcfg.plugins.module_utils.vpn_management import (
    ConnectionEnd,
    ManagementBusy,
    ServerDown,
)

if TYPE_CHECKING:
    from collections.abc import Iterator

    from atlantis_netcfg.ansible_collections.atlantis.netcfg.plugins.module_utils.vpn_server import ManagedServer

REAL = "192.0.2.7:40000"


@dataclass
class OpenVpn:
    """A server with sessions, and what was done to it, in order."""

    sessions_there: list[dict[str, Any]] = field(default_factory=list)
    chatty: bool = False
    """Packets come although nothing should."""
    returns: int = 0
    """So often somebody comes back right after he was killed."""
    nft: int = 0
    asking: type[Exception] | None = None
    acts: list[str] = field(default_factory=list)

    @contextmanager
    def connection(self, _patience_s: float | None = None) -> Iterator[OpenVpn]:
        if self.asking is not None:
            raise self.asking("silent")
        yield self

    def sessions(self) -> list[dict[str, Any]]:
        for one in self.sessions_there:
            one["received"] += self.chatty
        return [dict(one) for one in self.sessions_there]

    def halt(self, cid: int) -> str:
        self.acts.append(f"halt {cid}")
        return "SUCCESS: halted"

    def kill(self, real: str) -> str:
        self.acts.append(f"kill {real}")
        gone = next(one for one in self.sessions_there if one["real"] == real)
        self.sessions_there.remove(gone)
        if self.returns:
            self.returns -= 1
            self.sessions_there.append(session(gone["cid"] + 1, gone["common_name"], REAL))
        return "SUCCESS: killed"

    def run(self, words: list[str]) -> ProgramResult:
        if words[1].startswith("delete"):
            self.acts.append("heard again")
        else:
            rules = [line for line in words[1].splitlines() if line.startswith("ip saddr")]
            self.acts.append("unheard: " + "; ".join(rules))
        return ProgramResult(self.nft, "Error: no such thing" if self.nft else "")


def session(cid: int, name: str, real: str = REAL, virtual: str = "10.80.17.1") -> dict[str, Any]:
    return {"cid": cid, "common_name": name, "real": real, "virtual": virtual, "since": 0, "received": 9, "sent": 9}


def end(server: OpenVpn, *addresses: str) -> SessionTermination:
    ending = SessionTermination(["iqua-d0"], addresses)
    ending.run(
        cast("ManagedServer", server),
        ClientBlock(cast("ManagedServer", server), ()),
        lambda: server.acts.append("meanwhile"),
    )
    return ending


UNHEARD = "unheard: ip saddr 192.0.2.7 meta l4proto { tcp, udp } th sport 40000 drop"


def test_sessions_are_ended_in_the_right_order() -> None:
    server = OpenVpn([session(7, "iqua-d0"), session(8, "vtt-d0", "192.0.2.8:1", "10.80.20.1")])
    ending = end(server)
    assert server.acts == ["halt 7", "meanwhile", UNHEARD, f"kill {REAL}", "heard again"]
    assert (ending.management, ending.left, ending.messages) == ("answers", [], [])
    assert [one["replies"] for one in ending.ended] == [["SUCCESS: halted", "SUCCESS: killed"]]
    assert [one["common_name"] for one in server.sessions_there] == ["vtt-d0"]


def test_existing_block_is_not_repeated() -> None:
    server = OpenVpn([session(7, "iqua-d0")])
    ending = SessionTermination(["iqua-d0"])
    unheard = ClientBlock(cast("ManagedServer", server), ending.look(cast("ManagedServer", server)))
    assert "ip saddr 192.0.2.7 meta l4proto { tcp, udp } th sport 40000 drop" in unheard.text
    unheard.holds = True
    ending.run(cast("ManagedServer", server), unheard)
    assert server.acts == ["halt 7", f"kill {REAL}", "heard again"]
    assert ClientBlock(cast("ManagedServer", server), ()).text == ""


def test_session_is_ended_by_address_regardless_of_name() -> None:
    server = OpenVpn([session(7, "another", virtual="10.80.17.9")])
    assert [one["cid"] for one in end(server, "10.80.17.9").ended] == [7]


def test_returning_client_is_ended_again_a_limited_number_of_times() -> None:
    assert end(OpenVpn([session(7, "iqua-d0")], returns=2)).left == []
    server = OpenVpn([session(7, "iqua-d0")], returns=99)
    assert [one["cid"] for one in end(server).left] == [7 + vpn_disconnect._ROUNDS]


@pytest.mark.parametrize(
    ("server", "told"),
    [
        (OpenVpn([session(7, "iqua-d0")], chatty=True), []),
        (
            OpenVpn([session(7, "iqua-d0")], nft=1),
            ["their packets are not blocked: nft: Error: no such thing"] * vpn_disconnect._ROUNDS,
        ),
        (OpenVpn([session(7, "iqua-d0", "[2001:db8::7]:40000")]), []),
    ],
    ids=["heard", "no nft", "IPv6"],
)
def test_client_that_still_sends_is_not_killed(
    server: OpenVpn, told: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """OpenVPN would end for everybody."""
    monkeypatch.setattr(vpn_disconnect, "_QUIET_S", 0)
    ending = end(server)
    assert not [act for act in server.acts if act.startswith("kill")]
    assert "halt 7" in server.acts
    assert [one["cid"] for one in ending.left] == [7]
    assert ending.messages == told


@pytest.mark.parametrize(("asking", "does"), [(ManagementBusy, "held"), (ConnectionEnd, "held"), (ServerDown, "down")])
def test_meanwhile_action_runs_in_any_case(asking: type[Exception], does: str) -> None:
    server = OpenVpn(asking=asking)
    ending = end(server)
    assert (ending.management, server.acts) == (does, ["meanwhile"])
    assert len(ending.messages) == (does == "held")
    nobody = OpenVpn()
    assert end(nobody).management == "answers"
    assert nobody.acts == ["meanwhile"]


@pytest.mark.parametrize(
    ("real", "told"),
    [
        (REAL, ("192.0.2.7", 40000)),
        ("udp4:192.0.2.7:40000", ("192.0.2.7", 40000)),
        ("192.0.2.700:1", None),
        ("[2001:db8::7]:1", None),
        ("192.0.2.7:1 accept\n", None),
        ("", None),
    ],
)
def test_peer_is_parsed_into_address_and_port(real: str, told: tuple[str, int] | None) -> None:
    assert peer(real) == told
