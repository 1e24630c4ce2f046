"""The role `openvpn_client` on a real Debian with systemd, and a real OpenVPN server that it reaches or not."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from gateway_role import Stand
from gateway_stand import Key, Start, ground, machine, technician  # noqa: F401 - fixtures
from gateway_suite import checked
from vpn_stand import ADDRESS, HOST, Vpn

from atlantis_netcfg.emulator.lab import Lab
from atlantis_netcfg.vpn.client import CONF, IDENTITY, SERVICE
from atlantis_netcfg.vpn.identity import Wrap

pytestmark = [pytest.mark.namespace, pytest.mark.slow]

READER = "atlantis-data-gateway.service"
WAITS = """\
[Unit]
After=sys-subsystem-net-devices-tun0.device
BindsTo=sys-subsystem-net-devices-tun0.device
[Service]
ExecStart=/bin/sleep infinity
[Install]
WantedBy=sys-subsystem-net-devices-tun0.device
"""
"""As the data gateway: it lives as long as the interface."""
QUICK = "[Service]\nRestartSec=1\n"
"""Nobody waits five minutes for a satellite in a test."""


@pytest.fixture
def stand(machine: Start, technician: Key, tmp_path: Path) -> Stand:  # noqa: F811 - fixtures
    """A gateway that has nothing of the VPN, and a service that waits for its interface."""
    made = Stand(machine(HOST), technician, tmp_path, ["openvpn_client"])
    made.gateway.put(f"/etc/systemd/system/{READER}", WAITS)
    made.gateway.put(f"/etc/systemd/system/{SERVICE}.d/zz-test.conf", QUICK)
    made.gateway.run(f"systemctl daemon-reload; systemctl enable {READER}")
    return made


@pytest.fixture
def vpn(ground: Lab, tmp_path: Path) -> Iterator[Vpn]:  # noqa: F811 - fixture
    made = Vpn(ground, tmp_path / "vpn")
    made.start()
    yield made
    made.stop()


def bring(stand: Stand, text: str) -> str:
    """Lay an identity where the technician's laptop has it; gives its most secret line."""
    path = stand.folder / "state" / "vpn" / "hosts" / f"{HOST}.identity"
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)
    lines = text.splitlines()
    return lines[lines.index("-----BEGIN PRIVATE KEY-----") + 2]


def until(stand: Stand, command: str) -> None:
    """Wait until a command succeeds on the gateway."""
    stand.gateway.run(f"while ! {{ {command}; }} >/dev/null 2>&1; do sleep 0.2; done")


def state(stand: Stand, unit: str = SERVICE) -> str:
    return stand.gateway.run(f"systemctl is-active {unit}", check=False).stdout.strip()


def notice(stand: Stand) -> None:
    """Let systemd see that tun0 is there, or gone: a container has no udev, so its notes are written here."""
    stand.gateway.run(
        "test -w /sys || { mount -o remount,rw /sys; systemctl daemon-reexec; };"
        " if n=n$(cat /sys/class/net/tun0/ifindex 2>/dev/null); then mkdir -p /run/udev/data /run/udev/tags/systemd;"
        " touch /run/udev/tags/systemd/$n;"
        " printf 'I:1\\nE:SYSTEMD_ALIAS=/sys/subsystem/net/devices/tun0\\nG:systemd\\nQ:systemd\\nV:1\\n'"
        " >/run/udev/data/$n; fi; systemctl daemon-reload"
    )


UP = f"ip -4 -oneline address show dev tun0 | grep -q 'inet {ADDRESS}/16'"


def test_gateway_joins_is_rejected_and_rejoins_the_vpn(stand: Stand, vpn: Vpn) -> None:
    alone = stand.run()
    assert alone["status"] == "changed", alone["message"]
    assert [note for note in alone["notes"] if "`provision vpn accept file=FILE`" in note]
    assert state(stand) == "inactive"

    vpn.admit()
    secret = bring(stand, vpn.identity())
    joined = stand.run("-vvv", "--diff")
    assert joined["changes"] == [f"file {IDENTITY}", f"unit {SERVICE} enabled", f"unit {SERVICE} started"]
    assert joined["notes"] == []
    until(stand, UP)
    vpn.ground.command(["ping", "-c1", "-W5", ADDRESS])
    notice(stand)
    until(stand, f"systemctl is-active {READER}")
    assert stand.gateway.run(f"stat -c '%a %U' {IDENTITY}").stdout.split() == ["600", "root"]
    assert stand.run()["changes"] == []
    written = [path for path in stand.folder.rglob("*") if path.is_file() and path.suffix != ".identity"]
    assert not [path for path in written if secret.encode() in path.read_bytes()]
    assert secret not in stand.gateway.run("journalctl --output cat").stdout

    # The server throws it out and admits it no more: the program ends or asks again, and is never given up.
    vpn.refuse()
    pid = stand.gateway.run(f"systemctl show -p MainPID --value {SERVICE}").stdout
    stand.gateway.run(f"systemctl kill --signal=USR1 {SERVICE}")
    until(stand, f"journalctl -u {SERVICE} --output cat | grep -q AUTH_FAILED")
    stand.gateway.run(f"systemctl kill --signal=TERM {SERVICE}")
    until(stand, f"test $(systemctl show -p MainPID --value {SERVICE}) != {pid.strip()}")
    notice(stand)
    until(stand, f"! systemctl is-active {READER}")
    vpn.admit()
    until(stand, UP)
    notice(stand)
    until(stand, f"systemctl is-active {READER}")

    # Another identity, of the kind that OpenVPN 2.4 knows: the tunnel starts anew.
    bring(stand, vpn.identity(days=20, wrap=Wrap.TLS_CRYPT))
    assert stand.run()["changes"] == [f"file {IDENTITY}", f"unit {SERVICE} restarted"]
    until(stand, UP)
    seen = checked(stand, "-k", "vpn or tunnel")
    assert list(seen) == ["test_vpn_identity_lasts[coastal-gateway]"]
    assert "20 days" in seen["test_vpn_identity_lasts[coastal-gateway]"] or "19 days" in "".join(seen.values())

    # A laptop without the identity leaves the gateway's own in its place, and the tunnel up.
    (stand.folder / "state" / "vpn" / "hosts" / f"{HOST}.identity").unlink()
    left = stand.run()
    assert (left["changes"], left["notes"]) == ([], [])
    stand.gateway.run(UP)

    # Who is no member any more keeps nothing of it.
    stand.declare({"vpn_address": None}, f"host_vars/{HOST}.yml", "device")
    stand.declare({"dds": None, "gateways": None})
    stand.publish_nothing()
    gone = stand.run()["changes"]
    assert {f"absent {IDENTITY}", f"absent {CONF}", f"unit {SERVICE} disabled", f"unit {SERVICE} stopped"} <= {*gone}
