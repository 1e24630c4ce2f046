"""`provision robot validate`: what is typed, what is printed, and how it ends."""

import json
import shutil
from pathlib import Path

import pytest
import robot_cases
from hints_said import advised, said

from atlantis_netcfg.checklist.runner.simulated.robots import SimulatedRobots
from atlantis_netcfg.cli import main
from atlantis_netcfg.core.errors import ExitCode
from atlantis_netcfg.core.events import Verdict
from atlantis_netcfg.inventory import load
from atlantis_netcfg.links import LinkFinding
from atlantis_netcfg.operations import robots
from atlantis_netcfg.robots.observation import RobotObservation, RobotReport, RobotState

CANARY = "canary-of-a-token"


@pytest.fixture
def inventory(tmp_path: Path) -> Path:
    return shutil.copytree(robot_cases.SHIPPED, tmp_path / "inventory")


def partners(inventory: Path, folder: Path, name: str = "sparus.yml") -> Path:
    """A file as a partner sends it, with a real token and for its owner alone."""
    file = folder / name
    file.write_text((inventory / "robots" / "sparus.yml").read_text().replace("EXAMPLE-sparus-token", CANARY))
    file.chmod(0o600)
    return file


def test_every_robot_of_the_inventory_is_checked(inventory: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["robot", "validate", f"inventory={inventory}"]) == ExitCode.DONE
    shown = capsys.readouterr().out
    assert "6 robot files: no errors. What a robot actually publishes was not checked." in shown
    assert "zarco.yml: zarco, vehicle zarco" in shown
    assert "      before registration it sends its configuration at 1 Hz:" in shown


def test_one_robot_is_checked(inventory: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["robot", "validate", "vehicle=eca-rov", f"inventory={inventory}", "--json"]) == ExitCode.DONE
    document = json.loads(capsys.readouterr().out)
    (robot,) = document["robots"]
    assert (document["exit"], document["errors"]) == (0, [])
    assert (robot["vehicle"], robot["namespace"]) == ("eca-rov", "eca_rov")
    assert robot["actions"] == {
        "/eca_rov/lights": "c4i_asset_msgs/action/CommandBool",
        "/eca_rov/hold_depth": "c4i_asset_msgs/action/CommandNumeric",
    }


@pytest.mark.parametrize("more", [(), ("--json",)], ids=["text", "json"])
def test_a_partner_s_token_is_never_shown(
    inventory: Path, tmp_path: Path, more: tuple[str, ...], capsys: pytest.CaptureFixture[str]
) -> None:
    file = partners(inventory, tmp_path)
    assert main(["robot", "validate", str(file), f"inventory={inventory}", *more]) == ExitCode.DONE
    printed = capsys.readouterr()
    assert "sparus" in printed.out
    assert CANARY not in printed.out + printed.err
    broken = tmp_path / "broken.yml"
    broken.write_text(file.read_text().replace("token:", "tokem:").replace("pose:", "posse:"))
    assert main(["robot", "validate", str(broken), f"inventory={inventory}", *more]) == ExitCode.USAGE
    printed = capsys.readouterr()
    assert "did you mean `token`?" in printed.out + printed.err
    assert CANARY not in printed.out + printed.err


def test_a_file_that_others_can_read_is_a_warning(
    inventory: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = partners(inventory, tmp_path)
    file.chmod(0o644)
    assert main(["robot", "validate", str(file), f"inventory={inventory}"]) == ExitCode.DONE
    shown = capsys.readouterr().out
    assert "other users of this computer can read `token`" in shown
    assert f"chmod 600 {file}" in shown
    assert "1 warning in robot files" in shown


def test_two_files_of_one_namespace_are_refused(
    inventory: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    files = [str(partners(inventory, tmp_path, name)) for name in ("one.yml", "two.yml")]
    assert main(["robot", "validate", *files, f"inventory={inventory}"]) == ExitCode.USAGE
    assert f"{files[1]}:5:12: another robot has this namespace: {files[0]}:5" in capsys.readouterr().err


def test_example_values_in_a_given_file_are_refused(
    inventory: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    copy = tmp_path / "copy.yml"
    copy.write_text((inventory / "robots" / "sparus.yml").read_text())
    assert main(["robot", "validate", str(copy), f"inventory={inventory}"]) == ExitCode.USAGE
    assert f"{copy}:6:8: `token` is still an example" in capsys.readouterr().err


def test_errors_have_locations_in_json(inventory: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = inventory / "robots" / "mares.yml"
    file.write_text(file.read_text().replace("topic: leak", "topic: leak/"))
    assert main(["robot", "validate", f"inventory={inventory}", "--json"]) == ExitCode.USAGE
    document = json.loads(capsys.readouterr().out)
    assert [(Path(each["file"]).name, each["line"]) for each in document["errors"]] == [("mares.yml", 11)]
    assert document["exit"] == ExitCode.USAGE


def test_inventory_validation_includes_its_robots(inventory: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = inventory / "robots" / "mares.yml"
    text = file.read_text()
    file.write_text(text.replace(", unit: m}", "}"))
    assert main(["inventory", "validate", f"inventory={inventory}"]) == ExitCode.DONE
    assert "the number `depth` has no `unit`" in capsys.readouterr().out
    file.write_text(text.replace("namespace: mares", "namespace: sparus"))
    assert main(["inventory", "validate", f"inventory={inventory}"]) == ExitCode.USAGE
    assert "another robot has this namespace" in capsys.readouterr().err


def test_vehicle_typed_as_a_file_gets_the_right_suggestion(inventory: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["robot", "validate", "sparus", f"inventory={inventory}"]) == ExitCode.USAGE
    (line,) = advised(said(capsys.readouterr().err, "run `provision robot validate vehicle={}`"))
    assert main(line) == ExitCode.DONE


@pytest.mark.parametrize(
    ("line", "code", "words"),
    [
        (("nowhere.yml",), ExitCode.NOTHING, "nowhere.yml cannot be read: no such file or directory"),
        (("a.yml", "vehicle=sparus"), ExitCode.USAGE, "a file and `vehicle=` cannot be used together"),
        (("vehicle=sparrus",), ExitCode.USAGE, "no such vehicle: `sparrus`"),
    ],
    ids=["no file", "both", "no vehicle"],
)
def test_invalid_command_lines(
    line: tuple[str, ...], code: ExitCode, words: str, inventory: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["robot", "validate", *line, f"inventory={inventory}"]) == code
    assert words in capsys.readouterr().err


def test_terminal_escapes_from_a_file_or_a_robot_are_not_printed(
    inventory: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    file = inventory / "robots" / "mares.yml"
    file.write_text(file.read_text().replace("namespace: mares", 'namespace: "mares\\e[2J\\u202e"'))
    assert main(["robot", "validate", f"inventory={inventory}"]) == ExitCode.USAGE
    printed = capsys.readouterr()
    assert "is not a ROS name" in printed.err

    finding = LinkFinding(Verdict.FAIL, "code", "the host \x1b[2J\u202e says so", "")
    report = RobotReport("\x1b]0;mares\x07", RobotState.UNKNOWN, None, (finding,))
    monkeypatch.setattr(robots, "discover", lambda *_: (RobotObservation(5.0, {"key": "\x1b[2J"}), [report]))
    assert main(["robot", "discover", "site=coastal", f"inventory={inventory}"]) == ExitCode.CHECKS_FAILED
    heard = capsys.readouterr().out
    assert "says so" in heard
    assert [sign for sign in ("\x1b", "\x07", "\u202e") if sign in printed.out + printed.err + heard] == []


@pytest.mark.parametrize("vehicles", ["zarco", "sparus,zarco"])
def test_vehicle_without_a_file_is_not_mocked(
    vehicles: str, inventory: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (inventory / "robots" / "zarco.yml").unlink()
    assert main(["robot", "mock", f"vehicle={vehicles}", "for=5s", f"inventory={inventory}"]) == ExitCode.NOTHING
    assert "robots/zarco.yml, which lists what `zarco` publishes, does not exist" in capsys.readouterr().err


@pytest.mark.parametrize("address", ["foo", '127.0.0.1"/><x'])
def test_mock_address_must_be_ipv4(address: str, inventory: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["robot", "mock", f"address={address}", "for=5s", f"inventory={inventory}"]) == ExitCode.USAGE
    assert f"`address={address}` is not an IPv4 address" in capsys.readouterr().err


def test_tested_vehicle_without_a_file_is_named_and_fails(
    inventory: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (inventory / "robots" / "zarco.yml").unlink()
    honest = SimulatedRobots.honest(load(robot_cases.SHIPPED), "coastal").here
    monkeypatch.setattr(robots, "discover", lambda *_: (honest, robots.compare(load(inventory), "coastal", honest)))
    assert main(["robot", "discover", "site=coastal", f"inventory={inventory}", "--json"]) == ExitCode.CHECKS_FAILED
    rows = json.loads(capsys.readouterr().out)["robots"]
    missing = [each for each in rows if each["vehicle"] == "zarco"]
    assert [(each["state"], [found["code"] for found in each["findings"]]) for each in missing] == [
        ("missing", ["file-missing"])
    ]


def test_missing_robot_files_are_reported(inventory: Path, capsys: pytest.CaptureFixture[str]) -> None:
    shutil.rmtree(inventory / "robots")
    assert main(["robot", "validate", f"inventory={inventory}"]) == ExitCode.NOTHING
    assert "<vehicle>.yml" in capsys.readouterr().err
