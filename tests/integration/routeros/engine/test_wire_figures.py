"""Round trips and bytes of our own run, counted by a proxy in front of the router, in a clock that jumps."""

import asyncio
import shutil
import subprocess
import sys
from dataclasses import replace
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import pytest
from engine_bench import PASSWORD, Bench, on, run

from atlantis_netcfg.core.secret import Secret
from atlantis_netcfg.emulator.routeros import FaultKind, LinkFault
from atlantis_netcfg.operations.links.session import ReadOnlySession
from atlantis_netcfg.routeros import DeviceResult, Endpoint, Status
from atlantis_netcfg.routeros.api import LoginError
from atlantis_netcfg.routeros.apply._change import change as changing
from atlantis_netcfg.routeros.apply._scripts import scripts as written
from atlantis_netcfg.routeros.apply._work import RunContext
from atlantis_netcfg.routeros.commands import Examination
from bench import wire
from bench.job import Scenario
from bench.proxy import Count, Proxy, Shape

RTT_S = 0.7
PLAIN = Shape(RTT_S / 2)
PAGE = Path(__file__).parents[4] / "docs" / "engineers" / "benchmarks.md"
GOALS = {
    Scenario.FIRST: (22, 169_000),
    Scenario.NOTHING: (5, 65_500),
    Scenario.FIREWALL: (13, 116_000),
    Scenario.USE: (13, 70_000),
}
"""Round trips and bytes of the engine at most; 1.3 times the scripts are for the device's parser."""
TYPED = {
    Scenario.FIRST: (22, 161_500),
    Scenario.NOTHING: (5, 65_000),
    Scenario.FIREWALL: (13, 115_000),
    Scenario.USE: (18, 79_000),
}
"""The same of the whole command."""
BYTES = 0.02
"""Certificates, times and counters differ from run to run."""


@cache
def figures(shape: Shape = PLAIN) -> dict[Scenario, wire.WireFigure]:
    with TemporaryDirectory() as folder:
        return run(wire.measured(Path(folder), shape))


@pytest.mark.smoke("first", "no-op")
@pytest.mark.parametrize("scenario", Scenario)
def test_round_trips_and_bytes_meet_the_goals(scenario: Scenario) -> None:
    figure = figures()[scenario]
    assert figure.result.status is (Status.UNCHANGED if scenario is Scenario.NOTHING else Status.CHANGED)
    round_trips, size = GOALS[scenario]
    assert figure.count.round_trips <= round_trips
    assert figure.count.bytes <= size


@pytest.mark.smoke("no-op")
@pytest.mark.parametrize("scenario", Scenario)
def test_run_takes_only_the_time_of_its_round_trips(scenario: Scenario) -> None:
    """In this clock nobody needs time for anything but the link."""
    figure = figures()[scenario]
    assert figure.wall_s == pytest.approx(figure.count.round_trips * RTT_S, abs=0.01)


@pytest.mark.smoke("first")
@pytest.mark.parametrize("scenario", Scenario)
def test_reported_traffic_matches_the_wire(scenario: Scenario) -> None:
    compare(figures()[scenario].result, figures()[scenario].count)


def compare(result: DeviceResult, count: Count) -> None:
    assert result.round_trips == pytest.approx(count.round_trips, rel=0.1)
    assert result.sent_bytes == pytest.approx(count.sent, rel=0.1)
    assert result.received_bytes == pytest.approx(count.received, rel=0.1)
    assert result.sessions == count.connections


def at(proxy: Proxy, endpoint: Endpoint, **changes: Any) -> Endpoint:  # noqa: ANN401 - fields of Endpoint
    host, port = proxy.address
    return replace(endpoint, host=host, port=port, **changes)


@pytest.mark.parametrize(
    ("changes", "message", "sessions"),
    [
        ({"password": Secret("another one")}, "refused the login", 1),
        ({"pin": "00" * 32}, "the certificate is not the one of this device", 1),
        ({"pin": None}, "its certificate is unknown here", 1),
    ],
)
def test_failed_session_is_counted(tmp_path: Path, changes: dict[str, Any], message: str, sessions: int) -> None:
    """A refused login, another certificate, and a device that nobody has agreed to, which is told nothing."""

    async def act(bench: Bench) -> None:
        async with Proxy("127.0.0.1", 0, (bench.router.host, bench.router.ports["api-ssl"]), PLAIN) as proxy:
            endpoint = at(proxy, bench.job().endpoint, **changes)
            result = await bench.converge(endpoint=endpoint)
            assert message in result.message
            assert result.sessions == sessions
            compare(result, proxy.count)

    on(Bench(tmp_path), act)


def test_session_lost_in_its_login_and_repeated_is_counted_twice(tmp_path: Path) -> None:
    async def act(bench: Bench) -> None:
        async with Proxy("127.0.0.1", 0, (bench.router.host, bench.router.ports["api-ssl"]), PLAIN) as proxy:
            bench.router.arm(LinkFault(do=FaultKind.DROP, match="/login", sentence=2, when="after"))
            result = await bench.converge(endpoint=at(proxy, bench.job().endpoint))
            assert result.status is Status.CHANGED
            assert result.sessions == 3
            compare(result, proxy.count)

    on(Bench(tmp_path), act)


@pytest.mark.smoke("another one")
@pytest.mark.parametrize("password", [PASSWORD, "another one"])
def test_console_session_that_holds_safe_mode_is_counted(tmp_path: Path, password: str) -> None:
    """Before RouterOS 7.18 there is none on the API; also where it does not let us in."""

    async def act(bench: Bench) -> None:
        ports = bench.router.ports
        async with (
            Proxy("127.0.0.1", 0, (bench.router.host, ports["api-ssl"]), PLAIN) as api,
            Proxy("127.0.0.1", 0, (bench.router.host, ports["ssh"]), PLAIN) as console,
        ):
            host, port = console.address
            ssh = replace(bench.ssh, host=host, port=port, password=Secret(password))
            result = await bench.converge(endpoint=at(api, bench.job().endpoint), ssh=ssh)
            assert result.status is (Status.CHANGED if password == PASSWORD else Status.LEFT_AS_FOUND), result.message
            assert console.count.connections == 1
            console.count.add(api.count)
            compare(result, console.count)

    on(Bench(tmp_path, spec={"version": "7.16"}), act)


def test_port_that_does_not_speak_tls_is_counted(tmp_path: Path) -> None:
    async def refuse(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        await reader.read(1)
        writer.write(b"HTTP/1.1 400 Bad Request\r\n\r\n")
        writer.close()

    async def act(bench: Bench) -> None:
        server = await asyncio.start_server(refuse, "127.0.0.1", 0)
        async with server, Proxy("127.0.0.1", 0, server.sockets[0].getsockname()[:2], PLAIN) as proxy:
            result = await bench.converge(endpoint=at(proxy, bench.job().endpoint))
            assert "not with TLS" in result.message
            assert result.sessions == 1
            assert result.round_trips == 2
            compare(result, proxy.count)

    on(Bench(tmp_path), act)


def test_links_command_counts_failed_sessions(tmp_path: Path) -> None:
    async def act(bench: Bench) -> None:
        async with Proxy("127.0.0.1", 0, (bench.router.host, bench.router.ports["api-ssl"]), PLAIN) as proxy:
            endpoint = at(proxy, bench.job().endpoint)
            door = ReadOnlySession("router", replace(endpoint, password=Secret("another one")))
            with pytest.raises(LoginError):
                async with door.open_session():
                    pass
            door.endpoint = replace(door.endpoint, password=Secret(PASSWORD))
            async with door.open_session():
                pass
            assert door.connections == proxy.count.connections == 2
            assert door.round_trips == proxy.count.round_trips
            assert door.bytes == pytest.approx(proxy.count.bytes, rel=0.1)

    on(Bench(tmp_path), act)


@pytest.mark.smoke("first")
@pytest.mark.parametrize("scenario", Scenario)
def test_estimate_matches_the_wire(scenario: Scenario) -> None:
    figure = figures()[scenario]
    assert figure.result.estimate is not None
    assert figure.result.estimate.round_trips == pytest.approx(figure.count.round_trips, abs=1)
    assert figure.result.estimate.bytes == pytest.approx(figure.count.bytes, rel=0.15)


@pytest.mark.smoke("first")
@pytest.mark.parametrize("scenario", [Scenario.FIRST, Scenario.FIREWALL])
def test_parser_check_stays_within_its_byte_limit(scenario: Scenario, monkeypatch: pytest.MonkeyPatch) -> None:
    """No round trip, and at most 1.3 times the bytes of the scripts, in both directions together."""
    with_it = figures()[scenario].count
    scripts: list[int] = []
    monkeypatch.setattr(Examination, "questions", lambda *_: ())

    async def change(work: RunContext) -> None:
        scripts.append(sum(len(text.encode()) for text, _ in written(work.aim.actions)))
        await changing(work)

    monkeypatch.setattr("atlantis_netcfg.routeros.apply._executor.change", change)
    with TemporaryDirectory() as folder:
        without = run(wire.measured(Path(folder), PLAIN))[scenario].count
    assert with_it.round_trips == without.round_trips
    size = scripts[0 if scenario is Scenario.FIRST else 1]
    assert size < with_it.bytes - without.bytes <= 1.3 * size


@pytest.mark.slow
@pytest.mark.namespace
def test_command_meets_the_goals_and_the_page_is_up_to_date(tmp_path: Path) -> None:
    """Typed as a technician does, over TLS; whoever moves it writes the page anew: `python -m bench --wire PAGE`."""
    page = tmp_path / "benchmarks.md"
    shutil.copy(PAGE, page)
    words = [sys.executable, "-m", "bench", "--wire", str(page), "--link", "200"]
    done = subprocess.run(words, cwd=PAGE.parents[2], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    counts, printed = wire.published(page.read_text(encoding="utf-8")), wire.published(PAGE.read_text(encoding="utf-8"))
    assert list(counts) == list(printed) == list(TYPED)
    for scenario, (sessions, round_trips, size) in counts.items():
        assert round_trips <= TYPED[scenario][0]
        assert size <= TYPED[scenario][1]
        assert printed[scenario][:2] == (sessions, round_trips)
        assert size == pytest.approx(printed[scenario][2], rel=BYTES)
