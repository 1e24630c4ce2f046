"""A hundred revocations in a row: how long until the session is dead, measured by traffic and by the server's word."""

import math
import time
from collections.abc import Sequence
from pathlib import Path

import pytest
from live_stand import Echo, record, server_of

from atlantis_netcfg.operations.vpn import live

pytestmark = [pytest.mark.namespace, pytest.mark.campaign]

COUNT = 100
STAY = 50
"""So many others are members as well: the firewall is not an empty one."""


def figures(what: str, ms: Sequence[float]) -> str:
    ordered = sorted(ms)
    middle, high = ordered[len(ordered) // 2], ordered[math.ceil(len(ordered) * 0.99) - 1]
    return f"{what:58} p50 {middle:6.1f}  p99 {high:6.1f}  max {ordered[-1]:6.1f} ms"


def test_a_hundred_revocations(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    made = record(tmp_path / "vpn")
    names = made.onboard(COUNT + STAY)[:COUNT]
    echoes, done, whole = [], [], []
    steps: dict[str, list[float]] = {}
    with server_of(made) as server:
        client = server.client(names[0])
        for name in names:
            client.become(made.identities[name])
            client.start()
            with Echo(client, every_s=0.002) as echo:
                echo.goes()
                common_names = made.revoke(name)
                began = time.monotonic()
                evidence = server.revoke(*common_names)
                ended = time.monotonic()
                assert echo.answers() == 0
            assert evidence.is_confirmed, (evidence.left, evidence.notes, server.lives)
            assert [one.common_name for one in evidence.ended] == [name]
            assert live.verify(server.link, evidence).is_confirmed
            asked = ended - evidence.seconds
            echoes.append(max(0.0, echo.last - asked) * 1000)
            for step, at in evidence.steps:
                steps.setdefault(step, []).append(at)
            done.append(evidence.seconds * 1000)
            whole.append((ended - began) * 1000)
            client.stop()
            client.start(wait=False)
            server.said("certificate revoked", len(done))
            assert not client.up
            client.stop()
        assert server.lives
        assert server.names() == []
        assert server.push().changes == ()
    with capsys.disabled():
        print(f"\n{COUNT} revocations, {COUNT + STAY} members, on loopback")  # noqa: T201 - figures for a person
        print(figures("request to the last question that was answered", echoes))  # noqa: T201 - as above
        for step, times in steps.items():
            print(figures(f"request to `{step}`, on the server", times))  # noqa: T201 - as above
        print(figures("request to the answer that all of it is verified", done))  # noqa: T201 - as above
        print(figures("the same with working out the files", whole))  # noqa: T201 - as above
