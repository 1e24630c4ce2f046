"""The gpsd of a gateway, which listens on its own computer alone, through OpenSSH."""

import asyncio
import threading
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import asyncssh
import pytest
from voyage_stand import DECLARATION, UNIT
from waiting import HANG_S, wait_until

from atlantis_netcfg.core.errors import UsageError
from atlantis_netcfg.emulator.gnss import GnssSpec, RunningGpsd
from atlantis_netcfg.operations import Mode, Request
from atlantis_netcfg.operations.common.request import Target
from atlantis_netcfg.records.survey.measure import SurveyPlan
from atlantis_netcfg.records.survey.positions import GpsdSource, NoPosition, TrackPosition
from atlantis_netcfg.records.survey.radio import find_survey_link
from atlantis_netcfg.records.survey.site import SiteSurvey
from atlantis_netcfg.runs import Store

GATEWAY = "te4sea-gateway"


class _Door(asyncssh.SSHServer):
    """Lets one key in, and forwards what is meant for gpsd's port to where the emulated one listens."""

    def __init__(self, gpsd_port: int) -> None:
        self.gpsd_port = gpsd_port

    def connection_made(self, conn: asyncssh.SSHServerConnection) -> None:
        self.conn = conn

    def connection_requested(self, dest_host: str, dest_port: int, *_: object) -> object:  # type: ignore[override]
        assert (dest_host, dest_port) == ("127.0.0.1", 2947)
        return self.conn.forward_connection("127.0.0.1", self.gpsd_port)


@contextmanager
def gateway(folder: Path, gpsd_port: int) -> Iterator[Target]:
    """An SSH server, and how it is reached."""
    host_key, user_key = (asyncssh.generate_private_key("ssh-ed25519") for _ in range(2))
    user_key.write_private_key(str(folder / "key"))
    user_key.write_public_key(str(folder / "authorized"))
    (folder / "key").chmod(0o600)
    (folder / "known").write_text(f"{GATEWAY} {host_key.export_public_key().decode()}", encoding="ascii")
    loop, ready, port = asyncio.new_event_loop(), threading.Event(), [0]

    async def serve() -> None:
        server = await asyncssh.create_server(
            lambda: _Door(gpsd_port),
            "127.0.0.1",
            0,
            server_host_keys=[host_key],
            authorized_client_keys=str(folder / "authorized"),
        )
        port[0] = server.sockets[0].getsockname()[1]
        ready.set()
        await ended.wait()
        server.close()
        await server.wait_closed()

    ended = asyncio.Event()
    thread = threading.Thread(target=lambda: loop.run_until_complete(serve()))
    thread.start()
    assert ready.wait(HANG_S)
    try:
        yield Target(host="127.0.0.1", port=port[0], known_hosts=str(folder / "known"), identity=str(folder / "key"))
    finally:
        loop.call_soon_threadsafe(ended.set)
        thread.join()
        loop.close()


def heard(folder: Path, target: Target | None, gps: str | None) -> tuple[GpsdSource, TrackPosition | NoPosition]:
    """The source that a survey has, and what it says once it says something."""
    targets = {} if target is None else {GATEWAY: target}
    request = Request(state=folder, mode=Mode.DRIFT, rehearsed=True, targets=targets)
    link, store = find_survey_link(DECLARATION, UNIT.site, None), Store(folder, is_rehearsal=True)
    site = SiteSurvey(DECLARATION, link, UNIT, request, store, SurveyPlan(), radio_only=True, gps=gps)
    with ExitStack() as stack:
        survey = site.build_survey(stack, lambda _sample: None, lambda _point: None)
        assert isinstance(survey.positions, GpsdSource)
        positions = survey.positions
        wait_until(lambda: isinstance(positions.position(), TrackPosition) or positions.trouble, positions.position)
        return positions, positions.position()


@pytest.fixture(autouse=True)
def _no_shared_connection(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("ANSIBLE_SSH_ARGS", "-o ControlMaster=no")
    monkeypatch.setenv("HOME", str(tmp_path))


def test_gpsd_of_a_gateway_is_read_over_ssh(tmp_path: Path) -> None:
    with RunningGpsd(GnssSpec(every_s=0.1)) as twin, gateway(tmp_path, twin.port) as target:
        source, found = heard(tmp_path, target, "gateway")
    assert source.name == f"gpsd of {GATEWAY}"
    assert isinstance(found, TrackPosition)
    assert (found.latitude, found.longitude) == (41.68642, -8.83883)


def test_computer_with_another_host_key_receives_nothing(tmp_path: Path) -> None:
    with RunningGpsd(GnssSpec(every_s=0.1)) as twin, gateway(tmp_path, twin.port) as target:
        other = asyncssh.generate_private_key("ssh-ed25519").export_public_key().decode()
        (tmp_path / "known").write_text(f"{GATEWAY} {other}", encoding="ascii")
        source, _ = heard(tmp_path, target, "gateway")
        assert twin.inputs == []
    assert "Host key verification failed" in source.trouble


def test_source_that_is_no_gpsd_is_refused(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="` is not a gpsd address"):
        heard(tmp_path, None, "somewhere else")
