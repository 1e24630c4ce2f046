"""Recordings of a robot by a real rsync, rrsync and sshd: admitted by its owner's line, lost on the way, compared."""

import pytest
from gateway_stand import Start, ground, machine, technician  # noqa: F401 - fixtures
from retrieval_stand import BAGS, COLLECTED, MB, ROBOT, Ends, ends

from atlantis_netcfg.computers.retrieval import line_for_robot
from atlantis_netcfg.core.errors import ExitCode
from atlantis_netcfg.emulator.lab import Lab, Machine
from atlantis_netcfg.inventory.model import RetrievalRobot
from atlantis_netcfg.operations.retrieve import RetrievalStatus, source_at

pytestmark = [pytest.mark.slow, pytest.mark.namespace]
KEPT = f"/srv/recordings/{ROBOT}"


def admit(made: Ends, robot: Machine) -> None:
    """What the robot's owner does with the printed line."""
    source, _ = source_at(made.declaration, "coastal", ROBOT)
    assert isinstance(source, RetrievalRobot)
    robot.put("/home/recorder/.ssh/authorized_keys", line_for_robot(made.declaration, source) + "\n", mode="0644")


def on_gateway(made: Ends) -> str:
    """Files of the robot that are on the gateway, whole or begun."""
    folders = f"{COLLECTED} {COLLECTED.replace(ROBOT, '.partial/' + ROBOT)}"
    return made.gateway.run(f"find {folders} -type f", check=False).stdout


def test_robot_data_is_collected_first_and_kept_after_it_leaves(
    ground: Lab,  # noqa: F811 - a fixture
    machine: Start,  # noqa: F811 - a fixture
) -> None:
    made = ends(ground, machine, robot=True)
    robot = made.robot
    assert robot is not None
    made.record("dive 1/a.db3", 3 * MB)
    made.record("dive 1/metadata.yaml", 400)
    made.record("dive 2/writing.db3", 1000, age_s=-900)
    look = made.ask("look", pattern="*", again=False)
    assert (look["robot"]["state"], look["robot"]["kind"]) == ("refused", "key"), look

    admit(made, robot)
    begun = f"{COLLECTED.replace(ROBOT, '.partial/' + ROBOT)}/dive 1"
    stamp = robot.run(f"stat -c %Y '{BAGS}/dive 1/metadata.yaml'").stdout.strip()
    spoil = f"head -c 400 /dev/zero > '{begun}/metadata.yaml' && touch -d @{stamp} '{begun}/metadata.yaml'"
    made.gateway.run(f"mkdir -p '{begun}' && {spoil}")
    before = made.digests(robot, BAGS)
    stamps = robot.run(f"find {BAGS} -printf '%p %T@ %m %u\\n'").stdout
    look = made.start(rate_bps=8 * MB)
    assert (look["files"], look["bytes"], look["writing"]) == (2, 3 * MB + 400, 1)
    assert (look["robot"]["files"], look["robot"]["bytes"]) == (2, 3 * MB + 400)
    told = made.ended()
    assert (told["state"], told["arrived"]) == ("done", 2), told
    there = made.digests(made.centre, KEPT)
    assert there == {name: digest for name, digest in before.items() if not name.startswith("dive 2")}
    assert on_gateway(made) == "", "the copy goes when the control centre has the file"
    assert made.digests(robot, BAGS) == before
    assert robot.run(f"find {BAGS} -printf '%p %T@ %m %u\\n'").stdout == stamps, "nothing is changed on the robot"
    assert made.ask("look", pattern="*", again=False)["kept"] == 2, "and is not collected again"

    robot.run("tc qdisc add dev eth0 root tbf rate 8mbit burst 10kb latency 50ms")
    made.record("dive 3/c.db3", 4 * MB)
    start = int(robot.run("cat /sys/class/net/eth0/statistics/tx_bytes").stdout)
    made.start()
    made.until(lambda told: told.get("collected_bytes", 0) > 1.5 * MB)
    made.cut(robot)
    told = made.ended()
    assert {name: paths for name, paths in told["left"].items() if paths} == {"robot": ["dive 3/c.db3"]}
    assert (told["state"], told["arrived"]) == ("done", 0)
    assert RetrievalStatus(told, None, ROBOT).exit == ExitCode.CHECKS_FAILED, "what is still on the robot is not green"
    assert made.ask("look", pattern="*", again=False)["robot"]["state"] == "away"
    made.cut(robot, up=True)
    made.start()
    assert made.ended()["arrived"] == 1
    sent = int(robot.run("cat /sys/class/net/eth0/statistics/tx_bytes").stdout) - start
    assert 4 * MB < sent < 5 * MB, "what had come before it went is not fetched again"
    assert made.digests(made.centre, f"{KEPT}/dive 3") == made.digests(robot, f"{BAGS}/dive 3")

    for words in (("id",), ("rsync --server -te.LsfxCIvu . .",), ("-s", "sftp")):
        code, text = made.log_in("recorder@10.64.1.22", *words)
        assert (code != 0, text) == (True, ""), "the owner's line admits reading alone"
