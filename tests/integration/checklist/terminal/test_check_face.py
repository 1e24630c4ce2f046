"""`pytest checks/` on a rehearsal: the checklist's items as tests, with JUnit out of the box."""

import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree as ET

import pytest

from atlantis_netcfg.cli import main
from atlantis_netcfg.core.paths import checkout

pytestmark = pytest.mark.slow

ROV = ("check", "site=coastal", "vehicle=eca-rov", "--rehearse")


def checks(*words: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "pytest", "checks/", "-p", "no:cacheprovider", "--site", "coastal", *words]
    return subprocess.run(command, cwd=checkout(), capture_output=True, text=True, check=False)


@pytest.mark.smoke
def test_items_are_reported_as_pytest_tests(tmp_path: Path) -> None:
    junit, answers = tmp_path / "checks.xml", tmp_path / "answers.yml"
    pose = "eca-rov/robot/pose: {verdict: PASS}"
    answers.write_text(f"name: A. Technician\nanswers:\n  eca-rov/usbl: {{verdict: WARN, note: it jumps}}\n  {pose}\n")
    assert main([*ROV, "--answers", str(answers)]) == 0
    done = checks(
        "--vehicle", "stork,eca-rov", "--endpoint=gps,ethernet,usbl,rc_rf", "--rehearse", f"--junitxml={junit}"
    )
    cases = {case.attrib["name"]: case for case in ET.parse(junit).getroot().iter("testcase")}  # noqa: S314 - ours
    assert {name: [child.tag for child in case if child.tag != "properties"] for name, case in cases.items()} == {
        "test_item[stork/rc_rf]": [],
        "test_item[stork/rc_rf/sticks]": ["skipped"],
        "test_item[stork/rc_rf/failsafe]": ["skipped"],
        "test_item[stork/rc_rf/range]": ["skipped"],
        "test_item[stork/gps]": [],
        "test_item[eca-rov/usbl]": [],
        "test_item[eca-rov/ethernet]": [],
    }, done.stdout
    assert done.returncode == 0, done.stdout
    why = cases["test_item[stork/rc_rf/range]"].find("skipped")
    assert why is not None
    assert why.attrib["message"] == "a person confirms this: provision check site=coastal"
    told = {one.attrib["name"]: one.attrib["value"] for one in cases["test_item[eca-rov/ethernet]"].iter("property")}
    assert (told["table3"], told["kind"], told["verdict"]) == ("false", "automatic", "PASS")
    assert told["evidence"]
    assert "eca-rov/usbl: A. Technician has seen that it works, but: it jumps" in done.stdout


def test_items_run_as_tests_without_extra_plugins() -> None:
    """Which has pytest, and none of the plug-ins that the tests of this toolkit need."""
    absent = [word for name in ("timeout", "xdist", "hypothesispytest") for word in ("-p", f"no:{name}")]
    done = checks("--vehicle", "sparus", "--endpoint", "gps", "--rehearse", *absent)
    assert "1 passed" in done.stdout, done.stdout + done.stderr
    assert done.returncode == 0


def test_real_run_is_refused_with_example_values() -> None:
    done = checks("--vehicle", "stork")
    assert done.returncode != 0
    assert (
        "the inventory still contains example values, which match no real device: it is for rehearsals only"
        in done.stdout
    )


def test_run_that_proves_nothing_is_not_green() -> None:
    done = checks("--vehicle", "stork", "--rehearse", "-k", "range")
    assert "1 skipped" in done.stdout
    assert done.returncode == pytest.ExitCode.NO_TESTS_COLLECTED
