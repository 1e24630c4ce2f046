"""Mock robots and a listener, as processes in a network namespace: all are heard, and every lie has its finding."""

import json
import os
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import pytest

if find_spec("cyclonedds") is None:
    pytest.skip("PyPI has no cyclonedds for this machine", allow_module_level=True)
pytestmark = [
    pytest.mark.slow,
    pytest.mark.namespace,
    pytest.mark.skipif(os.geteuid() != 0, reason="making a network namespace needs root"),
]
HERE = Path(__file__).parent
PROVISION = Path(sys.executable).parent / "provision"
ALONE = ("unshare", "--net", "sh", "-c")


def alone(script: str, *words: str) -> subprocess.CompletedProcess[str]:
    """Run a script where there is a loopback and nothing else."""
    return subprocess.run(
        [*ALONE, f"ip link set lo up && {script}", "sh", *words],
        capture_output=True,
        text=True,
        check=False,
        timeout=120,
    )


@pytest.mark.smoke
def test_six_mock_robots_are_discovered_as_declared() -> None:
    script = '"$1" robot mock for=25s >"$2" 2>&1 & "$1" robot discover site=coastal for=12s address=127.0.0.1 --json'
    done = alone(script, str(PROVISION), "/dev/null")
    assert done.returncode == 0, done.stderr + done.stdout
    document = json.loads(done.stdout)
    assert len(document["participants"]) == 6
    assert {robot["vehicle"]: (robot["state"], robot["findings"]) for robot in document["robots"]} == dict.fromkeys(
        ("eca-rov", "girona500", "mares", "sparus", "stork", "zarco"), ("declared", [])
    )
    (sparus,) = (robot for robot in document["robots"] if robot["vehicle"] == "sparus")
    pose, fix = sparus["topics"]["/sparus/pose"], sparus["topics"]["/sparus/fix"]
    assert (pose["type"], pose["bytes"]) == ("geometry_msgs/msg/Pose", 60)
    assert 1.8 <= pose["rate_hz"] <= 2.2
    assert fix["type"] == "sensor_msgs/msg/NavSatFix"
    assert "EXAMPLE-sparus-token" not in done.stdout


@pytest.mark.slow
def test_checklist_detects_robots_in_the_lan_of_its_site(tmp_path: Path) -> None:
    """All but one of six are there; who is in the VPN, and what the control centre hears, nobody can say here."""
    lan = "ip link add lan0 type veth peer name lan1 && ip address add 10.64.1.99/24 dev lan0"
    up = "ip link set lan0 up && ip link set lan1 up"
    mocks = '"$1" robot mock vehicle=eca-rov,girona500,mares,sparus,stork for=40s address=10.64.1.99'
    script = f'{lan} && {up} && {{ {mocks} >"$4" 2>&1 & "$2" -P "$3" "$5"; code=$?; kill $!; wait; exit $code; }}'
    words = (str(PROVISION), sys.executable, str(HERE / "checklist_heard.py"), "/dev/null", str(tmp_path))
    done = alone(script, *words)
    assert done.returncode == 0, done.stderr
    items = json.loads(done.stdout)
    verdicts = {name: verdict for name, (verdict, *_) in items.items()}
    here = ("eca-rov", "girona500", "mares", "sparus", "stork")
    for name in here:
        heard = {key: verdicts[f"{name}/robot/{key}"] for key in ("discovered", "telemetry", "rates")}
        assert heard == dict.fromkeys(heard, "PASS"), items
    assert {verdicts[f"{name}/robot/pose"] for name in here[1:]} == {"PASS"}
    assert {verdicts[f"zarco/robot/{key}"] for key in ("discovered", "telemetry", "pose", "rates")} == {"INCONCLUSIVE"}
    assert verdicts["coastal/robot/strangers"] == "PASS"
    unknown = [name for name in verdicts if name.endswith(("/vpn", "/control-centre"))]
    assert len(unknown) == 12
    assert {verdicts[name] for name in unknown} == {"INCONCLUSIVE"}
    assert "token" not in done.stdout.lower()


@pytest.mark.smoke
def test_empty_network_is_not_green() -> None:
    done = alone('"$1" robot discover site=coastal for=5s address=127.0.0.1', str(PROVISION))
    assert done.returncode == 6, done.stderr
    assert "participants of domain 0 received in 5 s: 0" in done.stdout
    assert "this proves nothing: is a robot switched on, in this network and in this domain?" in done.stdout
    assert not done.stderr, "Cyclone DDS would write a line for each datagram that does not leave"
    assert done.stdout.count("INCONCLUSIVE") == 12, "six robots, and what is said of each"


def test_an_address_that_is_not_here_is_refused() -> None:
    done = alone('"$1" robot mock for=5s address=10.64.1.99', str(PROVISION))
    assert done.returncode == 3
    assert "a DDS participant cannot be created here:" in done.stderr


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("mock", "site=coastal"), "the inventory still contains example values"),
        (("discover", "site=coastal"), "the inventory still contains example values"),
        (("discover", "site=coastal", "address=10.64.1"), "`address=10.64.1` is not an IPv4 address"),
    ],
)
def test_no_packet_is_sent_to_example_addresses(words: tuple[str, ...], message: str) -> None:
    done = alone('"$@"', str(PROVISION), "robot", *words, "for=5s")
    assert done.returncode == 3
    assert message in done.stderr


@pytest.fixture(scope="module")
def lies() -> dict[str, Any]:
    """What is heard of robots that lie, each in one way."""
    done = alone('"$1" -P "$2" 16', sys.executable, str(HERE / "liars.py"))
    assert done.returncode == 0, done.stderr
    document: dict[str, Any] = json.loads(done.stdout)
    return document


EVERYTHING = dict.fromkeys(("discovery", "booleans", "numbers", "pose", "gps", "images"), "INCONCLUSIVE")
RECORD: dict[str, dict[str, str]] = {
    "honest": {},
    "seldom": {"discovery": "FAIL"},
    "often": {"numbers": "WARN"},
    "missing_topic": {"booleans": "FAIL"},
    "wrong_type": {"numbers": "FAIL"},
    "frozen": {"pose": "FAIL"},
    "stale": {"gps": "FAIL"},
    "wrong_token": {"discovery": "FAIL"},
    "other_file": {"discovery": "FAIL"},
    "twice": {"discovery": "FAIL"},
    "leaving": {},
    "away": EVERYTHING,
    "outside": {"vpn": "FAIL"},
    "without_configuration": EVERYTHING,
    "pose_missing": {"pose": "FAIL"},
    "boolean_silent": {"booleans": "FAIL"},
    "boolean_stale": {"booleans": "FAIL"},
    "image_type": {"images": "FAIL"},
    "image_seldom": {"images": "WARN"},
    "pose_often": {"pose": "WARN"},
}


def test_deviation_changes_exactly_its_items_of_the_integration_record(lies: dict[str, Any]) -> None:
    assert lies["record"] == RECORD
    assert lies["text"] is False, "no token is told"


def test_each_deviation_has_exactly_its_finding(lies: dict[str, Any]) -> None:
    robots = dict(lies["robots"])
    unreadable = [name for name, (state, *codes) in robots.items() if codes == ["configuration-unreadable"]]
    assert (len(unreadable), lies["unreadable"]) == (1, 2), "two, at one address"
    del robots[unreadable[0]]
    assert robots == {
        "honest": ["declared"],
        "seldom": ["declared", "configuration-rate"],
        "often": ["declared", "topic-rate-above"],
        "missing_topic": ["declared", "topic-missing"],
        "wrong_type": ["declared", "topic-type"],
        "frozen": ["declared", "topic-frozen"],
        "stale": ["declared", "topic-stale"],
        "wrong_token": ["declared", "token"],
        "other_file": ["declared", "configuration-differs"],
        "stranger": ["unknown", "robot-unknown"],
        "twice": ["declared", "namespace-twice"],
        "leaving": ["declared"],
        "away": ["missing", "robot-missing"],
        "outside": ["declared"],
        "without_configuration": ["missing", "configuration-missing"],
        "pose_missing": ["declared", "topic-missing"],
        "boolean_silent": ["declared", "topic-silent"],
        "boolean_stale": ["declared", "topic-stale"],
        "image_type": ["declared", "topic-type"],
        "image_seldom": ["declared", "topic-rate-below"],
        "pose_often": ["declared", "topic-rate-above"],
    }


@pytest.mark.slow
def test_robots_switched_off_during_discovery_do_no_harm() -> None:
    script = '"$1" robot mock for=6s >"$2" 2>&1 & "$1" robot discover site=coastal for=12s address=127.0.0.1 --json'
    done = alone(script, str(PROVISION), "/dev/null")
    assert done.returncode == 0, done.stderr
    assert {each["state"] for each in json.loads(done.stdout)["robots"]} == {"declared"}
