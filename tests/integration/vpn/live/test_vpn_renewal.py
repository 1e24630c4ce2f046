"""A renewal: the certificate in use works until its successor was seen, and then it is admitted no more."""

import json
import time
from pathlib import Path

import pytest
from live_stand import Echo, Record, Server, declaration, record, server_of

from atlantis_netcfg.operations.vpn import live
from atlantis_netcfg.vpn.identity import CertificateStatus
from atlantis_netcfg.vpn.server import CCD, FOLDER, SEEN_FILE

pytestmark = pytest.mark.namespace


def seen(server: Server) -> tuple[tuple[str, ...], live.PushResult | None]:
    authority = server.record.authority
    sighting, pushed = live.note_seen(declaration(), authority, server.link, live.observe(server.link), "test")
    return sighting.superseded_names, pushed


def standings(made: Record, name: str) -> dict[str, CertificateStatus]:
    return {one.common_name: one.standing for one in made.authority.membership().members[name].certificates}


def test_old_certificate_works_until_new_one_is_used(tmp_path: Path) -> None:
    made = record(tmp_path / "vpn")
    (name,) = made.onboard()
    with server_of(made) as server:
        old = server.client(name)
        old.start()
        with Echo(old) as before:
            before.goes()
            second = made.renew(name)
            assert (second, server.push().changes) == (f"{name}.2", (f"file {CCD}/{second}", f"file {FOLDER}/crl.pem"))
            assert seen(server) == ((), None)
            assert standings(made, name) == {name: CertificateStatus.SEEN, second: CertificateStatus.ISSUED}
            before.goes()

            new = server.client(second)
            new.start()
            with Echo(new) as after:
                after.goes()
                # Both have a session; the address, and with it all traffic, is the newer one's from its first moment.
                assert server.names() == [name, second]
                assert before.answers() == 0
                superseded, pushed = seen(server)
                assert superseded == (name,)
                assert pushed is not None
                assert pushed.changes == (f"absent {CCD}/{name}",)
                assert [one.common_name for one in pushed.ended_sessions] == [name]
                after.goes()
        assert old.ended() == 0
        assert server.names() == [second]
        assert standings(made, name) == {name: CertificateStatus.SUPERSEDED, second: CertificateStatus.SEEN}
        assert server.drift() == ()
        assert seen(server) == ((), None)

        old.start(wait=False)
        old.said("AUTH_FAILED")
        assert server.names() == [second]
        evidence = server.throw_out(name)
        assert evidence.is_confirmed
        assert server.names() == []


def test_session_seen_between_two_commands_counts(tmp_path: Path) -> None:
    made = record(tmp_path / "vpn")
    name, other = made.onboard(2)
    second = made.renew(name)
    rows = {
        second: {"last": int(time.time()) - 60, "real": "192.0.2.7:1194", "address": made.address(name)},
        "stranger": {"last": int(time.time()) - 60, "real": "192.0.2.8:1194", "address": "10.80.17.99"},
    }
    with server_of(made) as server:
        server.put(SEEN_FILE, json.dumps({"format": 1, "seen": rows}))
        assert live.observe(server.link).last_sessions.keys() == rows.keys()
        superseded, pushed = seen(server)
        assert superseded == (name,)
        assert pushed is not None
        assert pushed.changes == (f"absent {CCD}/{name}",)
        assert standings(made, other) == {other: CertificateStatus.ISSUED}
        server.put(SEEN_FILE, "half of a fi")
        assert live.observe(server.link).last_sessions == {}
