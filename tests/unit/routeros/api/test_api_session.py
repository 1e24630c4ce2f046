import asyncio
import hashlib
import socket
from collections.abc import Awaitable, Callable
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeVar

import pytest
from scripted_device import PASSWORD, Device, Peer, frame, serving

from atlantis_netcfg.core.errors import DeviceError, ExitCode
from atlantis_netcfg.routeros import api
from atlantis_netcfg.routeros.api import (
    WINDOW,
    Command,
    CommandError,
    LoginError,
    ProtocolError,
    Reply,
    Session,
    SessionLost,
    Traffic,
    Trap,
)

T = TypeVar("T")
PRINT = Command("/ip/address/print")
INSPECT = Command("/console/inspect")
TO_LOG_IN = 3
"""Round trips of TCP's handshake, of that of TLS 1.3, and of the login."""


def talk(
    folder: Path,
    script: Callable[[Peer], Awaitable[None]],
    use: Callable[[Session], Awaitable[T]],
    **knobs: Any,  # noqa: ANN401 - those of Device.endpoint
) -> T:
    """Log in to a device that then does as the script says, and return what `use` of the session gives."""

    async def logged_in(peer: Peer) -> None:
        await peer.log_in()
        await script(peer)

    async def both() -> T:
        async with serving(folder, logged_in) as device, await Session.open(device.endpoint(**knobs)) as session:
            return await use(session)

    return asyncio.run(both())


def lost(folder: Path, script: Callable[[Peer], Awaitable[None]], **knobs: Any) -> SessionLost:  # noqa: ANN401 - as talk
    """Return how a session ends when the device answers `/ip/address/print` as the script says."""

    async def use(session: Session) -> SessionLost:
        with pytest.raises(SessionLost) as caught:
            await session.flight([PRINT, PRINT])
        with pytest.raises(SessionLost) as again:
            await session.command(PRINT)
        assert not again.value.in_flight
        return caught.value

    return talk(folder, script, use, **knobs)


def opening(folder: Path, script: Callable[[Peer], Awaitable[None]], **knobs: Any) -> Exception:  # noqa: ANN401 - as talk
    """Return how the login ends."""

    async def both() -> Exception:
        async with serving(folder, script) as device:
            with pytest.raises(Exception) as caught:  # noqa: PT011 - the caller looks at it
                await Session.open(device.endpoint(**knobs))
            return caught.value

    return asyncio.run(both())


def test_the_login_is_one_tagged_sentence_and_one_round_trip(tmp_path: Path) -> None:
    seen: list[list[str]] = []

    async def script(peer: Peer) -> None:
        seen.append(await peer.log_in())
        await peer.gone()

    async def use() -> tuple[Traffic, str, str]:
        async with serving(tmp_path, script) as device, await Session.open(device.endpoint()) as session:
            return replace(session.traffic), session.certificate, device.fingerprint

    traffic, certificate, fingerprint = asyncio.run(use())
    sentence = ["/login", "=name=provision", f"=password={PASSWORD}", ".tag=1"]
    assert seen == [sentence]
    assert traffic.round_trips == TO_LOG_IN
    assert traffic.sent_bytes > len(frame(*sentence))
    assert traffic.received_bytes > len(frame("!done", ".tag=1"))
    assert certificate == fingerprint


def test_challenge_login_of_old_devices_works(tmp_path: Path) -> None:
    challenge = "ea64c0d0d6f9d3f5b4b2c3b1a1f0e0d1"
    seen: list[list[str]] = []

    async def script(peer: Peer) -> None:
        await peer.read()
        await peer.send(("!done", f"=ret={challenge}", ".tag=1"))
        seen.append(await peer.read())
        await peer.send(("!done", ".tag=2"))
        await peer.gone()

    async def use() -> int:
        async with serving(tmp_path, script) as device, await Session.open(device.endpoint()) as session:
            return session.traffic.round_trips

    assert asyncio.run(use()) == TO_LOG_IN + 1
    digest = hashlib.md5(b"\0" + PASSWORD.encode() + bytes.fromhex(challenge), usedforsecurity=False).hexdigest()
    assert seen == [["/login", "=name=provision", f"=response=00{digest}", ".tag=2"]]


def test_non_hexadecimal_challenge_is_a_protocol_error(tmp_path: Path) -> None:
    async def script(peer: Peer) -> None:
        await peer.read()
        await peer.send(("!done", "=ret=hello", ".tag=1"))
        await peer.gone()

    error = opening(tmp_path, script)
    assert isinstance(error, ProtocolError)
    assert "sent a login challenge that is no number" in str(error)


def test_wrong_password_is_reported_with_the_device_message_only(tmp_path: Path) -> None:
    async def script(peer: Peer) -> None:
        await peer.read()
        await peer.send(("!trap", "=message=invalid user name or password (6)", ".tag=1"), ("!done", ".tag=1"))
        await peer.gone()

    error = opening(tmp_path, script, password="not the horse")
    assert isinstance(error, LoginError)
    assert str(error).endswith("refused the login of `provision`: invalid user name or password (6)")
    assert "horse" not in f"{error!r} {error} {error.hint}"


def test_session_ended_by_the_device_during_login_is_lost(tmp_path: Path) -> None:
    async def script(peer: Peer) -> None:
        await peer.read()
        await peer.send(("!fatal", "too many sessions"))
        await peer.gone()

    error = opening(tmp_path, script)
    assert isinstance(error, SessionLost)
    assert not error.in_flight
    assert str(error).endswith("ended the session: too many sessions (during the login of `provision`)")


def test_replies_may_interleave_in_any_order(tmp_path: Path) -> None:
    async def script(peer: Peer) -> None:
        first, second, third = await peer.read_tags(3)
        await peer.send(
            ("!re", f".tag={third}", "=name=c"),
            ("!re", "=name=a", f".tag={first}"),
            ("!done", f".tag={third}"),
            ("!empty", f".tag={second}"),
            ("!re", f".tag={first}", "=name=aa"),
            ("!done", f".tag={second}"),
            ("!done", f".tag={first}", "=ret=*1"),
        )
        await peer.gone()

    replies = talk(tmp_path, script, lambda session: session.flight([PRINT, PRINT, PRINT]))
    path = PRINT.path
    assert replies == [
        Reply(({"name": "a"}, {"name": "aa"}), "*1", None, path),
        Reply((), None, None, path),
        Reply(({"name": "c"},), None, None, path),
    ]


def test_reply_may_arrive_byte_by_byte(tmp_path: Path) -> None:
    async def script(peer: Peer) -> None:
        (tag,) = await peer.read_tags(1)
        for byte in frame("!re", f".tag={tag}", "=comment=" + "x" * 200) + frame("!done", f".tag={tag}"):
            await peer.raw(bytes([byte]))
        await peer.gone()

    reply = talk(tmp_path, script, lambda session: session.command(PRINT))
    assert reply.rows == ({"comment": "x" * 200},)


def test_values_stay_strings(tmp_path: Path) -> None:
    sent = {"disabled": "true", "mtu": "1500", "code": "00", "on": "yes", "empty": "", "name": "\udcd2\udcca"}

    async def script(peer: Peer) -> None:
        (tag,) = await peer.read_tags(1)
        row = [f"={name}={value}".encode("utf-8", "surrogateescape") for name, value in sent.items()]
        await peer.send(("!re", *row, f".tag={tag}"), ("!done", f".tag={tag}"))
        await peer.gone()

    assert talk(tmp_path, script, lambda session: session.command(PRINT)).rows == (sent,)


def test_command_is_sent_verbatim(tmp_path: Path) -> None:
    seen: list[list[str]] = []

    async def script(peer: Peer) -> None:
        seen.append(await peer.read())
        await peer.send(("!done", seen[0][-1]))
        await peer.gone()

    command = Command("/ip/route/print", (("comment", "a=b\nc"), ("!gateway", "")), ("?dst-address=0.0.0.0/0", "?#!"))
    talk(tmp_path, script, lambda session: session.command(command))
    assert seen == [["/ip/route/print", "=comment=a=b\nc", "=!gateway=", "?dst-address=0.0.0.0/0", "?#!", ".tag=2"]]


def test_a_refused_command_does_not_stop_the_others(tmp_path: Path) -> None:
    async def script(peer: Peer) -> None:
        first, second = await peer.read_tags(2)
        await peer.send(
            ("!trap", "=category=1", "=message=invalid value for argument address", f".tag={first}"),
            ("!trap", "=message=another", f".tag={first}"),
            ("!done", f".tag={first}"),
            ("!done", "=ret=*7", f".tag={second}"),
        )
        await peer.gone()

    add = Command("/ip/address/add", (("address", "192.0.2.1/24"),))
    refused, done = talk(tmp_path, script, lambda session: session.flight([add, add]))
    assert refused.trap == Trap("invalid value for argument address", 1)
    assert done.check().ret == "*7"
    with pytest.raises(CommandError) as caught:
        refused.check()
    assert str(caught.value) == "the device refused /ip/address/add: invalid value for argument address"
    assert (caught.value.trap, caught.value.path) == (refused.trap, "/ip/address/add")


def test_an_interrupted_command_is_a_trap_of_category_2(tmp_path: Path) -> None:
    async def script(peer: Peer) -> None:
        (tag,) = await peer.read_tags(1)
        await peer.send(
            ("!re", "=name=a", f".tag={tag}"),
            ("!trap", "=category=2", "=message=interrupted", f".tag={tag}"),
            ("!done", f".tag={tag}"),
        )
        await peer.gone()

    reply = talk(tmp_path, script, lambda session: session.command(PRINT))
    assert (reply.trap, reply.rows) == (Trap("interrupted", 2), ({"name": "a"},))


@pytest.mark.parametrize(
    ("command", "batches"),
    [(PRINT, (60,)), (INSPECT, (24, 24, 12)), (Command("/ip/address/add"), (24, 24, 12))],
    ids=["print", "inspect", "add"],
)
def test_read_commands_use_a_larger_window(tmp_path: Path, command: Command, batches: tuple[int, ...]) -> None:
    async def script(peer: Peer) -> None:
        for count in batches:
            tags = await peer.read_tags(count)
            await peer.send(*(("!done", f"=ret={tag}", f".tag={tag}") for tag in reversed(tags)))
        await peer.gone()

    async def use(session: Session) -> tuple[list[str | None], int]:
        before = session.traffic.round_trips
        replies = await session.flight([command] * 60)
        return [reply.ret for reply in replies], session.traffic.round_trips - before

    rets, round_trips = talk(tmp_path, script, use)
    assert WINDOW == 24
    assert round_trips == len(batches)
    assert rets == [str(tag) for tag in range(2, 62)]


def test_hang_in_the_larger_window_retries_with_the_smaller_one(tmp_path: Path) -> None:
    sizes: list[int] = []

    async def script(peer: Peer) -> None:
        await peer.log_in()
        if not sizes:
            sizes.append(len(await peer.read_tags(60)))
            await peer.gone()
            return
        for count in (24, 24, 12):
            tags = await peer.read_tags(count)
            sizes.append(count)
            await peer.send(*(("!done", f".tag={tag}") for tag in tags))
        await peer.gone()

    async def use() -> tuple[int, int, int]:
        narrowed: list[bool] = []
        async with serving(tmp_path, script) as device:
            endpoint = replace(device.endpoint(reply_timeout_s=0.2), on_window_shrink=lambda: narrowed.append(True))
            async with await Session.open(endpoint) as session:
                replies = await session.flight([PRINT] * 60)
                return len(replies), len(narrowed), session.traffic.round_trips

    # Two handshakes and logins, and three batches that were answered.
    assert asyncio.run(use()) == (60, 1, 2 * TO_LOG_IN + 3)
    assert sizes == [60, 24, 24, 12]


def test_session_with_changes_is_not_replaced(tmp_path: Path) -> None:
    async def script(peer: Peer) -> None:
        await peer.log_in()
        (tag,) = await peer.read_tags(1)
        await peer.send(("!done", f".tag={tag}"))
        await peer.gone()

    async def use() -> int:
        narrowed: list[bool] = []
        async with serving(tmp_path, script) as device:
            endpoint = replace(device.endpoint(reply_timeout_s=0.2), on_window_shrink=lambda: narrowed.append(True))
            async with await Session.open(endpoint) as session:
                await session.command(Command("/safe-mode/take"))
                with pytest.raises(SessionLost, match=r"has not answered for 0\.2 s$"):
                    await session.flight([PRINT] * 60)
        return len(narrowed)

    assert asyncio.run(use()) == 0


def test_close_does_not_wait_for_the_device(tmp_path: Path) -> None:
    left = asyncio.Event()

    async def script(peer: Peer) -> None:
        await peer.log_in()
        await left.wait()
        assert await peer.reader.read() == b""

    async def use() -> None:
        async with serving(tmp_path, script) as device:
            session = await Session.open(device.endpoint())
            peers_turn = session.traffic.round_trips
            await session.close(wait=False)
            assert session.traffic.round_trips == peers_turn
            left.set()

    asyncio.run(use())


def test_concurrent_flights_take_turns(tmp_path: Path) -> None:
    async def script(peer: Peer) -> None:
        for _ in range(3):
            one, two = await peer.read_tags(2)
            assert int(two) == int(one) + 1
            await peer.send(("!done", f".tag={two}"), ("!done", f".tag={one}"))
        await peer.gone()

    async def use(session: Session) -> int:
        replies = await asyncio.gather(*(session.flight([PRINT, PRINT]) for _ in range(3)))
        return sum(map(len, replies))

    assert talk(tmp_path, script, use) == 6


def test_empty_flight_costs_no_round_trip(tmp_path: Path) -> None:
    async def script(peer: Peer) -> None:
        await peer.gone()

    async def use(session: Session) -> tuple[list[Reply], int]:
        return await session.flight([]), session.traffic.round_trips

    assert talk(tmp_path, script, use) == ([], TO_LOG_IN)


def test_fatal_reply_ends_the_session_with_its_message(tmp_path: Path) -> None:
    async def script(peer: Peer) -> None:
        first, _ = await peer.read_tags(2)
        await peer.send(("!done", f".tag={first}"), ("!fatal", "session terminated on request"))
        await peer.gone()

    error = lost(tmp_path, script)
    assert str(error).endswith("ended the session: session terminated on request")
    assert error.in_flight


def test_connection_closed_between_replies_is_a_lost_session(tmp_path: Path) -> None:
    async def script(peer: Peer) -> None:
        first, _ = await peer.read_tags(2)
        await peer.send(("!done", f".tag={first}"))
        peer.writer.close()

    error = lost(tmp_path, script)
    assert type(error) is SessionLost
    assert error.in_flight
    assert str(error).endswith("closed the connection")


GARBAGE = {
    "cut-off word": (b"\x05!do", "fell silent in the middle of an answer: the connection is lost"),
    "cut-off length": (b"\xc0\x40", "fell silent in the middle of an answer: the connection is lost"),
    "cut-off sentence": (b"\x05!done", "fell silent in the middle of an answer: the connection is lost"),
    "no length": (b"\xff\xff\xff\xff", "sent a word that starts with the byte 0xff, which no length starts with"),
    "huge length": (
        b"\xf0\x10\x00\x00\x00",
        "sent a word of 268435456 bytes, where 16777216 bytes are the most for a whole answer",
    ),
    "another protocol": (frame("SSH-2.0-ROSSSH"), "sent a word of 14 characters in the place of an answer"),
    "unknown answer": (frame("!what", ".tag=2"), "sent `!what` in the place of an answer"),
    "unknown tag": (frame("!done", ".tag=99"), "sent an answer `!done` to a command that it was not asked"),
    "no tag": (frame("!done"), "sent an answer `!done` to a command that it was not asked"),
    "answered twice": (
        frame("!done", ".tag=2") + frame("!done", ".tag=2"),
        "sent an answer `!done` to a command that it was not asked",
    ),
    "no attribute": (
        frame("!re", ".tag=2", "password"),
        "sent a word of 8 characters in the place of an attribute of !re",
    ),
}


@pytest.mark.parametrize("case", GARBAGE)
def test_protocol_error_ends_the_session(tmp_path: Path, case: str) -> None:
    data, complaint = GARBAGE[case]

    async def script(peer: Peer) -> None:
        await peer.read_tags(2)
        await peer.raw(data)
        peer.writer.close()

    error = lost(tmp_path, script)
    assert isinstance(error, ProtocolError)
    assert error.in_flight
    assert str(error).split(" ", 1)[1] == complaint


def test_silent_device_times_out(tmp_path: Path) -> None:
    async def script(peer: Peer) -> None:
        await peer.gone()

    error = lost(tmp_path, script, reply_timeout_s=0.05)
    assert error.in_flight
    assert str(error).endswith("has not answered for 0.05 s")


def test_timeout_can_be_set_per_command(tmp_path: Path) -> None:
    async def script(peer: Peer) -> None:
        await peer.gone()

    async def use(session: Session) -> str:
        with pytest.raises(SessionLost) as caught:
            await session.command(PRINT, silence_s=0.02)
        return str(caught.value)

    assert talk(tmp_path, script, use).endswith("has not answered for 0.02 s")


def test_unsolicited_fatal_ends_the_session_before_the_next_command(tmp_path: Path) -> None:
    async def script(peer: Peer) -> None:
        (tag,) = await peer.read_tags(1)
        await peer.send(("!done", f".tag={tag}"), ("!fatal", "going down"))
        await peer.gone()

    async def use(session: Session) -> SessionLost:
        await session.command(PRINT)
        await session._wire.closed.wait()
        with pytest.raises(SessionLost) as caught:
            await session.command(PRINT)
        return caught.value

    error = talk(tmp_path, script, use)
    assert not error.in_flight
    assert str(error).endswith("ended the session: going down")


def test_cancelled_command_drops_the_connection(tmp_path: Path) -> None:
    asked = asyncio.Event()

    async def script(peer: Peer) -> None:
        await peer.read_tags(1)
        asked.set()
        await peer.gone()

    async def use(session: Session) -> SessionLost:
        task = asyncio.get_running_loop().create_task(session.command(PRINT))
        await asked.wait()
        task.cancel()
        with pytest.raises(asyncio.CancelledError):
            await task
        with pytest.raises(SessionLost) as caught:
            await session.command(PRINT)
        return caught.value

    assert not talk(tmp_path, script, use).in_flight


def test_a_closed_session_stays_closed(tmp_path: Path) -> None:
    async def script(peer: Peer) -> None:
        assert await peer.gone() == b""

    async def use(session: Session) -> str:
        await session.close()
        await session.close()
        with pytest.raises(SessionLost) as caught:
            await session.command(PRINT)
        return str(caught.value)

    assert talk(tmp_path, script, use).endswith("was left: this session is closed")


def test_nodelay_and_keepalive_are_set_on_the_socket(tmp_path: Path) -> None:
    async def script(peer: Peer) -> None:
        await peer.gone()

    async def use(session: Session) -> tuple[int, int]:
        connection = session._wire.transport.get_extra_info("socket")
        return (
            connection.getsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY),
            connection.getsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE),
        )

    assert talk(tmp_path, script, use) == (1, 1)


def test_repr_shows_no_secret() -> None:
    command = Command("/user/add", (("name", "x"), ("password", PASSWORD)), (f"?password={PASSWORD}",))
    reply = Reply(({"password": PASSWORD},), PASSWORD, None, "/user/print")
    endpoint = Device(8729, "00").endpoint()
    assert PASSWORD not in f"{command!r} {reply!r} {endpoint!r} {endpoint}"


@pytest.mark.parametrize(("path", "queries"), [("user/print", ()), ("", ()), ("/user/print", ("name=x",))])
def test_malformed_command_cannot_be_constructed(path: str, queries: tuple[str, ...]) -> None:
    with pytest.raises(ValueError, match=r"^a command word starts with / and every query word with \?: Command"):
        Command(path, queries=queries)


def test_default_timeouts_outlast_a_satellite_gap() -> None:
    endpoint = Device(8729, "00").endpoint()
    fields = type(endpoint).__dataclass_fields__
    assert fields["connect_timeout_s"].default == 120
    assert fields["reply_timeout_s"].default == 180


def test_public_names_of_the_package() -> None:
    assert api.__all__ == [
        *("READING_WINDOW", "WINDOW", "CertificateMismatch", "CertificateUnknown", "Command", "CommandError"),
        *("Endpoint", "FellSilent", "LoginError", "ProtocolError", "Reply", "Session", "SessionLost"),
        *("Traffic", "Trap", "Unreachable", "certificate_of", "may_cut_off", "shown_certificate"),
    ]


def test_every_error_is_a_device_error_with_exit_failed() -> None:
    errors = [getattr(api, name) for name in api.__all__ if isinstance(getattr(api, name), type)]
    kinds = [kind for kind in errors if issubclass(kind, Exception)]
    assert len(kinds) == 8
    assert all(issubclass(kind, DeviceError) and kind.exit == ExitCode.FAILED for kind in kinds)
