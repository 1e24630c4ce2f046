"""A stranger is approved by a person: it becomes a guest with a file of its own, until its last day."""

import json
import shutil
from collections.abc import Sequence
from datetime import UTC, datetime, timedelta, tzinfo
from pathlib import Path

import pytest
import robot_cases
from ansible.parsing.vault import VaultLib, VaultSecret
from hints_said import advised
from vpn_desk import PASSPHRASE, founded, over_a_pipe

from atlantis_netcfg.cli import main
from atlantis_netcfg.cli.base import passphrase
from atlantis_netcfg.cli.vpn import _common
from atlantis_netcfg.core.errors import NoMatchError, UsageError
from atlantis_netcfg.core.secret import Secret
from atlantis_netcfg.inventory import Inventory, InventoryInvalid, load
from atlantis_netcfg.inventory.robots import reading
from atlantis_netcfg.inventory.robots.key_names import KeyNames
from atlantis_netcfg.operations import robots
from atlantis_netcfg.operations.common.vault import Vault
from atlantis_netcfg.operations.vpn.server import NoPush
from atlantis_netcfg.robots.mock import RATES_HZ
from atlantis_netcfg.robots.observation import (
    HeardConfiguration,
    HeardWriter,
    RobotObservation,
    RobotReport,
    RobotState,
)

UNTIL = datetime.now(UTC).date() + timedelta(days=20)
TOKEN = "lauv-says-so"
SECONDS = 30.0


def stranger(namespace: str = "lauv", participant: str = "key") -> RobotObservation:
    """A robot that publishes a configuration like that of Sparus, and all that it says."""
    (sparus,) = [each for each in reading.read_declared(robot_cases.shipped(), KeyNames()) if each.vehicle == "sparus"]
    text = sparus.text().replace("namespace: sparus", f"namespace: {namespace}").replace("EXAMPLE-sparus-token", TOKEN)
    robot, _ = reading.read_published(text.encode(), KeyNames())
    assert robot is not None

    def writer(topic: str, kind: str, rate_hz: float) -> HeardWriter:
        count = int(SECONDS * rate_hz)
        made = HeardWriter(participant, topic, kind, messages=count, octets=count, last_s=(count - 1) / rate_hz)
        made.contents |= {b"1", b"2"}
        return made

    configuration = HeardConfiguration(writer("/atlantis/configuration", "std_msgs/msg/String", 1.0), text.encode())
    topics = [writer(each.name, each.message_type, RATES_HZ[each.kind]) for each in robot.topics()]
    return RobotObservation(SECONDS, {participant: "10.64.1.30"}, topics, [configuration])


def compared(inventory: Path, observation: RobotObservation) -> RobotReport:
    reports = robots.compare(load(inventory, decrypt=Vault().decrypt), "coastal", observation)
    return next(each for each in reports if each.namespace == "lauv")


def filled_in(words: Sequence[str]) -> list[str]:
    """What the person knows who approves it."""
    own = {"partner=PARTNER": "partner=udg", "until=DAY": f"until={UNTIL}"}
    return [own.get(word, word) for word in words]


@pytest.fixture
def pier(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    shutil.copytree(robot_cases.SHIPPED, tmp_path / "inventory")
    shutil.copytree(founded(tmp_path) / "vpn", tmp_path / "vpn")
    (tmp_path / "password").write_text("of the vault\n")
    monkeypatch.setattr(_common, "server", lambda *_: NoPush())
    monkeypatch.setenv("ATLANTIS_STATE", str(tmp_path / "state"))
    monkeypatch.setattr("ansible.constants.DEFAULT_VAULT_PASSWORD_FILE", str(tmp_path / "password"))
    return tmp_path


def test_suggested_commands_admit_an_unknown_robot_until_its_last_day(
    pier: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    inventory = pier / "inventory"
    report = compared(inventory, stranger())
    assert (report.state, [each.code for each in report.findings]) == (RobotState.UNKNOWN, ["robot-unknown"])
    add, save = advised(str(report.findings[0].hint))
    places = [f"inventory={inventory}", f"authority={pier / 'vpn'}"]
    with over_a_pipe(PASSPHRASE) as number:
        assert main([*filled_in(add), *places, "--no-push", "--passphrase-fd", number]) == 0
    assert compared(inventory, stranger()).state is RobotState.UNKNOWN, "it has no file yet"
    monkeypatch.setattr(robots, "discover", lambda *_: (stranger(), []))
    assert main([*save, f"inventory={inventory}"]) == 6
    printed = capsys.readouterr()
    text = (inventory / "robots" / "lauv.yml").read_text()
    assert TOKEN not in text + printed.out + printed.err
    assert "token: !vault |\n  $ANSIBLE_VAULT;1." in text
    report = compared(inventory, stranger())
    assert (report.state, report.vehicle, report.findings) == (RobotState.DECLARED, "lauv", ())
    other = stranger()
    other.configurations[0].text = other.configurations[0].text.replace(TOKEN.encode(), b"somebody-else")
    assert [each.code for each in compared(inventory, other).findings] == ["token"], "the vault is open"
    assert "lauv" in robots.expected_at(load(inventory), "coastal")
    assert "lauv" not in robots.expected_at(load(inventory), "te4sea")
    monkeypatch.setattr(reading, "datetime", _Later)
    report = compared(inventory, stranger())
    assert (report.state, [each.code for each in report.findings]) == (RobotState.UNKNOWN, ["robot-unknown"])
    assert report.findings[0].message == f"it was a guest until {UNTIL}"
    assert "lauv" not in robots.expected_at(load(inventory), "coastal")
    (end,) = advised(str(report.findings[0].hint))
    with over_a_pipe(PASSPHRASE) as number:
        assert main([*end, *places, "--yes", "--no-push", "--passphrase-fd", number]) in {0, 5}
    assert "lauv" not in load(inventory).vehicles
    assert not (inventory / "robots" / "lauv.yml").exists()
    assert compared(inventory, stranger()).findings[0].message == "no robot of this inventory has the namespace `lauv`"


def impostor() -> RobotObservation:
    """The stranger with a token of its own."""
    made = stranger()
    made.configurations[0].text = made.configurations[0].text.replace(TOKEN.encode(), b"somebody-else")
    return made


@pytest.mark.parametrize(
    ("observation", "ending"),
    [(stranger(), (0, "PASS", [])), (impostor(), (6, "FAIL", ["token"]))],
    ids=["itself", "impostor"],
)
def test_vaulted_token_is_compared_only_if_the_vault_is_open(
    observation: RobotObservation,
    ending: tuple[int, str, list[str]],
    pier: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    inventory = pier / "inventory"
    sealed = VaultLib([("default", VaultSecret(b"of the vault"))]).encrypt(TOKEN.encode()).decode()
    shutil.rmtree(inventory / "robots")
    (inventory / "robots").mkdir()
    own = stranger().configurations[0].text.decode()
    file = inventory / "robots" / "sparus.yml"
    file.write_text(own.replace(TOKEN, "!vault |\n  " + sealed.strip().replace("\n", "\n  ")))
    monkeypatch.setattr(robots, "expected_at", lambda *_: ["sparus"])

    def discover(declaration: Inventory, site: str, *_: object) -> tuple[RobotObservation, list[RobotReport]]:
        return observation, robots.compare(declaration, site, observation)

    monkeypatch.setattr(robots, "discover", discover)

    def ended(*words: str) -> tuple[int, str, list[str]]:
        code = main([*words, f"inventory={inventory}", "--json"])
        (found,) = json.loads(capsys.readouterr().out)["robots"]
        hints[:] = [each["hint"] for each in found["findings"]]
        return code, found["verdict"], [each["code"] for each in found["findings"]]

    hints: list[str] = []
    assert ended("robot", "discover", "site=coastal") == ending
    monkeypatch.setattr("ansible.constants.DEFAULT_VAULT_PASSWORD_FILE", None)
    assert ended("robot", "discover", "site=coastal") == (0, "WARN", ["token-sealed"])
    (line,) = advised(hints[0])
    monkeypatch.setattr("sys.stdin.isatty", lambda: True)
    monkeypatch.setattr(passphrase, "_read_secret", lambda _: Secret("of the vault"))
    assert ended(*line) == ending


class _Later(datetime):
    """The day after the guest's last one."""

    @classmethod
    def now(cls, tz: tzinfo | None = None) -> datetime:  # type: ignore[override] # as datetime has it
        return datetime(UNTIL.year, UNTIL.month, UNTIL.day, tzinfo=tz) + timedelta(days=1)


def test_missing_vault_password_is_refused_before_listening(
    pier: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("ansible.constants.DEFAULT_VAULT_PASSWORD_FILE", None)
    monkeypatch.setattr(robots, "discover", lambda *_: pytest.fail("it has listened"))
    assert main(["robot", "discover", "site=coastal", "save=lauv", f"inventory={pier / 'inventory'}", "--json"]) == 3
    assert "there is no password for them" in capsys.readouterr().out


def test_file_is_saved_only_for_a_declared_robot_seen_once(pier: Path) -> None:
    declaration = load(pier / "inventory")
    twice = stranger()
    twice.configurations += stranger(participant="other").configurations
    for namespace, observation, message in (
        ("lauv", stranger(), "no such vehicle: `lauv`; no file was written"),
        ("other", stranger(), "0 robots use the namespace `other`, so no file was written"),
        ("lauv", twice, "2 robots use the namespace `lauv`, so no file was written"),
    ):
        with pytest.raises(NoMatchError, match=message):
            robots.save(declaration, namespace, observation, lambda text: text)
    with pytest.raises(UsageError, match="already exists"):
        robots.save(declaration, "zarco", stranger("zarco"), lambda text: text)
    (pier / "inventory" / "robots" / "zarco.yml").unlink()
    with pytest.raises(InventoryInvalid):
        robots.save(declaration, "zarco", stranger("zarco"), lambda _: "no vault")
    assert not (pier / "inventory" / "robots" / "zarco.yml").exists()
