"""The end date of the shared key, and `force-cookie` with clients of OpenVPN 2.5 and 2.6."""

from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path

import live_stand
import pytest
from live_stand import record, server_of

from atlantis_netcfg.vpn.identity import Wrap

pytestmark = [pytest.mark.namespace, pytest.mark.slow]

IMPATIENT = "hand-window 6"
"""It gives up its handshake after so many seconds, and not after a minute."""
OLDER = Path(__file__).parents[4] / ".venv-setup" / "debian" / "bullseye"


def declare(monkeypatch: pytest.MonkeyPatch, **values: object) -> None:
    """The pilot of the stand, its VPN with other settings."""
    shipped = live_stand.declaration()
    vpn = shipped.pilot.vpn.model_copy(update=values)
    changed = replace(shipped, pilot=shipped.pilot.model_copy(update={"vpn": vpn}))
    monkeypatch.setattr(live_stand, "declaration", lambda: changed)


def day(offset: int) -> str:
    return f"{datetime.now(UTC) + timedelta(days=offset):%Y-%m-%d}"


def test_shared_key_opens_no_session_after_its_last_day(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    made = record(tmp_path / "vpn")
    shared = made.onboard(2, wrap=Wrap.TLS_CRYPT)
    (own,) = made.onboard()
    declare(monkeypatch, shared_key_until=day(+1))
    with server_of(made) as server:
        earlier, later, other = (server.client(name) for name in (*shared, own))
        earlier.start()
        declare(monkeypatch, shared_key_until=day(-1))
        assert server.drift()
        server.push()
        assert server.drift() == ()
        other.start()
        later.become(made.identities[shared[1]], IMPATIENT)
        later.start(wait=False)
        later.said("TLS Error: TLS key negotiation failed")
        assert server.names() == sorted([shared[0], own])
        assert "10.99.2" not in server.log()
        assert not later.up


def test_force_cookie_admits_2_6_and_limits_2_5_to_the_shared_key(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    program = OLDER / "openvpn" / "usr" / "sbin" / "openvpn"
    if not program.exists():
        pytest.skip("OpenVPN 2.5 is unpacked by tools/develop")
    (library,) = (OLDER / "libssl1.1").glob("usr/lib/*/libssl.so.1.1")
    old = ("env", f"LD_LIBRARY_PATH={library.parent}", str(program))
    declare(monkeypatch, force_cookie=True)
    made = record(tmp_path / "vpn")
    own = made.onboard(2)
    (shared,) = made.onboard(wrap=Wrap.TLS_CRYPT)
    with server_of(made) as server:
        now, before, fitting = (server.client(name) for name in (*own, shared))
        now.start()
        fitting.start(program=old)
        before.become(made.identities[own[1]], IMPATIENT)
        before.start(wait=False, program=old)
        before.said("TLS Error: TLS key negotiation failed")
        assert " OpenVPN 2.5.1 " in before.log()
        assert server.names() == sorted([own[0], shared])
