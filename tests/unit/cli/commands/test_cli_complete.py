"""What Tab offers in a line, and that it answers quickly and silently whatever is wrong."""

import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from pilot_commands import Table, done
from row_subtests import for_each_row

from atlantis_netcfg.cli import main
from atlantis_netcfg.cli.base.commands import COMMANDS
from atlantis_netcfg.cli.shell._suggestions import candidates
from atlantis_netcfg.runs import RunStart, Store

PROGRAM = (sys.executable, "-P", "-m", "atlantis_netcfg")
COASTAL = ["coastal-router", "coastal-cpe", "coastal-4g", "coastal-sat", "coastal-gateway"]


def offered(*typed: str) -> list[str]:
    return [value for value, _ in candidates(typed, COMMANDS)]


@for_each_row(
    ("typed", "expected"),
    [
        (["rep"], ["report"]),
        (["vp"], ["vpn"]),
        (["vpn", "re"], ["renew", "revoke"]),
        (["help", "completion", ""], ["shell="]),
        (["help", "completion", "shell="], ["shell=bash", "shell=zsh", "shell=fish"]),
        (["links", "u"], ["use"]),
        (["report", "dri"], ["drift"]),
        (["si"], ["site="]),
        (["site=coa"], ["site=coastal"]),
        (["site=coastal", "dev"], ["device="]),
        (["site=coastal", "--reh"], ["--rehearse"]),
        (["plan", "site=coastal", "--pl"], []),
        (["plan", "site=co"], ["site=coastal"]),
        (["report", "drift", "site="], ["site=scc", "site=coastal", "site=te4sea"]),
        (["report", "drift", "site=coastal", "device="], [f"device={name}" for name in COASTAL]),
        (["report", "drift", "site=coastal", "device=coastal-4g,coastal-s"], ["device=coastal-4g,coastal-sat"]),
        (["report", "drift", "site=coastal", "device=coastal-4g,coastal-4"], []),
        (["device", "verify", "device=te4sea-r"], ["device=te4sea-router"]),
        (["robot", "dds", "device=scc-c"], ["device=scc-cpe", "device=scc-control"]),
        (["check", "site=coastal", "vehicle=sp"], ["vehicle=sparus"]),
        (["check", "endpoint=wifi,g"], ["endpoint=wifi,gps"]),
        (["vpn", "onboard", "partner=iq"], ["partner=iqua"]),
        (["vpn", "onboard", "device=coastal-r"], ["device=coastal-router"]),
        (["check", "--answers", ""], []),
        (["run", "--lang", ""], ["en", "pt"]),
        (["--lang", "pt", "report", "drift", "si"], ["site="]),
        (["--lang", "pt", "rep"], ["report"]),
        (["site=coastal", "rep"], []),
        (["nonsense", ""], []),
        (["report", "drift", "qqq="], []),
    ],
    ids=" ".join,
)
def test_completions(typed: list[str], expected: list[str]) -> None:
    assert offered(*typed) == expected


def test_empty_line_completes_commands_and_run_arguments() -> None:
    words = offered("")
    assert words[:5] == ["run", "plan", "check", "links", "recover"]
    assert "site=" in words
    assert "complete" not in words
    assert {name.split()[0] for name in COMMANDS} <= set(words)


def test_every_argument_and_flag_completes_with_its_help(monkeypatch: pytest.MonkeyPatch) -> None:
    table = Table(monkeypatch, done)
    assert candidates(["show", ""], table) == [("site=", "the site to show")]
    assert candidates(["run", "site=x", "--"], table)[:2] == [
        ("--plan", "stop after planning"),
        ("--keep", "keep the run there"),
    ]


@pytest.fixture
def runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Two runs of one site and one of another, as the journal keeps them."""
    monkeypatch.setenv("ATLANTIS_STATE", str(tmp_path / "state"))
    names = []
    for site in ("coastal", "coastal", "scc"):
        started = RunStart(site=site, revision="", tool="", hosts=(), rehearsed=False, command="provision")
        with Store(tmp_path / "state").start(started) as journal:
            names.append(journal.run)
    return names


def test_runs_of_the_site_complete_newest_first(runs: list[str]) -> None:
    first, second, other = runs
    assert offered("recover", "rollback", "site=coastal", "run=2") == [f"run={second}", f"run={first}"]
    assert offered("recover", "rollback", "site=coastal", "run=l") == ["run=latest"]
    assert offered("device", "restore", "device=coastal-router", "site=scc", "run=") == ["run=latest", f"run={other}"]
    assert offered("recover", "resume", "site=coastal", "run=") == [f"run={second}", f"run={first}"]


def test_completion_creates_no_state_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ATLANTIS_STATE", str(tmp_path / "state"))
    assert offered("recover", "resume", "site=coastal", "run=") == []
    assert not (tmp_path / "state").exists()


def broken_inventories(folder: Path) -> Iterator[tuple[str, list[str]]]:
    """Inventories with the sites that can still be offered."""
    yield str(folder / "nowhere"), []
    for name, text, sites in (
        ("torn", "all:\n  children:\n    sites:\n      children:\n        quay:\n          hosts: [\n", ["quay"]),
        ("empty", "", []),
        ("list", "- all\n- sites\n", []),
        ("binary", "\x00\x01", []),
        ("spaces", "all: {children: {sites: {children: {'a b': {}, '$(id)': {}, good: {}}}}}\n", ["good"]),
        ("vaulted", "all: {children: {sites: {children: {quay: !vault x, dock: *nobody}}}}\n", ["quay", "dock"]),
    ):
        (folder / name).mkdir()
        (folder / name / "hosts.yml").write_text(text, encoding="utf-8")
        yield str(folder / name), sites
    (folder / "latin").mkdir()
    (folder / "latin" / "hosts.yml").write_bytes(b"all: \xff\xfe")
    yield str(folder / "latin"), []


def test_broken_inventory_shortens_completions_silently(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for folder, sites in broken_inventories(tmp_path):
        assert main(["complete", "report", "drift", f"inventory={folder}", "site="]) == 0
        printed = capsys.readouterr()
        assert (printed.err, printed.out.split()) == ("", [f"site={site}" for site in sites]), folder


def test_completion_is_fast_and_prints_nothing_else() -> None:
    """A person waits at each Tab: 1 s on a busy machine is five times what it takes."""
    typed = [*PROGRAM, "complete", "report", "drift", "site=coastal", "device=coastal-r"]
    times = []
    for _ in range(3):
        begun = time.monotonic()
        answered = subprocess.run(typed, capture_output=True, text=True, check=True)
        times.append(time.monotonic() - begun)
        assert (answered.stdout, answered.stderr) == ("device=coastal-router  \n", "")
    assert min(times) < 1.0


HEAVY = ("ansible", "asyncio", "cryptography", "jinja2", "pydantic", "rich")


def test_completion_imports_nothing_heavy() -> None:
    source = (
        "import sys; from atlantis_netcfg.cli import main; main(['complete', 'report', 'drift', 'site=co']);"
        " print(*sys.modules, file=sys.stderr)"
    )
    process = subprocess.run([PROGRAM[0], "-P", "-c", source], capture_output=True, text=True, check=True)
    assert {module.partition(".")[0] for module in process.stderr.split()}.isdisjoint(HEAVY)
    assert process.stdout == "site=coastal  \n"
