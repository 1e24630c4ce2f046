"""`provision inventory doctor`: its screen, its exit codes, and that what it advises can be typed."""

import json
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from hints_said import advised
from laptop_network import Plug, network

from atlantis_netcfg import __version__
from atlantis_netcfg.cli import laptop, main
from atlantis_netcfg.cli.base.syntax import parse
from atlantis_netcfg.core.errors import ExitCode, NetcfgError
from atlantis_netcfg.core.events import Verdict
from atlantis_netcfg.core.paths import checkout
from atlantis_netcfg.operations import doctor
from atlantis_netcfg.operations.doctor import Diagnosis, DoctorItem, DoctorSection
from atlantis_netcfg.operations.doctor.network import NetworkUnreadable

WELL = DoctorItem(DoctorSection.CLOCK, "time", Verdict.PASS, "right")


@pytest.fixture(autouse=True)
def quiet_laptop(monkeypatch: pytest.MonkeyPatch) -> None:
    """The network of whoever runs the tests is not looked at, nor the versions of what is installed there."""
    monkeypatch.setattr(doctor, "read_network", lambda _address: network(Plug("eth0")))
    monkeypatch.setattr(doctor, "software_items", lambda *_, **__: iter(()))


def typed(capsys: pytest.CaptureFixture[str], *words: str, code: int = 0) -> str:
    ended = main(["inventory", "doctor", *words])
    printed = capsys.readouterr()
    assert ended == code, printed.out + printed.err
    return printed.out + printed.err


def shown(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, *items: DoctorItem, follows: str = ""
) -> str:
    monkeypatch.setattr(doctor, "examine", lambda *_, **__: Diagnosis(items, "coastal", follows))
    main(["inventory", "doctor", "site=coastal"])
    first, _, rest = capsys.readouterr().out.partition("\n")
    assert first == f"provision {__version__} checks this laptop (read-only)"
    return rest


def item(verdict: Verdict, name: str = "address", **more: object) -> DoctorItem:
    return DoctorItem(DoctorSection.WAY, name, verdict, "it was measured", **more)  # type: ignore[arg-type] # names of fields


@pytest.mark.parametrize(
    ("verdicts", "code"),
    [
        ((Verdict.PASS, Verdict.SKIP), ExitCode.DONE),
        ((Verdict.PASS, Verdict.WARN), ExitCode.DONE),
        ((Verdict.WARN, Verdict.FAIL), ExitCode.CHECKS_FAILED),
        ((Verdict.PASS, Verdict.INCONCLUSIVE), ExitCode.CHECKS_FAILED),
        ((Verdict.PASS, Verdict.ERROR), ExitCode.CHECKS_FAILED),
        ((Verdict.SKIP,), ExitCode.NOTHING),
        ((), ExitCode.NOTHING),
    ],
)
def test_exit_code_follows_from_the_verdicts(verdicts: tuple[Verdict, ...], code: ExitCode) -> None:
    assert Diagnosis(tuple(map(item, verdicts))).exit is code


def test_passing_diagnosis_suggests_the_next_command(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    assert shown(capsys, monkeypatch, WELL, item(Verdict.SKIP), follows="provision plan site=coastal") == (
        "Clock\n"
        "  PASS time                right\n"
        "Connection to the site\n"
        "  SKIP address             it was measured\n"
        "\n"
        "PASS: 1 PASS, 1 SKIP\n"
        "type:  provision plan site=coastal\n"
    )


def test_worst_item_and_its_fix_are_printed_last(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    warned = item(Verdict.WARN, "default route", commands=("sudo ip route del default",))
    failed = item(Verdict.FAIL, hint="do this", commands=("sudo ip address add 192.0.2.7/24 dev eth0",))
    assert shown(capsys, monkeypatch, warned, failed, WELL, follows="provision plan site=coastal") == (
        "Clock\n"
        "  PASS time                right\n"
        "Connection to the site\n"
        "  WARN default route       it was measured\n"
        "       type: sudo ip route del default\n"
        "  FAIL address             it was measured\n"
        "       do:   do this\n"
        "       type: sudo ip address add 192.0.2.7/24 dev eth0\n"
        "\n"
        "FAIL: 1 FAIL, 1 WARN, 1 PASS\n"
        "worst: address: it was measured\n"
        "next:  do this\n"
        "type:  sudo ip address add 192.0.2.7/24 dev eth0\n"
    )


def test_warning_alone_still_suggests_the_next_command(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    printed = shown(capsys, monkeypatch, item(Verdict.WARN, hint="look"), follows="provision plan site=coastal")
    assert printed.endswith(
        "\nWARN: 1 WARN\nworst: address: it was measured\nnext:  look\nthen:  provision plan site=coastal\n"
    )


def test_long_name_or_verdict_gets_its_own_line(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    long = item(Verdict.PASS, "SSH key for coastal-gateway")
    assert shown(capsys, monkeypatch, long, item(Verdict.INCONCLUSIVE)).startswith(
        "Connection to the site\n"
        "  PASS SSH key for coastal-gateway\n"
        "                           it was measured\n"
        "  INCONCLUSIVE address\n"
        "                           it was measured\n"
    )


@pytest.mark.parametrize("site", [(), ("site=coastal",)])
def test_output_fits_80_columns(capsys: pytest.CaptureFixture[str], site: tuple[str, ...]) -> None:
    printed = typed(capsys, *site)
    assert [line for line in printed.splitlines() if len(line) > 80 and "/" not in line] == []
    assert printed.count("\n") > 15


def test_json_document_lists_all_items(capsys: pytest.CaptureFixture[str]) -> None:
    document = json.loads(typed(capsys, "site=coastal", "--json"))
    assert (document["exit"], document["errors"], document["site"]) == (0, [], "coastal")
    assert sum(document["counts"].values()) == len(document["items"]) > 10
    assert {each["section"] for each in document["items"]} >= {"clock", "way", "keys", "folders"}
    (way,) = [each for each in document["items"] if each["name"] == "way"]
    assert way["verdict"] == "SKIP", "example addresses lead to nobody's devices"


def test_diagnosis_creates_no_files(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("ATLANTIS_STATE", str(tmp_path / "state"))
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    typed(capsys, "site=coastal")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("words", "code", "expected"),
    [
        (("site=costal",), 7, "did you mean `coastal`?"),
        (("site=all",), 3, "a laptop is at one site"),
        (("inventory=/nowhere",), 7, "does not exist"),
    ],
)
def test_invalid_arguments_are_reported(
    capsys: pytest.CaptureFixture[str], words: tuple[str, ...], code: int, expected: str
) -> None:
    assert expected in typed(capsys, *words, code=code)


def test_unreadable_network_is_inconclusive(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def unreadable(_address: object) -> None:
        raise NetworkUnreadable("`ip` is not installed on this laptop")

    monkeypatch.setattr(doctor, "read_network", unreadable)
    printed = typed(capsys, code=6)
    assert "  INCONCLUSIVE network\n                           `ip` is not installed on this laptop\n" in printed


def test_missing_record_folder_does_not_stop_the_other_checks(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.delenv("ATLANTIS_STATE")
    monkeypatch.setenv("HOME", str(tmp_path / "missing"))
    printed = typed(capsys, code=6)
    assert "worst: record folder: cannot store the journal" in printed
    assert "PASS ports" in printed


def last(printed: str) -> list[str]:
    """The command of the last line, as the words that a person would type after `provision`."""
    (words,) = advised(printed.splitlines()[-1])
    return words


def test_next_suggestion_is_doctor_for_a_site(capsys: pytest.CaptureFixture[str]) -> None:
    words = last(typed(capsys))
    assert words == ["inventory", "doctor", "site=scc"]
    typed(capsys, *words[2:])


def test_inventory_errors_suggest_the_validate_command(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    root = shutil.copytree(checkout() / "inventory", tmp_path / "inventory")
    (root / "host_vars" / "coastal-router.yml").write_text("device: {kind: router}\n")
    words = last(typed(capsys, f"inventory={root}", code=6))
    assert words == ["inventory", "validate", f"inventory={root}"]
    assert main(words) == 3
    assert "coastal-router.yml:1" in capsys.readouterr().err


class NothingBehindIt(NetcfgError):
    """It was understood, and there is nothing to work on."""

    exit = ExitCode.NOTHING

    def __init__(self) -> None:
        super().__init__("nothing was tried")


def test_example_inventory_suggests_a_rehearsal(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    words = last(typed(capsys, "site=te4sea"))
    seen: list[object] = []

    def rehearsed(opened: object, _twins: object) -> object:
        seen.append(opened)
        raise NothingBehindIt

    monkeypatch.setattr("atlantis_netcfg.cli.base.rehearsal.rehearse", rehearsed)
    monkeypatch.setattr("atlantis_netcfg.operations.common.rehearsal.rehearsal", _no_twins)
    assert main(words) == 7
    assert len(seen) == 1


@contextmanager
def _no_twins(*_: object) -> Iterator[object]:
    yield object()


def test_suggested_commands_carry_the_same_inventory(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(checkout())
    arguments = parse(laptop.DOCTOR, ["inventory=the inventory"])
    assert laptop._complete_commands(
        ("provision device trust site=coastal", "sudo ip link set eth0 up"), arguments
    ) == [
        "provision device trust site=coastal 'inventory=the inventory'",
        "sudo ip link set eth0 up",
    ]
