"""The role `gateway_dds` on a real Debian with systemd, by SSH: profiles, environment, and who reads them anew."""

from pathlib import Path

import pytest
from gateway_role import Stand
from gateway_stand import Key, Start, ground, machine, technician  # noqa: F401 - fixtures

pytestmark = [pytest.mark.namespace, pytest.mark.slow]

READER = "atlantis-data-gateway.service"
UNIT = "[Service]\nEnvironmentFile=-/etc/atlantis/ros.env\nExecStart=/bin/sleep infinity\n"
LINKS = {"wifi-ptp", "4g", "satellite"}


@pytest.fixture
def stand(machine: Start, technician: Key, tmp_path: Path) -> Stand:  # noqa: F811 - fixtures
    """A gateway on which the data gateway runs, as the role before this one has left it."""
    made = Stand(machine("coastal-gateway"), technician, tmp_path, ["gateway_dds"])
    made.gateway.put(f"/etc/systemd/system/{READER}", UNIT)
    made.gateway.run(f"systemctl start {READER}")
    return made


def environment(stand: Stand, of: str) -> set[str]:
    """What ROS reads of it: `login` is a person's shell, `service` the data gateway."""
    asked = {
        "login": "env -i sh -lc env",
        "service": f"tr '\\0' '\\n' </proc/$(systemctl show -p MainPID --value {READER})/environ",
    }
    return {
        line for line in stand.gateway.run(asked[of]).stdout.splitlines() if line.startswith(("ROS", "RMW", "FAST"))
    }


def test_dds_profiles_are_installed_changed_and_removed(stand: Stand) -> None:
    planned = stand.run("--check")
    assert stand.gateway.run("ls /etc/atlantis", check=False).stdout == ""
    laid = stand.run()
    assert planned["changes"] == laid["changes"]
    files = {change.removeprefix("file ") for change in laid["changes"] if change.startswith("file ")}
    assert files == {
        "/etc/atlantis/ros.env",
        "/etc/profile.d/atlantis-rosenv.sh",
        *(
            f"/etc/atlantis/dds/{link}/{name}"
            for link in LINKS
            for name in ("cyclonedds.xml", "fastdds.xml", "ros.env")
        ),
    }
    assert laid["changes"][-1] == f"unit {READER} restarted"
    declared = {
        "FASTRTPS_DEFAULT_PROFILES_FILE=/etc/atlantis/dds/satellite/fastdds.xml",
        "RMW_IMPLEMENTATION=rmw_fastrtps_cpp",
        "ROS_DOMAIN_ID=0",
        "ROS_LOCALHOST_ONLY=0",
    }
    assert environment(stand, "login") == environment(stand, "service") == declared
    assert stand.run()["changes"] == []

    stand.declare({"dds": {"distribution": "humble", "domain": 7, "middleware": "rmw_cyclonedds_cpp"}})
    stand.gateway.put("/etc/environment", "ROS_LOCALHOST_ONLY=1\n")
    changed = stand.run()
    (note,) = changed["notes"]
    assert note.startswith("line 1 of /etc/environment sets ROS_LOCALHOST_ONLY=1: ROS 2 then sees nothing beyond")
    assert note.endswith("; remove that line and log in again")
    assert {"file /etc/atlantis/ros.env", f"unit {READER} restarted"} <= {*changed["changes"]}
    assert {"ROS_DOMAIN_ID=7", "RMW_IMPLEMENTATION=rmw_cyclonedds_cpp"} <= environment(stand, "service")
    assert stand.run()["changes"] == []

    stand.gateway.put("/etc/atlantis/dds/wifi-ptp/left-behind.xml", "<dds/>\n")
    stand.declare({"dds": None, "gateways": None})
    stand.publish_nothing()
    assert {change.split()[0] for change in stand.run()["changes"]} == {"absent", "unit"}
    assert stand.gateway.run(
        "find /etc/atlantis /etc/profile.d -name '*atlantis*' -o -name '*.xml'"
    ).stdout.split() == ["/etc/atlantis"]
    assert environment(stand, "login") == environment(stand, "service") == set()
    assert stand.run()["changes"] == []
