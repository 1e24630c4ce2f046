"""What the commands make, print and keep, with nobody but the authority."""

import getpass
import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pyrage
import pytest
from cryptography import x509
from vpn_desk import NOBODY, PASSPHRASE, Desk, onboarding, over_a_pipe, seated

from atlantis_netcfg.cli import main
from atlantis_netcfg.cli.vpn import _common
from atlantis_netcfg.core.paths import checkout
from atlantis_netcfg.core.secret import Secret
from atlantis_netcfg.inventory import load
from atlantis_netcfg.operations.vpn.server import DeployResult, NoPush
from atlantis_netcfg.vpn.enrolment_package import open_package
from atlantis_netcfg.vpn.enrolment_package.profile import read_identity

LAPTOP = (*onboarding("iqua", "laptop"), f"recipient={NOBODY}")


@pytest.fixture
def desk(
    tmp_path: Path,
    tmp_path_factory: pytest.TempPathFactory,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> Desk:
    return seated(tmp_path_factory.getbasetemp(), tmp_path, capsys, monkeypatch)


def modes(folder: Path) -> set[int]:
    return {path.stat().st_mode & 0o777 for path in folder.rglob("*") if path.is_file()}


# --- the passphrase ----------------------------------------------------------------------------------------------


@pytest.fixture
def terminal(monkeypatch: pytest.MonkeyPatch) -> Callable[..., list[str]]:
    """Somebody who types these answers, and the questions that they were asked."""

    def sits(*answers: str) -> list[str]:
        asked: list[str] = []
        rest = iter(answers)

        def answer(question: str) -> str:
            asked.append(question)
            return next(rest)

        monkeypatch.setattr("sys.stdin.isatty", lambda: True, raising=False)
        monkeypatch.setattr(getpass, "getpass", answer)
        return asked

    return sits


@pytest.mark.parametrize(
    ("answers", "said"),
    [
        (("short",), "guesses find it, at least 10^16 are required"),
        (("Password1234Password1234",), "the passphrase is too weak: about 10^"),
        (("",), "the passphrase is empty"),
        ((PASSPHRASE, PASSPHRASE[:-1]), "the two entries differ; nothing was created"),
    ],
)
def test_unacceptable_passphrase_is_refused(
    answers: tuple[str, ...], said: str, desk: Desk, terminal: Callable[..., list[str]]
) -> None:
    terminal(*answers)
    code = main(["vpn", "init", f"authority={desk.folder / 'new'}", "sealed=vault"])
    assert (code, said in desk.capsys.readouterr().err) == (3, True)
    assert not (desk.folder / "new").exists()


def test_terminal_asks_twice_for_a_new_passphrase_and_once_to_use_it(
    desk: Desk, terminal: Callable[..., list[str]]
) -> None:
    asked = terminal(PASSPHRASE, PASSPHRASE, PASSPHRASE)
    new = Desk(desk.folder / "new", desk.capsys)
    assert new.told("init", "sealed=vault")["already"] is False
    assert new.told(*LAPTOP)["members"][0]["name"] == "iqua-laptop"
    assert new.told("init")["already"] is True
    assert asked == [
        "Choose the passphrase of the CA key (for example six dice-selected words): ",
        "The same again: ",
        "The passphrase of the CA key: ",
    ]
    assert modes(new.authority) == {0o600}
    assert PASSPHRASE.encode() not in b"".join(new.files().values())


@pytest.mark.parametrize("text", ["x" * 5000, "\udcff\udcfe", ""])
def test_invalid_passphrase_descriptor_content_is_refused(text: str, desk: Desk) -> None:
    before = desk.files()
    with over_a_pipe("") as number:
        code, _, err = desk.type(*LAPTOP, f"--passphrase-fd={number}")
    assert (code, "the passphrase is empty" in err) == (3, True)
    code, out, err = desk.type(*LAPTOP, passphrase=text.encode("utf-8", "replace").decode())
    assert (code, out) == (3, ""), err
    assert desk.files() == before


def test_the_wrong_passphrase_opens_nothing(desk: Desk) -> None:
    before = desk.files()
    code, out, err = desk.type(*LAPTOP, passphrase=f"{PASSPHRASE}r")
    assert (code, out) == (3, "")
    assert "wrong passphrase, or the file was changed" in err
    assert desk.files() == before


# --- onboarding --------------------------------------------------------------------------------------------------


def test_one_time_passphrase_is_printed_once_and_opens_the_package(desk: Desk) -> None:
    code, out, err = desk.type(*onboarding("iqua", "sparus2", "robot"), passphrase=PASSPHRASE)
    assert (code, err) == (0, "")
    (shown,) = [line.split()[1] for line in out.splitlines() if line.startswith("  passphrase  ")]
    (file,) = desk.authority.glob("handouts/*/*.age")
    profile = open_package(file.read_bytes(), Secret(shown))["iqua-sparus2.ovpn"]
    assert read_identity(profile).member.vehicle == "sparus"
    assert shown.encode() not in b"".join(desk.files().values())
    code, again, _ = desk.type(*onboarding("iqua", "sparus2", "robot"))
    assert (code, "unchanged" in again, shown in again) == (0, True, False)


def test_interrupt_during_deployment_still_shows_the_passphrase(desk: Desk, monkeypatch: pytest.MonkeyPatch) -> None:
    def stopped(*_: object) -> DeployResult:
        raise KeyboardInterrupt

    monkeypatch.setattr(NoPush, "deploy", stopped)
    told = desk.told(*LAPTOP, passphrase=PASSPHRASE, code=5)
    assert (told["members"][0]["name"], told["deployed"]) == ("iqua-laptop", False)
    code, out, err = desk.type(*onboarding("iqua", "sparus2", "robot"), passphrase=PASSPHRASE)
    assert (code, "  passphrase  " in out, "interrupted by Ctrl-C" in err) == (5, True, True)


def test_repeated_request_issues_nothing_and_a_different_one_is_refused(desk: Desk) -> None:
    desk.told(*LAPTOP, passphrase=PASSPHRASE)
    before = desk.files()
    (row,) = desk.told(*LAPTOP)["members"]
    assert (row["already"], row["passphrase"], row["file"].endswith("iqua-laptop.tar.age")) == (True, None, True)
    told = desk.told(*onboarding("iqua", "laptop", "robot"), passphrase=PASSPHRASE, code=3)
    assert "kind is laptop, not robot" in told["errors"][0]["message"]
    assert desk.files() == before


YAML = """\
# of the partner
- {{partner: iqua, device: sparus2, kind: robot, link: satellite, recipient: {0}}}
- partner: inesc
  device: 007
  kind: laptop
  days: 30
"""
CSV = "partner;device;kind;link;recipient;days\niqua;sparus2;robot;satellite;{0};\n\ninesc;007;laptop;;;30\n"


@pytest.mark.parametrize(("suffix", "text"), [("yml", YAML), ("csv", CSV)])
def test_batch_file_issues_all_listed_devices(suffix: str, text: str, desk: Desk, tmp_path: Path) -> None:
    key = pyrage.x25519.Identity.generate()
    (tmp_path / f"list.{suffix}").write_text(text.format(key.to_public()))
    words = ("onboard", f"batch={tmp_path / f'list.{suffix}'}", f"recipient={NOBODY}", "--no-push")
    rows = desk.told(*words, passphrase=PASSPHRASE)["members"]
    assert [(row["name"], row["address"], row["link"]) for row in rows] == [
        ("iqua-sparus2", "10.80.17.1", "satellite"),
        ("inesc-007", "10.80.16.1", "fibre"),
    ]
    (sealed,) = desk.authority.glob("handouts/iqua-sparus2/*.age")
    assert open_package(sealed.read_bytes(), Secret(str(key)))
    assert all(row["already"] for row in desk.told(*words)["members"])


BAD: dict[str, tuple[bytes, str]] = {
    "laughs.yml": (b"a: &a [x, x]\nb: &b [*a, *a]\nc: [*b, *b]\n", "laughs.yml:1: this is not a list"),
    "deep.yml": (b"- " * 2000 + b"x", "deep.yml:1: this is nested too deeply"),
    "alias.yml": (b"- &a {partner: iqua}\n- *a\n", "alias.yml:2: aliases (`*name`) are not supported in an inventory"),
    "tag.yml": (b"- !!python/object/apply:os.system [id]\n", "tag.yml:1: a `!` starts a tag"),
    "twice.yml": (b"- {partner: iqua, partner: eca}\n", "twice.yml:1: `partner` is here twice"),
    "word.yml": (b"- {partner: iqua, devise: a}\n", "word.yml:1: unknown key `devise`"),
    "list.yml": (b"- {partner: iqua, device: [a]}\n", "list.yml:1: `device` needs a simple value"),
    "text.yml": (b"- just words\n", "text.yml:1: this is not a record"),
    "empty.yml": (b"", "empty.yml:1: it contains no record"),
    "bytes.yml": (b"- {partner: iqua}\n- \xff\xfe\n", "bytes.yml:2: this line is not UTF-8 text"),
    "large.yml": (b"#" * 1_000_001, "large.yml is larger than 1 MB"),
    "same.yml": (b"- {partner: iqua, device: a, kind: robot}\n" * 2, "same.yml:2: `iqua-a` is defined twice, first in"),
    "columns.csv": (b"partner,device,kind\niqua,a\n", "columns.csv:2: 2 values for 3 columns"),
    "head.csv": (b"partner,partner\niqua,eca\n", "head.csv:1: `partner` is here twice"),
    "quote.csv": (b'partner,device\niqua,"a\n', "quote.csv:2: this is not CSV"),
    "nul.csv": (b"partner,device,kind\niqua,a\0b,robot\n", "nul.csv:2: "),
}


@pytest.mark.parametrize("name", BAD)
def test_invalid_batch_file_is_refused_with_its_line(name: str, desk: Desk, tmp_path: Path) -> None:
    data, said = BAD[name]
    (tmp_path / name).write_bytes(data)
    before = desk.files()
    told = desk.told("onboard", f"batch={tmp_path / name}", "--no-push", code=3)
    assert said in json.dumps(told["errors"], ensure_ascii=False).replace(f"{tmp_path}/", "")
    assert desk.files() == before


# --- the record --------------------------------------------------------------------------------------------------


def test_list_audit_and_status_report_the_members(desk: Desk) -> None:
    desk.told(*LAPTOP, passphrase=PASSPHRASE)
    desk.told(*onboarding("eca", "rov", "robot"), f"recipient={NOBODY}", passphrase=PASSPHRASE)
    assert [one["name"] for one in desk.told("list")["members"]] == ["iqua-laptop", "eca-rov"]
    assert [one["name"] for one in desk.told("list", "partner=eca")["members"]] == ["eca-rov"]
    assert desk.told("show", "name=iqua-laptop")["member"]["certificates"][0]["standing"] == "issued"
    (renewed,) = desk.told("renew", "name=eca-rov", f"recipient={NOBODY}", "--no-push", passphrase=PASSPHRASE)[
        "members"
    ]
    assert renewed["common_name"] == "eca-rov.2"
    entries = desk.told("audit", "partner=eca")["entries"]
    assert not any("iqua-laptop" in json.dumps(one) for one in entries)
    told = desk.told("audit", "since=1d")
    assert (told["agrees"], told["signed_lines"]) == (True, told["lines"])
    assert desk.told("status", "--no-push")["told"][0]["verdict"] == "PASS"


def test_revoking_a_partner_removes_all_its_members_for_good(desk: Desk) -> None:
    desk.told(*LAPTOP, passphrase=PASSPHRASE)
    words = ("revoke", "partner=iqua", "reason=the project has ended", "--no-push")
    code, _, err = desk.type(*words, passphrase=PASSPHRASE)
    assert (code, "no terminal to confirm" in err) == (3, True)
    told = desk.told(*words, "--yes", passphrase=PASSPHRASE, code=5)
    assert (told["members"], told["deployed"]) == (["iqua-laptop"], False)
    status = desk.told("status", "--no-push", code=6)
    assert status["queued"] == ["iqua-laptop"]
    again = desk.told(*LAPTOP, passphrase=PASSPHRASE, code=3)
    assert "was revoked: the project has ended" in again["errors"][0]["message"]


def test_tampered_ledger_is_reported(desk: Desk) -> None:
    desk.told(*LAPTOP, passphrase=PASSPHRASE)
    ledger = desk.authority / "ledger.jsonl"
    ledger.write_bytes(ledger.read_bytes().replace(b"iqua-laptop", b"iqua-lapdog", 1))
    told: dict[str, Any] = desk.told("audit", code=6)
    assert (told["agrees"], told["entries"], told["signed_lines"]) == (False, [], 0)
    assert told["errors"]
    assert desk.told(*LAPTOP, passphrase=PASSPHRASE, code=4)["errors"]


def test_identity_can_be_accepted_on_another_laptop(desk: Desk, tmp_path: Path) -> None:
    key = pyrage.x25519.Identity.generate()
    (tmp_path / "age.key").write_text(f"# mine\n{key}\n")
    (tmp_path / "stick").mkdir()
    words = (
        "onboard",
        "device=coastal-gateway",
        f"recipient={key.to_public()}",
        f"to={tmp_path / 'stick'}",
        "--no-push",
    )
    (row,) = desk.told(*words, passphrase=PASSPHRASE)["members"]
    other = Desk(tmp_path / "other", desk.capsys)
    taking = ("accept", f"file={row['copy']}", f"key={tmp_path / 'age.key'}")
    (tmp_path / "age.key").chmod(0o644)
    assert "other users can read the key" in other.told(*taking, code=3)["errors"][0]["message"]
    (tmp_path / "age.key").chmod(0o600)
    assert other.told(*taking)["already"] is False
    assert other.told(*taking)["already"] is True
    here, there = (one.authority / "hosts" / "coastal-gateway.identity" for one in (desk, other))
    assert here.read_bytes() == there.read_bytes()
    assert modes(other.authority) == {0o600}


# --- the server's own certificate --------------------------------------------------------------------------------


def test_renamed_server_gets_one_new_certificate(desk: Desk, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    shutil.copytree(checkout() / "inventory", tmp_path / "inventory")
    pilot = tmp_path / "inventory" / "group_vars" / "all" / "pilot.yml"
    pilot.write_text(pilot.read_text().replace("endpoint_name: vpn.example.org", "endpoint_name: tunnel.example.org"))
    moved = load(tmp_path / "inventory")
    monkeypatch.setattr(_common, "server", lambda *_: NoPush())
    before = (desk.authority / "server" / "server.crt").read_bytes()
    assert not desk.told("sync", "--sign", passphrase=PASSPHRASE)["server_certificate"]
    assert (desk.authority / "server" / "server.crt").read_bytes() == before

    monkeypatch.setattr(_common, "load_inventory", lambda _: moved)
    code, _, said = desk.type("init", passphrase=PASSPHRASE)
    assert (
        code,
        f"run `provision vpn sync --sign authority={desk.authority}` to issue a new server certificate" in said,
    ) == (
        3,
        True,
    ), said
    code, out, _ = desk.type("sync", "--sign", passphrase=PASSPHRASE)
    assert (code, "`provision site=scc` installs it" in out) == (0, True), out
    made = x509.load_pem_x509_certificate((desk.authority / "server" / "server.crt").read_bytes())
    names = made.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    assert names.get_values_for_type(x509.DNSName) == ["tunnel.example.org"]
    assert not desk.told("sync", "--sign", passphrase=PASSPHRASE)["server_certificate"]
