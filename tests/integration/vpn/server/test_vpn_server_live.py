"""The live commands over SSH, on a computer that its role has set up: neither finds anything to do after the other."""

from typing import Any

import pytest
from vpn_server_stand import NAME, TUNNEL, Stand, stand  # noqa: F401 - a fixture
from waiting import wait_until

from atlantis_netcfg.operations.computers.remote_session import SshLink
from atlantis_netcfg.operations.vpn import live

pytestmark = [pytest.mark.namespace, pytest.mark.campaign]


def access(stand: Stand) -> dict[str, Any]:  # noqa: F811 - not the fixture
    known = stand.folder / "known"
    options = f"-F none -o HostKeyAlias={NAME} -o UserKnownHostsFile={known} -o IdentityFile={stand.key}"
    return {"host": "127.0.0.1", "port": stand.machine.port, "user": "root", "become": False, "ssh_args": options}


def test_role_and_live_commands_agree(stand: Stand, monkeypatch: pytest.MonkeyPatch) -> None:  # noqa: F811
    monkeypatch.setenv("ANSIBLE_SSH_CONTROL_PATH_DIR", str(stand.folder / "cp"))
    stand.laptop("one")
    assert stand.run()["status"] == "changed"
    with SshLink(NAME, access(stand)) as link:

        def drift() -> tuple[str, ...]:
            wanted = live.desired_files(stand.declaration, stand.authority)
            return live.drift(live.observe(link), wanted, stand.authority.membership())

        assert live.push(stand.declaration, stand.authority, link).changes == ()
        assert drift() == ()
        name = stand.laptop("two")
        assert live.push(stand.declaration, stand.authority, link).changes
        assert stand.run("--check")["changes"] == []
        assert stand.run()["changes"] == []
        pid = stand.pid()

        client = stand.client(name).connect()
        assert client.pings()
        state = live.observe(link)
        assert (state.active, state.is_live, state.package is not None) == (True, True, True)
        assert [one.common_name for one in state.sessions] == [name]
        wait_until(lambda: name in stand.read("/run/atlantis-vpn/status"), lambda: "no status was written")
        stand.machine.run("systemctl start atlantis-vpn-seen.service")
        assert name in live.observe(link).last_sessions

        stand.revoke(name)
        evidence = live.finish_revocations(stand.declaration, stand.authority, link)
        assert evidence is not None
        assert evidence.is_confirmed, evidence
        assert not client.pings()
        assert live.verify(link, evidence).is_confirmed
        assert drift() == ()
        assert stand.run()["changes"] == []
        assert stand.pid() == pid

        other = stand.laptop("three")
        stand.run()
        stand.machine.run(f"systemctl stop {TUNNEL}")
        stand.revoke(other)
        evidence = live.finish_revocations(stand.declaration, stand.authority, link)
        assert evidence is not None
        assert evidence.is_confirmed, "systemd knows that it is down"
        stand.machine.run(f"systemctl start {TUNNEL}")
