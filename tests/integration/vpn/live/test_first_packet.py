"""The first packet of a session, sent to the pilot's own server: it answers, and nobody else is believed."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import live_stand
import pytest
from live_stand import Record, Server, record, server_of
from test_vpn_shared_key import declare
from waiting import HANG_S

from atlantis_netcfg.operations.allow_list_test.plan import VPN_BYTES
from atlantis_netcfg.operations.allow_list_test.vpn import _QUESTIONS
from atlantis_netcfg.vpn import pki
from atlantis_netcfg.vpn.identity import Wrap
from atlantis_netcfg.vpn.pki.keys import FirstPacket

pytestmark = [pytest.mark.namespace, pytest.mark.slow]
_HEADERS = 28
_MORE_OF_A_NAME = 48
"""The longest name of a member; it is in its key."""


@contextmanager
def standing(folder: Path, wrap: Wrap) -> Iterator[tuple[Record, Server, str]]:
    """The server, with one member that has a tunnel of its own up."""
    made = record(folder / "vpn")
    (name,) = made.onboard(wrap=wrap)
    with server_of(made) as server:
        server.client(name).start()
        yield made, server, name


def first_answer(server: Server, *sent: bytes) -> bytes:
    """What comes first when these are sent, one after the other, in the server's own network."""
    asking = server.udp()
    asking.settimeout(HANG_S)
    with asking:
        asking.connect((str(live_stand._server_addresses()[0]), live_stand.declaration().pilot.vpn.port))
        for datagram in sent:
            asking.send(datagram)
        return asking.recv(2048)


def changed(datagram: bytes, place: int) -> bytes:
    return datagram[:place] + bytes([datagram[place] ^ 1]) + datagram[place + 1 :]


@pytest.mark.parametrize("wrap", list(Wrap))
@pytest.mark.parametrize("cookie", [False, True])
def test_server_answers_first_packet_without_disturbing_the_tunnel(
    wrap: Wrap,
    cookie: bool,  # noqa: FBT001 - a case
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    declare(monkeypatch, force_cookie=cookie)
    with standing(tmp_path, wrap) as (made, server, name):
        packet = FirstPacket(made.identities[name].wrap_key)
        answer = first_answer(server, packet.datagram())
        assert packet.is_answer(answer)
        assert server.names() == [name]
        whole = len(packet.datagram()) + len(answer) + 2 * _HEADERS + _MORE_OF_A_NAME
        assert whole <= VPN_BYTES / _QUESTIONS
    # Neither another session, nor a changed or a cut datagram, nor another key.
    assert not FirstPacket(packet.wrap_key).is_answer(answer)
    assert not any(packet.is_answer(changed(answer, place)) for place in range(len(answer)))
    assert not any(packet.is_answer(answer[:length]) for length in range(len(answer)))
    other = pki.shared_key() if wrap is Wrap.TLS_CRYPT else pki.client_key(pki.server_key(), b"cn=other")
    assert not FirstPacket(other, packet.session).is_answer(answer)


def test_server_does_not_answer_an_unknown_key(tmp_path: Path) -> None:
    with standing(tmp_path, Wrap.TLS_CRYPT_V2) as (made, server, name):
        other = pki.client_key(pki.server_key(), b"cn=other")
        strangers = [FirstPacket(key) for key in (pki.shared_key(), other)]
        member = FirstPacket(made.identities[name].wrap_key, os.urandom(8))
        answer = first_answer(server, *(packet.datagram() for packet in (*strangers, member)))
        assert [packet.is_answer(answer) for packet in (*strangers, member)] == [False, False, True]
        assert server.names() == [name]
