import asyncio
import socket
import ssl
import struct
from contextlib import closing
from pathlib import Path
from types import SimpleNamespace

import pytest
from scripted_device import Device, Peer, serving

from atlantis_netcfg.core.secret import Secret
from atlantis_netcfg.routeros.api import (
    CertificateMismatch,
    CertificateUnknown,
    Endpoint,
    Session,
    Traffic,
    Unreachable,
)
from atlantis_netcfg.routeros.api._tls import (
    TlsTransport,
    certificate_bytes,
    client_context,
    cut_off,
    keep_alive,
    may_cut_off,
)

OTHER = "ab" * 32


async def hears_nothing(peer: Peer) -> None:
    assert await peer.gone() == b""


def test_close_without_a_connection_does_nothing() -> None:
    async def use() -> Traffic:
        traffic = Traffic()
        TlsTransport(asyncio.Protocol(), "device", traffic).close()
        return traffic

    assert asyncio.run(use()) == Traffic(), "nothing was sent"


def test_changed_certificate_is_refused_before_login(tmp_path: Path) -> None:
    async def use() -> tuple[CertificateMismatch, str]:
        async with serving(tmp_path, hears_nothing) as device:
            with pytest.raises(CertificateMismatch) as caught:
                await Session.open(device.endpoint(pin=OTHER))
            return caught.value, device.fingerprint

    error, seen = asyncio.run(use())
    assert (error.pinned_fingerprint, error.fingerprint) == (OTHER, seen)
    assert OTHER in str(error)
    assert seen in str(error)
    assert error.hint is not None
    assert "/certificate print detail" in error.hint
    assert "`provision device trust site=…`" in error.hint


def test_unpinned_certificate_is_reported_and_no_login_sent(tmp_path: Path) -> None:
    async def use() -> tuple[CertificateUnknown, str]:
        async with serving(tmp_path, hears_nothing) as device:
            with pytest.raises(CertificateUnknown) as caught:
                await Session.open(device.endpoint(pin=None))
            return caught.value, device.fingerprint

    error, seen = asyncio.run(use())
    assert error.fingerprint == seen
    assert "provision device trust" in str(error.hint)
    assert seen in str(error)
    assert error.hint is not None
    assert "/certificate print detail" in error.hint


@pytest.mark.parametrize("certificate", [None, b""])
def test_connection_without_a_peer_certificate_is_unreachable(certificate: bytes | None) -> None:
    class NoCertificate(asyncio.BaseTransport):
        def get_extra_info(self, name: str, default: object = None) -> object:
            del name, default
            return SimpleNamespace(getpeercert=lambda *, binary_form: certificate if binary_form else {})

    with pytest.raises(Unreachable, match="showed no certificate"):
        certificate_bytes(Endpoint("192.0.2.1", 8729, "admin", Secret("x"), None), NoCertificate())


def test_a_pin_may_be_written_with_colons_and_capitals(tmp_path: Path) -> None:
    async def script(peer: Peer) -> None:
        await peer.log_in()
        await peer.gone()

    async def use() -> tuple[str, str]:
        async with serving(tmp_path, script) as device:
            pin = ":".join(device.fingerprint[at : at + 2] for at in range(0, 64, 2)).upper()
            async with await Session.open(device.endpoint(pin=pin)) as session:
                return session.certificate, device.fingerprint

    certificate, fingerprint = asyncio.run(use())
    assert certificate == fingerprint


def test_context_requires_tls_1_2_and_a_certificate_but_no_chain() -> None:
    context = client_context()
    assert context.minimum_version == ssl.TLSVersion.TLSv1_2
    assert context.verify_mode == ssl.CERT_NONE
    assert not [cipher["name"] for cipher in context.get_ciphers() if cipher["auth"] == "auth-null"]


def test_anonymous_tls_is_refused(tmp_path: Path) -> None:
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.maximum_version = ssl.TLSVersion.TLSv1_2
    context.set_ciphers("ADH-AES256-GCM-SHA384:@SECLEVEL=0")

    async def use() -> Unreachable:
        async with serving(tmp_path, hears_nothing, context=context) as device:
            with pytest.raises(Unreachable) as caught:
                await Session.open(device.endpoint())
            return caught.value

    error = asyncio.run(use())
    assert "answered, but not with TLS and a certificate" in str(error)
    assert error.hint == "api-ssl needs a certificate:  /ip service set api-ssl certificate=NAME disabled=no"


def test_non_tls_service_is_reported_as_such() -> None:
    def connected(_reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        writer.write(b"SSH-2.0-ROSSSH\r\n")
        writer.close()

    async def use() -> str:
        server = await asyncio.start_server(connected, "127.0.0.1", 0)
        async with server:
            with pytest.raises(Unreachable) as caught:
                await Session.open(Device(server.sockets[0].getsockname()[1], OTHER).endpoint())
        return str(caught.value)

    assert "answered, but not with TLS" in asyncio.run(use())


def test_refused_connection_is_unreachable() -> None:
    with pytest.raises(Unreachable) as caught:
        asyncio.run(Session.open(Device(1, OTHER).endpoint()))
    assert str(caught.value) == "127.0.0.1:1 cannot be reached: Connection refused"


def test_unresolvable_name_is_unreachable() -> None:
    endpoint = Endpoint(f"{'x' * 70}.invalid", 8729, "provision", Secret("x"), OTHER)
    with pytest.raises(Unreachable, match="cannot be reached"):
        asyncio.run(Session.open(endpoint))


def test_handshake_times_out() -> None:
    with closing(socket.create_server(("127.0.0.1", 0))) as silent:
        endpoint = Device(silent.getsockname()[1], OTHER).endpoint(connect_timeout_s=0.1)
        with pytest.raises(Unreachable, match=r"did not answer within 0\.1 s$"):
            asyncio.run(Session.open(endpoint))


def test_ipv6_addresses_are_shown_in_brackets() -> None:
    assert str(Endpoint("fe80::1", 8729, "provision", Secret("x"), None)) == "[fe80::1]:8729"


class _Connected(asyncio.Transport):
    def __init__(self, end: socket.socket) -> None:
        super().__init__({"socket": end})


@pytest.mark.parametrize("dead", [False, True])
def test_cut_connection_receives_and_acknowledges_nothing(dead: bool) -> None:  # noqa: FBT001
    with socket.create_server(("127.0.0.1", 0)) as server, socket.create_connection(server.getsockname()) as ours:
        device, _ = server.accept()
        with device:
            keep_alive(_Connected(ours))
            if dead and not may_cut_off():
                with pytest.raises(PermissionError):
                    cut_off(_Connected(ours))
                return
            if dead:
                cut_off(_Connected(ours))
            # On loopback a segment has been taken or dropped by the time that `send` returns.
            device.send(b"still there?")
            if dead:
                with pytest.raises(BlockingIOError):
                    ours.recv(100, socket.MSG_DONTWAIT)
                assert ours.getsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE) == 0
                (unacknowledged,) = struct.unpack_from(
                    "I", device.getsockopt(socket.IPPROTO_TCP, socket.TCP_INFO, 104), 24
                )
                assert unacknowledged > 0
            else:
                assert ours.recv(100, socket.MSG_DONTWAIT) == b"still there?"
