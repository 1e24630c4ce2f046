"""The gateway suite of `checks/` on a real Debian: green where all is as promised; every check sees its own breach."""

from dataclasses import replace
from pathlib import Path

import pytest
from gateway_role import NAME, Stand
from gateway_stand import FREE_CLOCK, SHIPPED, Key, Start, ground, machine, technician  # noqa: F401 - fixtures
from gateway_suite import checked

from atlantis_netcfg.vpn.client import IDENTITY
from atlantis_netcfg.vpn.client import SERVICE as TUNNEL
from atlantis_netcfg.vpn.rehearsal import identities

pytestmark = [pytest.mark.namespace, pytest.mark.slow]

ACCOUNT = "odroid"
"""Becomes root by sudo, as on the vendor's image."""
CHRONYC = "/usr/local/sbin/chronyc"
FOLLOWS = "#!/bin/sh\necho 0A400101,10.64.1.1,3,1,0,0,0,0,0,0,0,0,0,Normal\n"
"""In place of chronyc: no time server answers in a yard."""
READER = "/run/systemd/system/atlantis-data-gateway.service"
SERVICE = "[Service]\nEnvironmentFile=/etc/atlantis/ros.env\nEnvironment=LATE=1\nExecStart=/bin/sleep infinity\n"
DDS = "/etc/atlantis/dds"

BREACHES = {
    "echo Etc/UTC >/etc/timezone": "test_file[coastal-gateway:/etc/timezone]",
    f"chmod 0600 {DDS}/4g/ros.env": f"test_file[coastal-gateway:{DDS}/4g/ros.env]",
    f"rm {DDS}/4g/fastdds.xml": f"test_file[coastal-gateway:{DDS}/4g/fastdds.xml]",
    "ln -sf /usr/share/zoneinfo/UTC /etc/localtime": "test_link[coastal-gateway:/etc/localtime]",
    "mkdir -p /etc/systemd/system.conf.d; touch /etc/systemd/system.conf.d/atlantis-watchdog.conf": (
        "test_what_is_taken_away[coastal-gateway:/etc/systemd/system.conf.d/atlantis-watchdog.conf]"
    ),
    f"touch {DDS}/old.xml": f"test_nothing_else_in[coastal-gateway:{DDS}]",
    "dpkg --force-all --remove tzdata": "test_package[coastal-gateway:tzdata]",
    f"systemctl disable {TUNNEL}": f"test_unit[coastal-gateway:{TUNNEL}]",
    "ip address flush dev tun0": "test_tunnel_has_its_address[coastal-gateway]",
    f"sed -i /CERTIFICATE/d {IDENTITY}": "test_vpn_identity_lasts[coastal-gateway]",
    "systemctl stop chrony": "test_unit[coastal-gateway:chrony.service]",
    "systemctl disable nftables": "test_unit[coastal-gateway:nftables.service]",
    f"rm {CHRONYC}": "test_clock_follows_a_source[coastal-gateway]",
    "localedef --delete-from-archive en_US.utf8": "test_locale_is_there[coastal-gateway]",
    "echo PasswordAuthentication yes >/etc/ssh/sshd_config.d/00-a.conf": "test_sshd_obeys[coastal-gateway]",
    "nft add rule inet atlantis input tcp dport 8080 accept": ("test_firewall_is_the_declared_one[coastal-gateway]"),
    "printf '[Journal]\\nSystemMaxUse=9G\\n' >/etc/systemd/journald.conf.d/zz.conf": (
        "test_journal_is_bounded[coastal-gateway]"
    ),
    "echo export ROS_DOMAIN_ID=9 >/etc/profile.d/zz.sh": "test_profile_is_in_force_for_people[coastal-gateway]",
    f"sed -i s/LATE/ROS_DOMAIN_ID/ {READER}; sed -i /EnvironmentFile/d {READER};"
    " systemctl daemon-reload; systemctl restart atlantis-data-gateway": (
        "test_profile_is_in_force_for[coastal-gateway:atlantis-data-gateway.service]"
    ),
    "echo ROS_LOCALHOST_ONLY=1 >>/etc/environment": "test_nothing_keeps_ros_at_home[coastal-gateway]",
}
"""What somebody does on the computer, and the check that sees it."""
OTHER_KEY = "ssh-ed25519 AAAAC3NzaC1lZDI1NTE5AAAAIOzMkrV3HHY+skvjB+3Dgsy6+gi2Qp9FkJyNvsHCouP1"
ROOM = "test_card_has_room[coastal-gateway]"


@pytest.fixture
def stand(machine: Start, technician: Key, tmp_path: Path) -> Stand:  # noqa: F811 - fixtures
    """A gateway that three roles have brought to what is declared; the data gateway runs on it."""
    made = Stand(machine(NAME, disk_mb=2000), technician, tmp_path, ["gateway_base", "openvpn_client", "gateway_dds"])
    made.declare({"gateways": {"ros2": None, "interop": None}})
    made.declare({"ssh": {"user": ACCOUNT}}, f"host_vars/{NAME}.yml", "device")
    made.gateway.run(f"useradd --create-home {ACCOUNT}; cp -r /root/.ssh ~{ACCOUNT}; chown -R {ACCOUNT}: ~{ACCOUNT}")
    identities(SHIPPED, [SHIPPED.hosts[NAME]], tmp_path / "state" / "vpn")
    made.gateway.put("/etc/sudoers.d/test", f"{ACCOUNT} ALL=(ALL) NOPASSWD: ALL\n", mode="0440")
    made.gateway.put("/etc/systemd/system/chrony.service.d/test.conf", FREE_CLOCK)
    made.gateway.put(READER, SERVICE)
    made.gateway.run("systemctl daemon-reload")
    done = made.run()
    assert done["status"] == "changed", done["message"]
    assert made.run()["changes"] == []
    # No server answers: somebody else's interface stands for the tunnel.
    made.gateway.run("ip tuntap add dev tun0 mode tun; ip address add 10.80.0.21/16 dev tun0")
    made.gateway.put(CHRONYC, FOLLOWS, mode="0755")
    made.gateway.run("systemctl start atlantis-data-gateway")
    return made


def test_each_check_detects_only_its_own_violation(stand: Stand) -> None:
    before, after = replace(stand.gateway.traffic), stand.gateway.traffic
    assert checked(stand, user=ACCOUNT) == {}
    assert after.connections == before.connections + 1
    assert after.up_bytes + after.down_bytes < before.up_bytes + before.down_bytes + 30_000
    for breach in BREACHES:
        stand.gateway.run(breach)
    stand.gateway.fill_disk(leave_kb=150_000)
    seen = checked(stand, user=ACCOUNT)
    assert seen.keys() == {*BREACHES.values(), ROOM}
    assert all(words.startswith("AssertionError: ") for words in seen.values())
    sshd = seen["test_sshd_obeys[coastal-gateway]"]
    assert "sshd has passwordauthentication yes, declared is no: another file in /etc/ssh/sshd_config.d/" in sshd

    stand.known.write_text(f"{NAME} {OTHER_KEY}\n")
    unknown = checked(stand, "-k", "room or chrony", user=ACCOUNT)
    assert len(unknown) == 4
    refused = "coastal-gateway is unreachable: it shows a different SSH host key than before"
    assert all(refused in words for words in unknown.values())
    assert all("`ssh-keygen -R coastal-gateway`" in words for words in unknown.values())
