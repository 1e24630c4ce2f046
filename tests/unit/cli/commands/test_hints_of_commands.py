"""What commands advise without a device is typed as it was printed; after a stop, the words fit the command."""

import json
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import pytest
from check_desk import RADIO, Sitting
from hints_said import advised, said
from row_subtests import for_each_row

from atlantis_netcfg.checklist._signing import render_json
from atlantis_netcfg.cli import main
from atlantis_netcfg.cli.base import commands, session
from atlantis_netcfg.cli.base.commands import COMMANDS
from atlantis_netcfg.cli.checklist import check_run
from atlantis_netcfg.core.errors import ExitCode, NetcfgError, worst
from atlantis_netcfg.core.paths import checkout
from atlantis_netcfg.inventory import load
from atlantis_netcfg.runs import RunStart, Store
from atlantis_netcfg.runs.report.run import RunReport

ROOT = checkout() / "inventory"
CHANGING = [name for name in COMMANDS if commands.load(name, COMMANDS).command.changes]


class Place:
    def __init__(self, folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
        self.folder, self.capsys, self.monkeypatch = folder, capsys, monkeypatch
        self.state = folder / "state"
        self.tried: list[str] = []
        """Whose proof was begun."""

    def type(self, *words: str, code: int = 0) -> str:
        ended = main(words)
        printed = self.capsys.readouterr()
        assert ended == code, f"exit {ended}\n{printed.out}{printed.err}"
        return printed.out + printed.err


@pytest.fixture
def at(tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> Place:
    """Values of the inventory are taken for real ones; a checklist is opened and closed, and asks nobody."""
    shipped = load(ROOT)
    real = replace(shipped, pilot=shipped.pilot.model_copy(update={"example_values": False}))
    monkeypatch.setattr("atlantis_netcfg.inventory.load", lambda folder, **_: real if folder == ROOT else load(folder))
    monkeypatch.setattr(check_run, "_look", lambda *_: None)
    monkeypatch.setenv("ATLANTIS_STATE", str(tmp_path / "state"))
    return Place(tmp_path, capsys, monkeypatch)


def kept(at: Place, *, sign: bool) -> Path:
    folder = at.state / "real" / "coastal"
    desk = Sitting(folder, [], (RADIO,), {"sparus/wifi": ["PASS hears the boat"]})
    with desk.book() as book:
        desk.turn(book).with_a_person(desk.desk)
        if sign:
            book.sign("A. Technician", lambda _document: {"report.html": b"well"})
        return book.folder


def not_signed(at: Place) -> str:
    """A report whose signature somebody has left away."""
    document = json.loads((kept(at, sign=True) / "report.json").read_bytes())
    file = at.folder / "report.json"
    file.write_bytes(render_json({**document, "signed": None}))
    return at.type("report", "verify", f"file={file}", code=6)


def damaged(at: Place) -> str:
    folder = kept(at, sign=True)
    (folder / "records.jsonl").write_bytes(b"")
    (folder / "report.json").write_bytes(b"")
    return at.type("report", "show", "site=coastal", code=4)


def no_such_item(at: Place) -> str:
    desk = Sitting(at.state / "real" / "coastal", [], (RADIO,), {})
    with desk.book() as book, pytest.raises(NetcfgError) as refused:
        book.item("qqq")
    return str(refused.value.hint)


def a_satellite_with_canaries(at: Place) -> str:
    shutil.copytree(ROOT, at.folder / "inventory")
    site = at.folder / "inventory/group_vars/coastal.yml"
    text = site.read_text()
    place = text.index("kind: satellite")
    line = text.rindex("\n", 0, place) + 1
    indent = " " * (len(text[line:place]) - len(text[line:place].lstrip(" -")))
    site.write_text(f"{text[:place]}canaries: [192.0.2.53, 192.0.2.54]\n{indent}{text[place:]}")
    return at.type("inventory", "validate", f"inventory={at.folder / 'inventory'}", code=3)


def stopped_at_the_end(at: Place) -> str:
    def stop(*_: object) -> ExitCode:
        raise KeyboardInterrupt

    started = RunStart(
        site="coastal", revision="1", tool="1", hosts=("coastal-router",), rehearsed=False, command="provision"
    )
    with Store(at.state).start(started):
        pass
    with at.monkeypatch.context() as patch:
        patch.setattr("atlantis_netcfg.cli.runs.run_site", stop)
        return at.type("site=coastal", code=5)


SITUATIONS: dict[str, tuple[Callable[[Place], str], str, int, str]] = {
    "a word that there is not": (
        lambda at: at.type("report", "runs", "qqq", code=3),
        "`provision {} --help` lists its arguments and options",
        0,
        "provision report runs",
    ),
    "nothing was signed": (
        lambda at: at.type("report", "verify", code=7),
        "`provision check site=NAME` ends with signing",
        6,
        "coastal",
    ),
    "no checklist": (
        lambda at: at.type("report", "checklists", "site=coastal", code=7),
        "; `provision check site={}{}` starts one",
        6,
        "coastal",
    ),
    "damaged": (damaged, "check it with `provision report verify`", 6, "NOT VERIFIED"),
    "not signed": (
        not_signed,
        "nobody has signed it: `provision check site={}{}` continues it, on the computer on which it was made",
        6,
        "coastal",
    ),
    "nothing is left": (
        lambda at: at.type("check", "site=coastal", "vehicle=stork", "endpoint=acoustic", code=7),
        "remove an argument: `provision check site={}` lists all items",
        6,
        "sparus/wifi",
    ),
    "recovery with others": (
        lambda at: at.type("check", "site=coastal", "phase=quay,recovery", code=3),
        "`provision check site={} phase=recovery` on its own, when the vehicles are back",
        6,
        "mares/items/rinsed",
    ),
    "integration of nobody": (
        lambda at: at.type("check", "site=coastal", "phase=integration", code=3),
        "name it: `provision check site={} vehicle={} phase=integration`",
        6,
        "girona500/integration/discovery",
    ),
    "integration with others": (
        lambda at: at.type("check", "site=coastal", "vehicle=sparus", "phase=quay,integration", code=3),
        "`provision check site={} vehicle={} phase=integration` on its own",
        6,
        "sparus/integration/discovery",
    ),
    "recovery is to come": (
        lambda at: at.type("check", "site=coastal", "endpoint=items", code=6),
        (
            "{} still to come, in a separate checklist, when the vehicles are back: `provision check site={}{} "
            "phase=recovery`"
        ),
        6,
        "mares/items/rinsed",
    ),
    "no such item": (no_such_item, "`provision check site={}` lists all ids", 6, "sparus/wifi"),
    "stopped at the end": (
        stopped_at_the_end,
        "`provision report runs` shows what was confirmed, and how to continue an unfinished run",
        0,
        "continue: `provision recover resume site=coastal run=",
    ),
}


@pytest.mark.parametrize("name", SITUATIONS)
def test_advised_commands_work_when_typed(name: str, at: Place) -> None:
    brings, hint, code, says = SITUATIONS[name]
    (words,) = advised(said(brings(at), hint))
    assert says in at.type(*(word.replace("NAME", "coastal") for word in words), code=code)


def test_satellite_is_not_probed_automatically(at: Place) -> None:
    hint = "remove `canaries:`; `provision measure satellite site={}` tests the satellite on request"
    (words,) = advised(said(a_satellite_with_canaries(at), hint))
    at.monkeypatch.setattr("atlantis_netcfg.cli.links._prove", _tried(at))
    at.type(*words, code=7)
    assert at.tried == ["coastal-router"]


def _tried(at: Place) -> Callable[..., object]:
    """In place of the router: say whom it would have been."""

    def prove(opened: session.CommandSession) -> object:
        at.tried.append(opened.hosts[0].name)
        raise NothingBehindIt

    return prove


class NothingBehindIt(NetcfgError):
    """Nothing stands behind the router's address here."""

    exit = ExitCode.NOTHING

    def __init__(self) -> None:
        super().__init__("nothing was tried")


def test_rehearsal_advised_for_example_values_starts(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    assert main(["inventory", "validate"]) == 0
    (words,) = advised(said(capsys.readouterr().out, "`provision site={} --rehearse`"))
    seen: list[object] = []

    def rehearsed(opened: object, _twins: object) -> object:
        seen.append(opened)
        raise NothingBehindIt

    monkeypatch.setattr("atlantis_netcfg.cli.base.rehearsal.rehearse", rehearsed)
    monkeypatch.setattr("atlantis_netcfg.operations.common.rehearsal.rehearsal", _no_twins)
    assert main([*words]) == 7
    (opened,) = seen
    assert isinstance(opened, session.CommandSession)
    assert (opened.site, opened.is_rehearsal) == (words[0].partition("=")[2], True)


@contextmanager
def _no_twins(*_: object) -> Iterator[object]:
    yield object()


# --- stops ---------------------------------------------------------------------------------------------------------


@for_each_row("name", CHANGING)
def test_resume_is_advised_only_for_resumable_commands(name: str) -> None:
    """A command that is no run of the engine goes on when it is typed again; `resume` would refuse it."""
    command = commands.load(name, COMMANDS).command
    assert command.plays != command.again.replace("recorded changes remain: ", "").startswith(
        "run the same command again"
    )
    assert "resume" not in command.again


@pytest.mark.parametrize("name", [name for name in CHANGING if not commands.load(name, COMMANDS).command.plays])
def test_a_stopped_command_that_is_no_run_is_typed_again(name: str, at: Place) -> None:
    def stop(*_: object) -> None:
        raise KeyboardInterrupt

    at.monkeypatch.setattr(COMMANDS[name].replace(":", ".run_"), stop)
    words = commands.load(name, COMMANDS).command.words
    printed = at.type(*name.split(), *(word.hint for word in words if word.is_required), code=5)
    assert "run the same command again" in printed
    assert not any("resume" in words for words in advised(printed))


def test_stop_before_anything_was_sent_reports_no_change(at: Place) -> None:
    def stop(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    at.monkeypatch.setattr("atlantis_netcfg.inventory.load", stop)
    for typed in (
        ("site=coastal", "--yes"),
        ("recover", "resume", "site=coastal"),
        ("recover", "rollback", "site=coastal", "run=x"),
    ):
        assert "nothing was changed" in at.type(*typed, code=4)


def test_hint_keeps_authority_and_rehearsal_options(at: Place) -> None:
    """In the folder of the authority that was named, and with the emulated devices."""
    (init,) = advised(at.type("vpn", "list", f"authority={at.folder / 'another'}", code=3))
    assert init == ["vpn", "init", f"authority={at.folder / 'another'}"]
    line = ("check", "site=coastal", "vehicle=stork", "endpoint=acoustic", "--rehearse")
    assert advised(at.type(*line, code=7)) == [["check", "site=coastal", "--rehearse"]]


def test_named_host_that_is_not_handled_is_not_green(at: Place) -> None:
    line = ("device", "backup", "site=coastal")
    assert "these devices are not supported yet" in at.type(*line, "device=coastal-gateway", code=7)
    assert "does not apply to coastal-gateway" in at.type(*line, "device=coastal-router,coastal-gateway", code=7)


@pytest.mark.parametrize(
    ("codes", "asks"), [((2, 6), True), ((2,), True), ((6,), False), ((2, 4), False), ((0,), False)]
)
def test_failed_check_of_one_device_does_not_block_the_others(
    codes: tuple[int, ...],
    asks: bool,  # noqa: FBT001 - a case
) -> None:
    devices = {f"d{place}": {"exit": code} for place, code in enumerate(codes)}
    planned = RunReport("coastal", is_rehearsal=False, devices=devices)
    assert (worst(session.CommandSession._plannable(planned)) is ExitCode.CHANGES) == asks
