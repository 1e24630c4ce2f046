"""Text of a device through every command of the table: nothing of it is obeyed, and none begins a line.

The control characters of a device are looked for on the output and the error output, in the JSON as it is printed, and
in the files that a command writes. A command is played here, or the reason stands here why no device's text reaches it.
The program itself is started once for each kind of far end; a prepared process prints through the same streams.
"""

import json
import subprocess
from collections.abc import Iterable, Iterator
from pathlib import Path

import pytest
from _pytest.mark import ParameterSet
from hostile_console import hostile_console
from hostile_ssh import MANNERS, before_ssh
from impostor import (
    HOSTILE,
    Answer,
    control_characters,
    fake_lines,
    hostile,
    in_every,
    leaving_out,
    refused_login,
    refusing,
)
from npk_files import write
from quay import ADDRESS, ROUTER, Door, Quay, forwarded, fresh_quay
from vpn_desk import NOBODY, PASSPHRASE, over_a_pipe

from atlantis_netcfg.cli import main
from atlantis_netcfg.cli.base.commands import COMMANDS, choose, load
from atlantis_netcfg.routeros.console.terminal import Terminal
from atlantis_netcfg.runs import Store

CODES = frozenset({0, 2, 4, 5, 6})
GATEWAY = "coastal-gateway"
MEMBER = "iqua-auv1"

pytestmark = [pytest.mark.slow, pytest.mark.namespace]

SAID: dict[str, Answer] = {
    "texts": in_every("comment", "board-name", "message", "ssid", "host-name", "identity", "address-list", "contact"),
    "everything": in_every(),
    "refusals": refusing,
    "login": refused_login,
}
"""In what a device may put it: the texts of its rows, every value, its refusals, and what it says to a login."""
ASKING: dict[str, tuple[str, ...]] = {
    "plan": ("plan", "site=coastal"),
    "change": ("site=coastal", "--yes"),
    "report drift": ("report", "drift", "site=coastal", "--junit=DRIFT"),
    "device backup": ("device", "backup", "site=coastal"),
    "recover resume": ("recover", "resume", "site=coastal"),
    "device verify": ("device", "verify", f"device={ROUTER}"),
    "links": ("links", "site=coastal", "--accept-cost"),
    "measure satellite": ("measure", "satellite", "site=coastal", "--accept-cost"),
    "device upgrade": ("device", "upgrade", "site=coastal", f"device={ROUTER}", "packages=PACKAGE", "--plan"),
    "check": ("check", "site=coastal", "--accept-cost", "--anew"),
    "report as-built": ("report", "as-built", "site=coastal", "--accept-cost"),
}
"""To a router whose twin is fresh from `provision device adopt`."""
AFTER_RUN: dict[str, tuple[str, ...]] = {
    "recover rollback": ("recover", "rollback", "site=coastal", "run=RUN", "--yes"),
    "device restore": ("device", "restore", f"device={ROUTER}", "run=latest", "--yes"),
    "vpn install": ("vpn", "install", f"device={ROUTER}", "--yes"),
    "links use": ("links", "use", "site=coastal", "link=4g", "for=10m", "--unproved", "--accept-cost", "--yes"),
    "report runs": ("report", "runs", "site=coastal", "--all"),
}
"""Once the router is as declared, and has an identity for the VPN."""
READING: tuple[tuple[str, ...], ...] = (
    ("report", "checklists", "site=coastal"),
    ("report", "show", "site=coastal"),
    ("report", "verify", "site=coastal"),
)
"""What a checklist of such a router has left on this computer."""
OVER_SSH: dict[str, tuple[str, ...]] = {
    "plan": ("plan", "site=coastal", f"device={GATEWAY}"),
    "change": ("site=coastal", f"device={GATEWAY}", "--yes", "--verbose"),
    "report drift": ("report", "drift", "site=coastal", f"device={GATEWAY}", "--junit=DRIFT"),
    "check": ("check", "site=coastal", "--accept-cost", "--anew"),
    "gateway bundle": ("gateway", "bundle", "site=coastal", f"device={GATEWAY}", "to=BUNDLE"),
}
"""To a gateway."""
TO_SERVER: dict[str, tuple[str, ...]] = {
    "status": ("vpn", "status"),
    "onboard": ("vpn", "onboard", "partner=iqua", "device=auv2", "kind=robot", f"recipient={NOBODY}"),
    "renew": ("vpn", "renew", f"name={MEMBER}", f"recipient={NOBODY}"),
    "revoke": ("vpn", "revoke", f"name={MEMBER}", "reason=stolen", "--yes"),
    "sync": ("vpn", "sync", "--sign"),
}
"""To the server of the VPN; each with the passphrase where it signs."""
RECORDED: tuple[tuple[str, ...], ...] = (("vpn", "list"), ("vpn", "show", f"name={MEMBER}"), ("vpn", "audit"))
"""What the record says after all that."""
FIRST_CONTACT: dict[str, tuple[str, ...]] = {
    "plan": ("device", "adopt", "site=coastal", f"device={ROUTER}", f"address={ADDRESS[0]}", "--plan"),
    "change": ("device", "adopt", "site=coastal", f"device={ROUTER}", f"address={ADDRESS[0]}", "--yes", "--take-over"),
}
TRUST = ("device", "trust", "site=coastal", f"device={ROUTER}", f"device={GATEWAY}")
NO_DEVICE: dict[str, str] = {
    "plan apply": "it is a run of a plan that was saved: what a device says is told as `run` tells it",
    "inventory init": "it makes files of answers, and contacts nobody",
    "inventory doctor": "it looks at this laptop, and at a certificate; nobody logs in",
    "inventory validate": "it reads the inventory, and contacts nobody",
    "measure fit": "it reckons with the inventory and with files of this computer, and contacts nobody",
    "robot validate": "robots' files pass the same streams: tests/unit/robots/test_robot_command.py plays one",
    "robot discover": "robots' words pass the same streams, and it needs robots: tests/unit/robots plays what is heard",
    "robot mock": "it sends what the inventory's files hold, and hears nobody",
    "measure link": (
        "of the router it takes numbers and identifiers; what it refuses is said as `measure satellite` says it"
    ),
    "measure show": "it reads files of this computer, and contacts nobody",
    "measure compare": "it reads files of this computer, and contacts nobody",
    "measure history": "it reads files of this computer, and contacts nobody",
    "measure coverage": (
        "a 4G unit is read as `links` reads it; its pages are in tests/unit/records/survey/test_survey_files.py"
    ),
    "robot retrieve": "a gateway's words pass the same streams; names of files are in tests/unit/computers/retrieval",
    "robot dds": "it makes files of the inventory, and contacts nobody",
    "gateway image": "it reads the vendor's file and a card; a card's name: tests/unit/cli/commands/test_printable.py",
    "vpn init": "it makes an authority, and contacts nobody",
    "robot invite": "what the server of the VPN says is told as `vpn onboard` tells it",
    "robot dismiss": "what the server of the VPN says is told as `vpn revoke` tells it",
    "vpn accept": "it opens a file of the authority, and contacts nobody",
    "recover": "it lists runs of this computer, and contacts nobody",
    "help completion": "it says what is installed",
    "help exit-codes": "it says what there is",
    "help man": "it says what there is",
    "help version": "it says what is installed",
    "help": "it says what there is",
}


def _sampled(commands: Iterable[str], manners: Iterable[str]) -> Iterator[ParameterSet]:
    """Every command in every manner; in CI each command in every other manner, and each manner with some commands."""
    for row, command in enumerate(commands):
        for column, manner in enumerate(manners):
            marks = [] if (row + column) % 2 == 0 else [pytest.mark.campaign]
            yield pytest.param(command, manner, id=f"{command}-{manner}", marks=marks)


def test_every_command_is_covered_or_exempt() -> None:
    tables = (ASKING, AFTER_RUN, OVER_SSH, TO_SERVER, FIRST_CONTACT)
    lines = [*(words for table in tables for words in table.values()), *READING, *RECORDED, TRUST]
    played = {choose(words, COMMANDS)[0] for words in lines}
    assert played | NO_DEVICE.keys() == COMMANDS.keys()
    assert played & NO_DEVICE.keys() == set()


at = pytest.fixture(fresh_quay)


@pytest.mark.smoke("plan-texts")
@pytest.mark.parametrize(("asked", "said"), list(_sampled(ASKING, SAID)))
def test_hostile_router_text_is_escaped(at: Quay, tmp_path: Path, asked: str, said: str) -> None:
    at.program = (asked, said) == ("report drift", "texts")
    files = {"DRIFT": tmp_path / "drift.xml", "PACKAGE": write(tmp_path, "routeros", "7.21.5", "arm64")}
    with hostile(tmp_path, at.door.port, SAID[said]) as device:
        at.door.port = device.port
        Store(at.state).pins.change(ROUTER, device.fingerprint)
        harmless(at, *(_named(word, files) for word in ASKING[asked]))
    if asked == "check":
        for words in READING:
            harmless(at, *words, codes={0, 6, 7})
    for file in written(at, files["DRIFT"]):
        assert control_characters(file.read_text(encoding="utf-8")) == [], file.name


@pytest.mark.parametrize("said", ["everything", "refusals"])
@pytest.mark.parametrize("asked", AFTER_RUN)
def test_hostile_router_text_is_escaped_after_a_run(at: Quay, tmp_path: Path, asked: str, said: str) -> None:
    at.configure()
    (run,) = at.runs()
    at.program = (asked, said) == ("recover rollback", "everything")
    if asked == "vpn install":
        authority(at, "onboard", f"device={ROUTER}", f"recipient={NOBODY}", "--no-push")
    with hostile(tmp_path, at.door.port, SAID[said]) as device:
        at.door.port = device.port
        Store(at.state).pins.change(ROUTER, device.fingerprint)
        if asked == "report runs":
            harmless(at, *ASKING["change"])
        harmless(at, *(word.replace("RUN", run["run"]) for word in AFTER_RUN[asked]))


@pytest.mark.parametrize(("asked", "manner"), list(_sampled(OVER_SSH, ("away", "answers", "refuses"))))
def test_hostile_gateway_text_is_escaped(
    at: Quay, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, asked: str, manner: str
) -> None:
    stands_in(tmp_path, monkeypatch, manner)
    at.program = (asked, manner) == ("change", "answers")
    files = {"DRIFT": tmp_path / "drift.xml", "BUNDLE": tmp_path / "bundle"}
    harmless(at, *(_named(word, files) for word in OVER_SSH[asked]), codes={0, 2, 3, 4, 5, 6})
    for file in written(at, files["DRIFT"]):
        assert control_characters(file.read_text(encoding="utf-8")) == [], file.name


@pytest.mark.parametrize("manner", MANNERS)
def test_hostile_gateway_text_is_escaped_in_plain_ansible(
    at: Quay, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, manner: str
) -> None:
    """Its own callback prints what our modules return as it is."""
    stands_in(tmp_path, monkeypatch, manner)
    done = at.playbook("--limit", GATEWAY, "--check", "--diff")
    for text in (done.stdout, done.stderr):
        assert control_characters(text) == []
        assert fake_lines(text) == []
    assert "u001b]0;owned" in done.stdout + done.stderr or manner == "lacks", "it did arrive"


@pytest.mark.parametrize("asked", TO_SERVER)
def test_hostile_vpn_server_text_is_escaped(
    at: Quay, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, asked: str
) -> None:
    """Nor is what it leaves out, or has of another kind, a fault of ours."""
    authority(at, "onboard", "partner=iqua", "device=auv1", "kind=robot", f"recipient={NOBODY}", "--no-push")
    for manner in MANNERS:
        at.program = (asked, manner) == ("status", "answers")
        stands_in(tmp_path, monkeypatch, manner)
        said = harmless(at, *TO_SERVER[asked], passphrase=asked != "status")
        assert ("evil" in said) or manner == "lacks", "it did arrive"
    for words in RECORDED:
        harmless(at, *words)


@pytest.mark.parametrize("asked", FIRST_CONTACT)
def test_hostile_console_text_is_escaped(at: Quay, asked: str) -> None:
    """Over a serial line it is the same conversation."""
    at.program = asked == "plan"
    with hostile_console() as port, forwarded(Door(port), 22):
        harmless(at, *FIRST_CONTACT[asked], "wait=1")


@pytest.mark.parametrize("more", [(), ("--plan",), ("--json",)], ids=["change", "plan", "json"])
def test_hostile_rows_of_a_console_are_escaped(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], more: tuple[str, ...]
) -> None:
    """A console that converses as it should, and is hostile in what its rows hold."""
    rows = Terminal.rows

    def hostile_rows(self: Terminal, menu: str, *, where: str = "", timeout_s: float = 60.0) -> list[dict[str, str]]:
        found = rows(self, menu, where=where, timeout_s=timeout_s)
        return [{name: f"{value}{HOSTILE}" for name, value in row.items()} for row in found]

    monkeypatch.setattr(Terminal, "rows", hostile_rows)
    monkeypatch.setenv("ATLANTIS_STATE", str(tmp_path / "state"))
    assert main(["device", "adopt", "site=scc", "device=scc-router", "--rehearse", "--yes", *more]) in CODES
    said = capsys.readouterr()
    for text in (said.out, said.err):
        assert control_characters(text) == []
        assert fake_lines(text) == []


def test_hostile_text_of_an_untrusted_gateway_is_escaped(
    at: Quay, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    stands_in(tmp_path, monkeypatch, "away")
    at.program = True
    with hostile_console() as port, forwarded(Door(port), 22):
        told = at.typed(*TRUST, answer="yes\nyes", code=4)
    assert f"{GATEWAY} was not reached: evil" in told
    assert control_characters(told) == []
    assert fake_lines(told) == []


def stands_in(folder: Path, monkeypatch: pytest.MonkeyPatch, manner: str) -> None:
    """Whoever answers at the address of every computer."""
    for name, value in before_ssh(folder, HOSTILE, manner).items():
        monkeypatch.setenv(name, value)


def authority(at: Quay, *words: str) -> None:
    """Found one, and type a command of the VPN."""
    for line in (("vpn", "init", "sealed=vault"), ("vpn", *words)):
        assert _typed(at, *line, passphrase=True).returncode == 0


def harmless(at: Quay, *words: str, passphrase: bool = False, codes: frozenset[int] | set[int] = CODES) -> str:
    """Type it for people and for programs; give what was printed. The program itself is started once at most."""
    said, program = "", at.program
    for more in ((), ("--json",)):
        at.program = program and not more
        done = _typed(at, *words, *more, passphrase=passphrase, codes=codes)
        assert "provision itself failed" not in done.stdout + done.stderr
        for text in (done.stdout, done.stderr):
            assert control_characters(text) == []
            assert fake_lines(text) == []
        if more:
            json.loads(done.stdout)
        said += done.stdout + done.stderr
    at.program = program
    return said


def _named(word: str, files: dict[str, Path]) -> str:
    for name, file in files.items():
        word = word.replace(name, str(file))
    return word


def _typed(
    at: Quay, *words: str, passphrase: bool = False, codes: frozenset[int] | set[int] = CODES
) -> subprocess.CompletedProcess[str]:
    """Type it, however it ends: refused, drifted, planned, done, not known."""
    command = load(choose(words, COMMANDS)[0], COMMANDS).command
    inventory = [f"inventory={at.inventory}"] if any(word.name == "inventory" for word in command.words) else []
    with over_a_pipe(PASSPHRASE) as number:
        signs = passphrase and any(flag.name == "passphrase-fd" for flag in command.flags)
        line = [*words, *at.only(words), *inventory, *(["--passphrase-fd", number] if signs else [])]
        done = at.start(line, pass_fds=(int(number),))
    assert done.returncode in codes, f"exit {done.returncode}\n{done.stdout}\n{done.stderr}"
    return done


def written(at: Quay, drift: Path) -> list[Path]:
    """What is meant for people and other programs; journals and saved states are kept as the device has said it."""
    kinds = {".html", ".xml", ".json"}
    pages = [path for path in at.state.rglob("checklist*/**/*") if path.suffix in kinds]
    return [*pages, *([drift] if drift.exists() else [])]


MISSING: dict[str, tuple[str, ...]] = {
    "number": (".id",),
    "name": ("name", "default-name"),
    "place": ("address", "interface", "chain", "action", "dst-address"),
    "counters": ("rx-byte", "tx-byte", "packets", "bytes", "uptime", "running"),
    "everything": (),
}


@pytest.mark.parametrize(("asked", "missing"), list(_sampled(ASKING, MISSING)))
def test_missing_fields_of_a_device_do_not_crash_the_program(
    at: Quay, tmp_path: Path, asked: str, missing: str
) -> None:
    """Words about the device, and none of success where its rows say nothing at all."""
    files = {"DRIFT": tmp_path / "drift.xml", "PACKAGE": write(tmp_path, "routeros", "7.21.5", "arm64")}
    with hostile(tmp_path, at.door.port, leaving_out(*MISSING[missing])) as device:
        at.door.port = device.port
        Store(at.state).pins.change(ROUTER, device.fingerprint)
        done = _typed(at, *(_named(word, files) for word in ASKING[asked]))
    assert "provision itself failed" not in done.stdout + done.stderr
    assert ROUTER in done.stdout + done.stderr or "the router" in done.stderr
    # What is saved is the device's own export, no row of it.
    assert done.returncode != 0 or asked == "device backup" or missing == "counters"


def test_hostile_text_reaches_the_output(at: Quay, tmp_path: Path) -> None:
    """Else nothing was shown above."""
    with hostile(tmp_path, at.door.port, SAID["texts"]) as device:
        at.door.port = device.port
        Store(at.state).pins.change(ROUTER, device.fingerprint)
        told = at.provision("report", "drift", "site=coastal", code=6).stdout
    assert r"evil\u001b]0;owned\u0007\u001b[2J\u202e\u009b31m\u2066\u000a\u0009evil\u000d\u007f\u200f\u2028evil" in told
    assert control_characters(HOSTILE) != []
