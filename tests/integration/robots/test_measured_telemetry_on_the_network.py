"""`provision measure fit observed=…` beside mock robots in a network namespace: it writes what they publish."""

import json
import shutil
from pathlib import Path

import pytest
from test_robots_on_the_network import PROVISION, alone, pytestmark  # noqa: F401 - it marks this file as well

from atlantis_netcfg.inventory import load

SHIPPED = Path(__file__).parents[3] / "inventory"
KNOWN = {
    "pose": (60, 2.0),  # 4 of CDR, seven numbers of 8
    "motors_armed": (13, 2.0),  # 4, a stamp of 8, one
    "battery/voltage": (20, 2.0),  # 4, a stamp, a number
    "speed": (20, 2.0),
    "camera/image": (4848, 4.0),  # 4, 44 of its head, 80 by 60
    "fix": (117, 2.0),
    "lidar": (28, 0.5),  # 4, 16 of its head, two empty lists
}
"""Topic of Zarco to the bytes of a message and to its rate, as its mock publishes them."""


def inventory(folder: Path, *edits: tuple[str, str]) -> Path:
    own = shutil.copytree(SHIPPED, folder)
    file = own / "robots" / "zarco.yml"
    for old, new in edits:
        assert old in file.read_text()
        file.write_text(file.read_text().replace(old, new))
    return own


def test_measured_sizes_and_rates_match_the_mock(tmp_path: Path) -> None:
    own = inventory(tmp_path / "inventory")
    script = (
        '"$1" robot mock for=60s vehicle=zarco,sparus inventory="$2" >/dev/null 2>&1 & mock=$!; "$1" '
        'measure fit site=coastal vehicle=zarco observed=12s address=127.0.0.1 inventory="$2" --write --json; '
        "code=$?; kill $mock; wait $mock; exit $code"
    )
    done = alone(script, str(PROVISION), str(own))
    assert done.returncode == 6, "no link was measured"
    told = json.loads(done.stdout)
    assert (told["written"], told["observed"]["findings"], told["observed"]["others"]) == (
        "group_vars/all/vehicles.yml",
        [],
        [],
    )
    topics = load(own).vehicles["zarco"].telemetry
    assert [each.model_dump(mode="json") for each in topics] == told["observed"]["telemetry"]
    assert {each.topic.removeprefix("/zarco/") for each in topics} == KNOWN.keys()
    for each in topics:
        size, rate_hz = KNOWN[each.topic.removeprefix("/zarco/")]
        assert each.size_bytes == pytest.approx(size, rel=0.05), each
        assert each.rate_hz == pytest.approx(rate_hz, rel=0.05), each
    assert [each.topic for each in topics if each.reliable] == []
    links = {link["link"]: link["topics"] for link in told["links"]}
    assert [each["size_bytes"] for each in links["satellite"]] == [each.size_bytes for each in topics]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("edit", "vehicle", "message"),
    [
        (("EXAMPLE-zarco-token", "EXAMPLE-another"), "zarco", "its token differs from the one in its file"),
        (("label: ", "label: Another "), "zarco", "its configuration differs from its file"),
        (("namespace: zarco", "namespace: sparus"), "zarco", "no messages of `zarco` received at coastal"),
    ],
)
def test_robot_that_deviates_from_its_file_is_not_written(
    tmp_path: Path, edit: tuple[str, str], vehicle: str, message: str
) -> None:
    own, others = inventory(tmp_path / "inventory"), inventory(tmp_path / "others")
    file = others / "robots" / "zarco.yml"
    file.write_text(file.read_text().replace(*edit))
    if "namespace" in edit[0]:
        (others / "robots" / "sparus.yml").unlink()
    script = (
        '"$1" robot mock for=60s vehicle=zarco inventory="$3" >/dev/null 2>&1 & mock=$!; '
        '"$1" measure fit site=coastal "vehicle=$4" observed=9s address=127.0.0.1 inventory="$2" --write; '
        "code=$?; kill $mock; wait $mock; exit $code"
    )
    done = alone(script, str(PROVISION), str(own), str(others), vehicle)
    assert done.returncode == 6, done.stderr
    assert message in " ".join(done.stderr.split())
    assert load(own).vehicles == load(SHIPPED).vehicles
