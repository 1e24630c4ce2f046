"""The items of robots: each difference turns exactly its items, and nothing that was not heard is green."""

import asyncio
import re
import shutil
from collections.abc import Mapping
from dataclasses import replace
from datetime import UTC, datetime, tzinfo
from ipaddress import IPv4Address
from pathlib import Path
from types import SimpleNamespace
from unittest.mock import patch

import pytest
from hints_said import advised
from robot_rehearsals import NOWHERE, OF_ROBOTS, asked, probed, turned

from atlantis_netcfg.checklist import Checklist, Scope, plan
from atlantis_netcfg.checklist.probes import (
    Answer,
    Cell,
    Place,
    Question,
    RobotsHeardRequest,
    RobotsHeardResult,
    Trouble,
    VpnMember,
    VpnMembersRequest,
    VpnMembersResult,
    robot,
    robot_files,
)
from atlantis_netcfg.checklist.probes.base import ProbeResult
from atlantis_netcfg.checklist.report import ItemKind
from atlantis_netcfg.checklist.runner import RealTransport
from atlantis_netcfg.checklist.runner.robots import vpn_members
from atlantis_netcfg.checklist.runner.simulated import FAULTS
from atlantis_netcfg.checklist.runner.simulated.robots import SimulatedRobots
from atlantis_netcfg.cli import main
from atlantis_netcfg.cli.base.commands import COMMANDS, choose
from atlantis_netcfg.cli.base.commands import load as load_command
from atlantis_netcfg.cli.base.syntax import parse
from atlantis_netcfg.core.errors import ExitCode, UsageError
from atlantis_netcfg.core.events import Verdict
from atlantis_netcfg.inventory import Inventory, load
from atlantis_netcfg.inventory._yaml import SealedSecret
from atlantis_netcfg.inventory.model.robot import TopicKind
from atlantis_netcfg.inventory.robots import reading
from atlantis_netcfg.operations.vpn.server_state import VpnSession
from atlantis_netcfg.robots import observation as observed
from atlantis_netcfg.robots.observation import RobotObservation
from atlantis_netcfg.vpn.identity import Certificate, CertificateStatus, KeyType, Member, MemberKind, MemberLink, Wrap

ROOT = Path(__file__).parents[5]
OF_SPARUS = tuple(
    f"sparus/robot/{name}" for name in ("vpn", "discovered", "control-centre", "telemetry", "pose", "rates")
)


@pytest.fixture(scope="module")
def coastal(declaration: Inventory) -> Checklist:
    return plan(declaration, "coastal")


@pytest.fixture
def inventory(tmp_path: Path) -> Path:
    return Path(shutil.copytree(ROOT / "inventory", tmp_path / "inventory"))


def judged(listed: Checklist, name: str, answer: Answer) -> ProbeResult:
    (probe,) = (entry.step.probe for entry in listed.entries if entry.item.id == name)
    assert probe is not None
    (question,) = probe.asks()
    return probe.judge({question.name: answer})


def heard(observation: RobotObservation) -> RobotsHeardResult:
    return RobotsHeardResult(None, "", observation)


def codes(found: ProbeResult) -> list[str]:
    return [finding.code for finding in found.findings]


def test_every_robot_finding_belongs_to_one_item() -> None:
    text = Path(observed.__file__).read_text(encoding="utf-8")
    said = set(re.findall(r'LinkFinding\(\s*(?:Verdict\.\w+|verdict),\s*f?"([a-z-]+)', text))
    said = (said - {"topic-rate-"}) | {"topic-rate-above", "topic-rate-below"}
    assert said == set(robot.ITEM_OF)
    assert {robot.item_of("topic-silent", kind) for kind in TopicKind if kind.moves} == {robot.RobotItem.POSE}
    assert robot.item_of("topic-silent", TopicKind.NUMBER) is robot.RobotItem.TELEMETRY
    assert robot.item_of("topic-rate-above", TopicKind.POSE) is robot.RobotItem.RATES


def test_honest_robots_pass_every_item(declaration: Inventory, coastal: Checklist) -> None:
    items = asked(declaration, probed(coastal, "robot"))
    assert len(items) == 6 * 6 - 1 + 1, "the pose of one goes through the library, and the site has one of its own"
    assert {item.verdict for item in items.values()} == {Verdict.PASS}
    assert all(item.evidence for name, item in items.items() if name != "coastal/robot/strangers")
    assert not [item for item in items.values() if "token" in str(item.evidence).lower()]


@pytest.mark.parametrize("fault", OF_ROBOTS)
def test_fault_changes_exactly_its_items(declaration: Inventory, coastal: Checklist, fault: str) -> None:
    entries = probed(coastal, "robot")
    items, well = asked(declaration, entries, FAULTS[fault].spoil), asked(declaration, entries)
    changed = turned(items, well)
    assert {*changed} == {name.replace("SITE", "coastal") for name in FAULTS[fault].turns}
    assert all(items[name].hint for name in changed)
    assert not [name for name in changed if "site=…" in str(items[name].hint)], "it can be typed as it stands"
    assert Verdict.PASS not in {verdict for verdict, _ in changed.values()}


def test_one_observation_serves_all_items(coastal: Checklist) -> None:
    probes = [entry.step.probe for entry in probed(coastal, "robot")]
    questions = [replace(question, name="") for probe in probes if probe is not None for question in probe.asks()]
    assert set(questions) == {
        RobotsHeardRequest(""),
        RobotsHeardRequest("", "scc-control"),
        VpnMembersRequest(""),
    }


def test_robot_files_are_read_once_per_list(declaration: Inventory) -> None:
    with patch(f"{reading.__name__}.read_declared", wraps=reading.read_declared) as read:
        plan(declaration, "coastal")
    assert read.call_count == 1


def test_silence_is_inconclusive(coastal: Checklist) -> None:
    silence = RobotObservation(20.0)
    for name in (*OF_SPARUS[1:], "coastal/robot/strangers"):
        found = judged(coastal, name, heard(silence))
        assert found.verdict is Verdict.INCONCLUSIVE, name
        assert all(finding.hint for finding in found.findings)
    assert codes(judged(coastal, "sparus/robot/telemetry", heard(silence))) == ["not-introduced"]
    assert codes(judged(coastal, "coastal/robot/strangers", heard(silence))) == ["nobody-heard"]


def test_failed_observation_is_inconclusive(coastal: Checklist) -> None:
    for name in (*OF_SPARUS[1:], "coastal/robot/strangers"):
        found = judged(coastal, name, RobotsHeardResult(Trouble.NO_PLACE, "no way to 10.64.1.0/24"))
        assert (found.verdict, codes(found)) == (Verdict.INCONCLUSIVE, ["not-listened"])
        assert "could not be queried: no way to 10.64.1.0/24" in found.findings[0].message
    found = judged(coastal, OF_SPARUS[0], VpnMembersResult(Trouble.NO_PLACE, "this computer has no authority"))
    assert (found.verdict, codes(found)) == (Verdict.INCONCLUSIVE, ["not-asked"])


def test_unheard_topics_have_no_rate(declaration: Inventory, coastal: Checklist) -> None:
    silent = SimulatedRobots.honest(declaration, "coastal").here
    silent.writers = [row for row in silent.writers if row.participant != "sparus"]
    found = judged(coastal, "sparus/robot/rates", heard(silent))
    assert (found.verdict, codes(found)) == (Verdict.INCONCLUSIVE, ["not-heard"])
    assert codes(judged(coastal, "sparus/robot/telemetry", heard(silent))) == ["topic-missing"] * 5


def test_smaller_configuration_does_not_hide_missing_topics(declaration: Inventory, coastal: Checklist) -> None:
    seen = SimulatedRobots.honest(declaration, "coastal").here
    (row,) = (each for each in seen.configurations if each.writer.participant == "sparus")
    row.text = row.text.replace(b"    - {topic: leak, label: Leak}\n", b"")
    seen.writers = [each for each in seen.writers if each.topic != "/sparus/leak"]
    assert codes(judged(coastal, "sparus/robot/telemetry", heard(seen))) == ["topic-missing"]
    assert codes(judged(coastal, "sparus/robot/discovered", heard(seen))) == ["configuration-differs"]


def test_sealed_token_is_a_warning(declaration: Inventory) -> None:
    listed = plan(declaration, "coastal")
    (files,) = {id(entry.cell.robots): entry.cell.robots for entry in listed.entries}.values()
    assert files is not None
    source = files.sources["sparus"]
    assert source.robot is not None
    token = SealedSecret("$ANSIBLE_VAULT;1.1;AES256\n30")
    sealed = replace(source, robot=source.robot.model_copy(update={"token": token}))
    files.sources = {**files.sources, "sparus": sealed}
    found = judged(listed, "sparus/robot/discovered", heard(SimulatedRobots.honest(declaration, "coastal").here))
    assert (found.verdict, codes(found)) == (Verdict.WARN, ["token-sealed"])


VAULTED = "!vault |\n  $ANSIBLE_VAULT;1.1;AES256\n  3063\n"


@pytest.mark.parametrize(
    ("token", "code"),
    [("EXAMPLE-sparus-token\n", "introduced"), ("another", "token"), (None, "token-sealed")],
)
def test_vaulted_token_is_compared_after_decryption(inventory: Path, token: str | None, code: str) -> None:
    def decrypt(text: str) -> str:
        assert text.startswith("$ANSIBLE_VAULT;")
        if token is None:
            raise UsageError("there is no password")
        return token

    file = inventory / "robots" / "sparus.yml"
    clear = file.read_bytes()
    file.write_text(file.read_text().replace("EXAMPLE-sparus-token\n", VAULTED))
    declaration = replace(load(inventory), decrypt=decrypt)
    seen = SimulatedRobots.honest(declaration, "coastal").here
    (row,) = (each for each in seen.configurations if each.writer.participant == "sparus")
    row.text = clear
    assert codes(judged(plan(declaration, "coastal"), "sparus/robot/discovered", heard(seen))) == [code]


def test_a_guest_is_a_stranger_after_its_last_day(inventory: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    guests = inventory / "group_vars" / "all" / "guests.yml"
    last = "{name: LAUV, kind: auv, partner: udg, until: 2026-06-30, tested_at: [coastal], table3: [wifi]}"
    guests.write_text(f"---\nguests:\n  lauv: {last}\n")
    text = (inventory / "robots" / "sparus.yml").read_text()
    (inventory / "robots" / "lauv.yml").write_text(text.replace("namespace: sparus", "namespace: lauv"))
    declaration = load(inventory)
    seen = SimulatedRobots.honest(declaration, "coastal").here
    row = next(each for each in seen.configurations if each.writer.participant == "sparus")
    row.text = row.text.replace(b"namespace: sparus", b"namespace: lauv")

    class Day(datetime):
        @classmethod
        def now(cls, tz: tzinfo | None = None) -> datetime:  # type: ignore[override] # as datetime has it
            return datetime(2026, *today, tzinfo=tz)

    monkeypatch.setattr(reading, "datetime", Day)
    for day, code in (((6, 30), "all-known"), ((7, 1), "robot-unknown")):
        today = day
        assert codes(judged(plan(declaration, "coastal"), "coastal/robot/strangers", heard(seen))) == [code]


MEMBER = VpnMember("iqua-sparus", "sparus", has_certificate=True)
VPN: Mapping[str, tuple[tuple[VpnMember, ...], Verdict, str]] = {
    "connected": ((replace(MEMBER, session="192.0.2.7:1194"),), Verdict.PASS, "member-connected"),
    "one of two": ((MEMBER, replace(MEMBER, name="b", session="192.0.2.7:1194")), Verdict.PASS, "member-connected"),
    "away": ((MEMBER,), Verdict.FAIL, "member-away"),
    "revoked": ((replace(MEMBER, has_certificate=False),), Verdict.FAIL, "no-member"),
    "another's": ((replace(MEMBER, vehicle="zarco", session="192.0.2.7:1194"),), Verdict.SKIP, "behind-router"),
    "none": ((), Verdict.SKIP, "behind-router"),
}


@pytest.mark.parametrize("case", VPN)
def test_vpn_member_of_a_robot_is_judged(coastal: Checklist, case: str) -> None:
    members, verdict, code = VPN[case]
    found = judged(coastal, OF_SPARUS[0], VpnMembersResult(None, "", members))
    assert (found.verdict, codes(found)) == (verdict, [code])


def test_robot_in_neither_vpn_nor_lan_fails(declaration: Inventory) -> None:
    site = declaration.sites["coastal"]
    bare = site.model_copy(update={"lan": site.lan.model_copy(update={"reservations": ()})})
    listed = plan(replace(declaration, sites={**declaration.sites, "coastal": bare}), "coastal")
    found = judged(listed, OF_SPARUS[0], VpnMembersResult(None))
    assert (found.verdict, codes(found)) == (Verdict.FAIL, ["no-member"])


def test_faulty_robot_file_is_not_green_and_does_not_block_the_list(
    inventory: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (inventory / "robots" / "sparus.yml").write_text("namespace: [\n")
    listed = plan(load(inventory), "coastal")
    assert [entry.item.id for entry in listed.entries if entry.item.id.startswith("sparus/robot")] == [OF_SPARUS[1]]
    (entry,) = (entry for entry in listed.entries if entry.item.id == OF_SPARUS[1])
    assert entry.step.probe is not None
    found = entry.step.probe.judge({})
    assert (found.verdict, codes(found)) == (Verdict.INCONCLUSIVE, ["file-unreadable"])
    (words,) = advised(found.findings[0].hint or "")
    assert main([*words, f"inventory={inventory}"]) == ExitCode.USAGE
    assert "sparus.yml" in capsys.readouterr().err


@pytest.mark.parametrize("keys", ["keys: [\n", "keys: {namespace: 3}\n"])
def test_faulty_keys_file_disables_comparison_of_robots(inventory: Path, keys: str) -> None:
    (inventory / "robots" / "keys.yml").write_text(keys)
    listed = plan(load(inventory), "coastal", Scope(endpoints=("robot",)))
    assert len(listed.entries) == 7
    assert {entry.item.id.rpartition("/")[2] for entry in listed.entries} == {"discovered", "strangers"}


def test_vehicle_without_a_file_is_noted(inventory: Path) -> None:
    (inventory / "robots" / "sparus.yml").unlink()
    (inventory / "robots" / "zarco.yml").unlink()
    listed = plan(load(inventory), "coastal")
    assert not [entry for entry in listed.entries if entry.item.id.startswith(("sparus/robot", "zarco/robot"))]
    note = "not checked, because they have no file in robots/: what Sparus, Zarco publish"
    assert note in listed.notes
    shutil.rmtree(inventory / "robots")
    without = plan(load(inventory), "coastal")
    assert not [entry for entry in without.entries if entry.item.endpoint == "robot"]


def test_guests_have_no_robot_items(declaration: Inventory) -> None:
    guest = declaration.vehicles["sparus"].model_copy(update={"guest": True, "partner": "iqua"})
    listed = plan(replace(declaration, vehicles={**declaration.vehicles, "sparus": guest}), "coastal")
    assert not [entry for entry in listed.entries if entry.item.id.startswith("sparus/robot")]


def test_missing_control_centre_leaves_the_step_to_a_person(declaration: Inventory) -> None:
    hosts = {key: host for key, host in declaration.hosts.items() if key != "scc-control"}
    files = robot_files.RobotFiles.read(declaration, "coastal")
    cell = Cell(replace(declaration, hosts=hosts), "coastal", "sparus", "robot", robots=files)
    (step,) = (step for step in robot.steps(cell) if step.name == "control-centre")
    assert (step.kind, step.probe) == (ItemKind.PERSON, None)
    assert step.do.startswith("The inventory has no control centre")


def test_real_site_reports_why_it_could_not_be_asked(declaration: Inventory) -> None:
    """No packet leaves for the addresses of an example."""
    request = NOWHERE.model_copy(update={"rehearsed": False})
    questions: list[tuple[str, Question]] = [
        ("here", RobotsHeardRequest("here")),
        ("there", RobotsHeardRequest("there", "scc-control")),
        ("vpn", VpnMembersRequest("vpn")),
    ]
    came: list[str] = []
    ears = RealTransport(declaration, "coastal", request)
    answers = asyncio.run(ears.ask(Place.LAPTOP, None, questions, lambda key, _: came.append(key)))
    assert sorted(came) == sorted(answers) == ["here", "there", "vpn"]
    assert {answer.trouble for answer in answers.values()} == {Trouble.NO_PLACE}
    for key in ("here", "vpn"):
        assert "the inventory still contains example values" in answers[key].words
    assert answers["there"].words


def test_list_contains_no_token(coastal: Checklist) -> None:
    text = repr(coastal)
    assert "sparus/robot/discovered" in text
    assert "-token" not in text.replace("token-sealed", "")


NOW = datetime(2026, 11, 29, tzinfo=UTC)


def certificate(name: str, standing: CertificateStatus) -> Certificate:
    return Certificate(name, 1, "", NOW, NOW, Wrap.TLS_CRYPT_V2, KeyType.EC, standing)


def session(name: str, address: str = "10.80.17.2") -> VpnSession:
    return VpnSession(name, f"192.0.2.7:{len(name)}", address, NOW, 0, 0)


def record(*members: tuple[str, str | None, tuple[Certificate, ...]]) -> SimpleNamespace:
    rows = {
        name: Member(
            name, MemberKind.ROBOT, "iqua", name, IPv4Address("10.80.17.2"), MemberLink.FIBRE, vehicle, certificates
        )
        for name, vehicle, certificates in members
    }
    return SimpleNamespace(membership=lambda: SimpleNamespace(members=rows))


@pytest.mark.parametrize("is_live", [True, False])
def test_only_current_sessions_of_the_server_count_as_connected(declaration: Inventory, *, is_live: bool) -> None:
    """A certificate that was revoked, a handshake, and sessions that the server has written down long ago: none."""
    good, gone = CertificateStatus.SEEN, CertificateStatus.REVOKED
    authority = record(
        ("iqua-a", "sparus", (certificate("iqua-a", gone), certificate("iqua-a.2", good))),
        ("iqua-b", "zarco", (certificate("iqua-b", gone),)),
        ("iqua-c", "mares", (certificate("iqua-c", good),)),
        ("iqua-laptop", None, (certificate("iqua-laptop", good),)),
    )
    sessions = (session("iqua-a.2"), session("iqua-b"), session("iqua-c", address=""), session("iqua-laptop"))
    state = SimpleNamespace(is_live=is_live, why="its socket is closed", sessions=sessions)
    ended: list[bool] = []
    link = SimpleNamespace(close=lambda: ended.append(True))
    with (
        patch("atlantis_netcfg.operations.vpn.server.over_ssh", lambda *_: lambda: link),
        patch("atlantis_netcfg.operations.vpn.server_state.observe", lambda _: state),
        patch("atlantis_netcfg.vpn.authority.authority.Authority.open", lambda _: authority),
    ):
        found = vpn_members(declaration, NOWHERE)
    assert ended == [True]
    if not is_live:
        assert found == VpnMembersResult(Trouble.SILENT, "its socket is closed")
        return
    assert found.members == (
        VpnMember("iqua-a", "sparus", has_certificate=True, session="192.0.2.7:8"),
        VpnMember("iqua-b", "zarco", has_certificate=False),
        VpnMember("iqua-c", "mares", has_certificate=True),
    )


def test_advised_commands_can_be_typed(declaration: Inventory, coastal: Checklist) -> None:
    seen = SimulatedRobots.honest(declaration, "coastal").here
    (depth,) = (row for row in seen.writers if row.topic == "/sparus/depth")
    depth.messages = 2
    longer = judged(coastal, "sparus/robot/rates", heard(seen)).findings[0]
    assert longer.code == "topic-rate-unknown"
    away = judged(coastal, OF_SPARUS[0], VpnMembersResult(None, "", (MEMBER,))).findings[0]
    for hint, first in ((longer.hint, "robot"), (away.hint, "vpn")):
        (words,) = advised(hint or "")
        name, rest = choose(words, COMMANDS)
        assert name.startswith(first)
        assert parse(load_command(name, COMMANDS).command, rest)
