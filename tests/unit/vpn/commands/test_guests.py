"""A robot that is here for a while: let in and taken away by commands alone, and nothing of it is left."""

import json
import shutil
from collections.abc import Sequence
from dataclasses import dataclass, field
from datetime import UTC, date, datetime, timedelta
from pathlib import Path
from typing import Any
from zoneinfo import ZoneInfo

import pytest
from hints_said import advised, said
from vpn_desk import PASSPHRASE, founded, over_a_pipe

from atlantis_netcfg.cli import main
from atlantis_netcfg.cli.vpn import _common
from atlantis_netcfg.core.errors import OutcomeUnknown
from atlantis_netcfg.core.events import Subscriber
from atlantis_netcfg.core.paths import checkout
from atlantis_netcfg.core.secret import Secret
from atlantis_netcfg.inventory import load
from atlantis_netcfg.inventory.model import Guest
from atlantis_netcfg.operations import guests
from atlantis_netcfg.operations.common import inventory_files
from atlantis_netcfg.operations.vpn.server import DeployResult
from atlantis_netcfg.vpn.authority.authority import Authority
from atlantis_netcfg.vpn.authority.model import RevocationResult
from atlantis_netcfg.vpn.enrolment_package import open_package
from atlantis_netcfg.vpn.members import Onboarding

pytestmark = pytest.mark.slow

UNTIL = (datetime.now(UTC).date() + timedelta(days=20)).isoformat()
LAUV = ("name=lauv", "title=LAUV", "partner=udg", "kind=auv", "site=coastal", "cells=gps,wifi,ethernet")
LINES = ("# my own words", "---", "guests:", "  # the first of the year", "  old:")


@dataclass
class Quay:
    """Where somebody types, with an inventory and an authority of their own."""

    folder: Path
    capsys: pytest.CaptureFixture[str]

    @property
    def inventory(self) -> Path:
        return self.folder / "inventory"

    @property
    def file(self) -> Path:
        return self.inventory / guests.FILE

    @property
    def authority(self) -> Authority:
        return Authority.open(self.folder / "vpn")

    def type(self, *words: str, code: int = 0, passphrase: str | None = PASSPHRASE) -> str:
        line = [*words, f"inventory={self.inventory}"]
        if words[1] in {"invite", "dismiss"}:
            line.append(f"authority={self.folder / 'vpn'}")
        if passphrase is not None and words[1] in {"invite", "dismiss"}:
            with over_a_pipe(passphrase) as number:
                ended = main([*line, "--passphrase-fd", number])
        else:
            ended = main(line)
        printed = self.capsys.readouterr()
        assert ended == code, f"exit {ended}\n{printed.out}{printed.err}"
        return printed.out + printed.err

    def add(self, *more: str, code: int = 0, passphrase: str | None = PASSPHRASE) -> str:
        words = [*LAUV, *more]
        if not any(word.startswith("until=") for word in more):
            words.append(f"until={UNTIL}")
        return self.type("robot", "invite", *words, "--no-push", code=code, passphrase=passphrase)

    def end(self, *more: str, code: int = 5) -> str:
        """Exit code 5: nobody asks the server, and whoever is connected stays so."""
        return self.type("robot", "dismiss", "name=lauv", "--yes", "--no-push", *more, code=code)

    def files(self, name: str = "inventory") -> dict[str, bytes]:
        root = self.folder / name
        return {str(path.relative_to(root)): path.read_bytes() for path in root.rglob("*") if path.is_file()}


@pytest.fixture
def quay(
    tmp_path: Path,
    tmp_path_factory: pytest.TempPathFactory,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> Quay:
    monkeypatch.setenv("ATLANTIS_STATE", str(tmp_path / "state"))
    shutil.copytree(checkout() / "inventory", tmp_path / "inventory")
    shutil.copytree(founded(tmp_path_factory.getbasetemp()) / "vpn", tmp_path / "vpn")
    capsys.readouterr()
    return Quay(tmp_path, capsys)


@pytest.mark.smoke
def test_guest_is_added_checked_and_removed_without_a_trace(quay: Quay) -> None:
    """Commands alone; 0 files edited by hand; the declaration is as it was, byte for byte."""
    before = quay.files()
    printed = quay.add()
    assert f"lauv: added to group_vars/all/guests.yml, a guest until {UNTIL}" in printed
    (sealed,) = (quay.folder / "vpn").glob("handouts/*/*.age")
    (secret,) = [line.split()[1] for line in printed.splitlines() if line.startswith("  passphrase  ")]
    handed = open_package(sealed.read_bytes(), Secret(secret))
    assert {"udg-lauv.ovpn", "cyclonedds.xml", "fastdds.xml"} <= set(handed)

    answers = quay.folder / "lauv.yml"
    rows = "\n".join(f"  lauv/{cell}: {{verdict: PASS}}" for cell in ("wifi", "gps", "ethernet"))
    answers.write_text(f"name: A. Technician\nanswers:\n{rows}\nsign: true\n")
    line = ("check", "site=coastal", "vehicle=lauv", "--rehearse", "--answers", str(answers), "--json")
    document = json.loads(quay.type(*line))
    assert document["signed"]["by"] == "A. Technician"
    assert [(item["id"], item["verdict"], item["table3"]) for item in document["items"]] == [
        (f"lauv/{cell}", "PASS", False) for cell in ("wifi", "gps", "ethernet")
    ]
    assert (
        f"LAUV is a guest of Universitat de Girona until {UNTIL}, not a robot of the report's Table 3"
        in (document["notes"])
    )

    printed = quay.end()
    assert "udg-lauv: revoked" in printed
    assert "ended here; the server is not updated yet; not in the inventory, no valid certificate" in printed
    assert quay.files() == before
    assert list((quay.folder / "vpn" / "handouts").iterdir()) == []
    (member,) = guests.members_of(quay.authority, "lauv")
    assert (member.good, quay.authority.membership().queued_names) == ((), ("udg-lauv",))
    assert quay.authority.check() == []


def test_no_certificate_is_valid_beyond_the_last_day(quay: Quay) -> None:
    quay.add()
    (member,) = guests.members_of(quay.authority, "lauv")
    zone = ZoneInfo(load(quay.inventory).pilot.time_zone)
    end = datetime.combine(date.fromisoformat(UNTIL) + timedelta(days=1), datetime.min.time(), zone)
    (certificate,) = member.good
    assert end - timedelta(days=1, minutes=1) < certificate.not_after <= end
    words = ("vpn", "renew", "name=udg-lauv", "--no-push", f"authority={quay.folder / 'vpn'}")
    with over_a_pipe(PASSPHRASE) as number:
        quay.type(*words, "--passphrase-fd", number)
    assert max(each.not_after for each in guests.members_of(quay.authority, "lauv")[0].good) <= end
    printed = quay.type(*words, "days=90", code=3)
    assert f"`days=90`: guest `lauv` stays until {UNTIL}" in printed


def test_plan_shows_changes_and_changes_nothing(quay: Quay) -> None:
    before, authority = quay.files(), quay.files("vpn")
    printed = quay.add("--plan", code=2, passphrase=None)
    assert "would add lauv to group_vars/all/guests.yml: gps, wifi, ethernet, tested at coastal" in printed
    assert "would give udg-lauv VPN access for 20 days" in printed
    assert (quay.files(), quay.files("vpn")) == (before, authority)
    quay.add()
    there, authority = quay.files(), quay.files("vpn")
    assert "nothing to do: already complete" in quay.add("--plan", passphrase=None)
    printed = quay.type("robot", "dismiss", "name=lauv", "--plan", code=2, passphrase=None)
    assert printed.splitlines() == [
        "would revoke the VPN access of udg-lauv permanently",
        "would remove lauv from group_vars/all/guests.yml",
    ]
    assert (quay.files(), quay.files("vpn")) == (there, authority)


def test_repeated_add_changes_nothing(quay: Quay) -> None:
    quay.add()
    there, authority = quay.files(), quay.files("vpn")
    assert "udg-lauv: unchanged" in quay.add(passphrase=None)
    assert (quay.files(), quay.files("vpn")) == (there, authority)


def test_different_guest_of_the_same_name_is_refused_with_the_end_command(quay: Quay) -> None:
    before = quay.files()
    quay.add()
    words = (*LAUV[:-1], "cells=gps", f"until={UNTIL}", "--no-push")
    printed = quay.type("robot", "invite", *words, code=3)
    assert "the guest `lauv` is already in the inventory, with other values" in printed
    (typed,) = advised(said(printed, "`provision robot dismiss name={}` removes it; or correct {}"))
    ours = [word for word in typed if not word.startswith(("inventory=", "authority="))]
    assert "lauv: ended here" in quay.type(*ours, "--yes", "--no-push", code=5)
    assert quay.files() == before


def test_printed_checklist_command_is_for_the_guest(quay: Quay) -> None:
    printed = said(quay.add(), "its checklist: provision check site={} vehicle={}")
    (typed,) = advised(printed)
    assert "lauv/gps: LAUV has a valid position" in quay.type(*typed, "--rehearse", code=6)


def test_interrupted_add_can_be_undone_as_suggested(quay: Quay, monkeypatch: pytest.MonkeyPatch) -> None:
    before = quay.files()

    def stop(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr("atlantis_netcfg.cli.vpn.members.close", stop)
        printed = quay.add(code=5)
    hint = "recorded changes remain: run the same command again, or undo all with `provision robot dismiss name=NAME`"
    (typed,) = advised(said(printed, hint))
    ours = [word.replace("NAME", "lauv") for word in typed if not word.startswith(("inventory=", "authority="))]
    assert "lauv: ended here" in quay.type(*ours, "--yes", "--no-push", code=5)
    assert quay.files() == before


@pytest.mark.parametrize("onward", ["add", "end"])
def test_kill_between_declaring_and_issuing_can_be_completed_or_undone(
    quay: Quay, onward: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The process dies behind the first step: what a killed one leaves is the entry, and no member."""
    before = quay.files()

    def killed(*_: object) -> None:
        raise _KilledError

    with monkeypatch.context() as patch:
        patch.setattr(Onboarding, "issue", killed)
        patch.setattr(guests, "members_of", killed)  # nothing is taken back by who is dead
        with pytest.raises(_KilledError):
            quay.add()
    assert quay.files() != before
    assert guests.members_of(quay.authority, "lauv") == ()
    if onward == "add":
        assert "udg-lauv: udg-lauv, address" in quay.add()
        quay.end()
    else:
        assert "lauv: ended; not in the inventory" in quay.end(code=0)
    assert quay.files() == before


@pytest.mark.smoke("write")
@pytest.mark.parametrize("step", ["write", "remove_packages", "left_over"])
def test_killed_end_is_completed_by_repeating(quay: Quay, step: str, monkeypatch: pytest.MonkeyPatch) -> None:
    before = quay.files()
    quay.add()

    def killed(*_: object) -> None:
        raise _KilledError

    with monkeypatch.context() as patch:
        patch.setattr(inventory_files if step == "write" else guests, step, killed)
        with pytest.raises(_KilledError):
            quay.end()
    assert "ended here; the server is not updated yet; not in the inventory" in quay.end()
    assert quay.files() == before
    assert list((quay.folder / "vpn" / "handouts").iterdir()) == []


class _KilledError(BaseException):
    """In place of SIGKILL."""


def test_concurrent_add_waits_and_neither_is_lost(quay: Quay, monkeypatch: pytest.MonkeyPatch) -> None:
    """A second one typed while the first is at work: after it, both are there."""
    other = ("name=old", "title=OLD", *LAUV[2:], f"until={UNTIL}", "--no-push")
    seconds: list[str] = []
    issue = Onboarding.issue

    def interrupted(*words: Any) -> Any:  # noqa: ANN401 - as it is called
        with monkeypatch.context() as patch:
            patch.setattr(Onboarding, "issue", issue)
            seconds.append(quay.type("robot", "invite", *other, code=4))
            seconds.append(quay.type("robot", "dismiss", "name=lauv", "--yes", "--no-push", code=4))
            assert "would add old to group_vars/all/guests.yml" in quay.type(
                "robot", "invite", *other, "--plan", code=2, passphrase=None
            )
        return issue(*words)

    before = quay.files()
    with monkeypatch.context() as patch:
        patch.setattr(Onboarding, "issue", interrupted)
        quay.add()
    for printed in seconds:
        assert "the guest file is locked by" in printed
        assert "provision robot invite name=lauv" in printed
    assert [key for key, one in load(quay.inventory).vehicles.items() if isinstance(one, Guest)] == ["lauv"]
    quay.type("robot", "invite", *other)
    assert [key for key, one in load(quay.inventory).vehicles.items() if isinstance(one, Guest)] == ["lauv", "old"]
    quay.end()
    quay.type("robot", "dismiss", "name=old", "--yes", "--no-push", code=5)
    assert quay.files() == before


@pytest.mark.smoke
def test_the_wrong_passphrase_leaves_nothing(quay: Quay) -> None:
    before = quay.files()
    assert "wrong passphrase, or the file was changed" in quay.add(code=3, passphrase=f"{PASSPHRASE}r")
    assert quay.files() == before
    assert guests.members_of(quay.authority, "lauv") == ()


def test_comments_and_other_guests_stay(quay: Quay) -> None:
    """What a person has added to the file stays, also what stands behind the guest that goes."""
    old = {"name": "OLD", "kind": "asv", "partner": "udg", "until": "2027-01-01", "tested_at": ["te4sea"], "table3": []}
    text = "\n".join([*LINES, *(f"    {key}: {json.dumps(value)}" for key, value in old.items())])
    quay.file.write_text(f"{text}\n  # the last word\n")
    before = quay.files()
    quay.add()
    assert quay.file.read_text().startswith(f"{text}\n  # the last word\n  lauv:\n")
    assert [key for key, one in load(quay.inventory).vehicles.items() if isinstance(one, Guest)] == ["old", "lauv"]
    quay.end()
    assert quay.files() == before
    assert "no such guest: `ald`" in quay.type("robot", "dismiss", "name=ald", "--plan", code=7)


@pytest.mark.parametrize(
    ("words", "code", "says"),
    [
        (("name=Lauv",), 3, "has capital letters"),
        (("name=sparus",), 3, "`sparus` is in vehicles.yml, and is not a guest of this command"),
        (("partner=iqa",), 3, "`partner=iqa`: no such partner"),
        (("site=costal",), 3, "did you mean `coastal`?"),
        (("until=soon",), 3, "`until=soon` is not a date"),
        (("until=2020-01-01",), 3, "the stay of guest `lauv` ended on 2020-01-01"),
        (("title=Sparus",), 3, "`Sparus` is a robot of the report's Table 3, not a guest"),
        (("link=wire",), 3, "`link=`: unknown value `wire`"),
    ],
)
def test_invalid_request_is_reported_and_nothing_is_written(
    quay: Quay, words: Sequence[str], code: int, says: str
) -> None:
    before, authority = quay.files(), quay.files("vpn")
    given = {word.partition("=")[0]: word for word in (*LAUV, f"until={UNTIL}")}
    given |= {word.partition("=")[0]: word for word in words}
    assert says in quay.type("robot", "invite", *given.values(), "--no-push", code=code)
    assert (quay.files(), quay.files("vpn")) == (before, authority)


def test_revoked_name_is_never_reused_and_leaves_no_entry(quay: Quay) -> None:
    before = quay.files()
    quay.add()
    quay.end()
    assert ". Names cannot be used again" in quay.add(code=3)
    assert quay.files() == before


@dataclass
class Told:
    """A server that answers."""

    cuts: list[tuple[str, ...]] = field(default_factory=list)
    away: bool = False

    def require_current_record(self, authority: Authority, notify: Subscriber) -> None:
        """It knows nothing that the record does not."""

    def get_crl(self, notify: Subscriber) -> bytes:
        raise NotImplementedError

    def deploy(self, authority: Authority, notify: Subscriber) -> DeployResult:  # noqa: ARG002 - of the protocol
        return DeployResult(("the server has it",))

    def disconnect(self, authority: Authority, revocation: RevocationResult, notify: Subscriber) -> DeployResult:  # noqa: ARG002
        self.cuts.append(revocation.common_names)
        if self.away:
            return DeployResult(errors=(OutcomeUnknown("the server does not respond"),), is_deployed=False)
        authority.confirm_revocations(revocation.common_names)
        return DeployResult(("no session of udg-lauv",))


def test_revocation_is_pushed_again_until_the_server_answers(quay: Quay, monkeypatch: pytest.MonkeyPatch) -> None:
    there = Told(away=True)

    def server(*_: Any) -> Told:  # noqa: ANN401 - as the command calls it
        return there

    monkeypatch.setattr(_common, "server", server)
    assert "the server has it" in quay.add()
    assert "the server does not respond" in quay.end(code=5)
    there.away = False
    assert "lauv: ended; not in the inventory" in quay.end(code=0)
    assert there.cuts == [("udg-lauv",), ("udg-lauv",)]
    assert "lauv: unchanged; not in the inventory" in quay.end(code=0)
    assert len(there.cuts) == 2


@pytest.mark.smoke
def test_leftovers_are_named_and_fail_the_command(quay: Quay, monkeypatch: pytest.MonkeyPatch) -> None:
    quay.add()
    monkeypatch.setattr(guests, "remove_packages", lambda *_: None)
    printed = quay.end(code=6)
    assert "parts of lauv are left:" in printed
    assert "handouts/udg-lauv still exists" in printed
    assert "; not in the inventory" not in printed
