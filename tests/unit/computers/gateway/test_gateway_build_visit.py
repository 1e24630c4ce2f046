"""One visit to a gateway: a build is started, joined, taken into use, or its failure told; systemd is played here."""

import json
import zipfile
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest

from atlantis_netcfg.ansible_collections.atlantis.netcfg.plugins.module_utils import build_plan
from atlantis_netcfg.ansible_collections.atlantis.netcfg.plugins.module_utils.build_start import Build, BuildFolders
from atlantis_netcfg.ansible_collections.atlantis.netcfg.plugins.module_utils.errors import ModuleError
from atlantis_netcfg.ansible_collections.atlantis.netcfg.plugins.module_utils.programs import ProgramResult

URL, TOKEN = "https://git.example.org/c4i/library.git", "CANARY-of-a-visit"


@dataclass
class Gateway:
    """A prefix, and a systemd that runs what it is told to until it is told otherwise."""

    folder: Path
    running: set[str] = field(default_factory=set)
    commands: list[list[str]] = field(default_factory=list)
    starts: bool = True
    compiler: bool = True

    @property
    def places(self) -> BuildFolders:
        return BuildFolders(*(str(self.folder / name) for name in ("prefix", "memory", "logs")))

    @property
    def shelf(self) -> build_plan.BuildStore:
        return build_plan.BuildStore(self.places.prefix)

    def run(self, argv: list[str]) -> ProgramResult:
        self.commands.append(argv)
        if argv[0] == "c++":
            return ProgramResult(
                0 if self.compiler else 127, "12\n" if argv[1] == "-dumpversion" else "x86_64-linux-gnu\n"
            )
        unit = next((word.partition("=")[2] for word in argv if word.startswith("--unit=")), argv[-1])
        if argv[0] == "systemd-run":
            self.running |= {unit} if self.starts else set()
            return ProgramResult(0 if self.starts else 1, "Failed to start")
        if argv[1] == "stop":
            self.running.discard(unit)
        return ProgramResult(0, "active\n" if unit in self.running else "inactive\n")

    def visit(
        self, revision: str = "v1", started: str | None = None, *, check: bool = False, examples: bool = False
    ) -> tuple[dict[str, Any], Build]:
        setup = self.folder / "setup.sh"
        setup.touch()
        library = build_plan.Repository(URL, revision)
        build = Build(
            library,
            build_plan.Repository(URL.replace("library", "examples"), revision) if examples else None,
            {"library": TOKEN},
            str(setup),
            None,
            None,
            check,
            self.places,
            self.run,
        )
        return build.visit(started), build

    def complete(self, told: dict[str, Any], notes: tuple[str, ...] = ()) -> None:
        install = Path(self.shelf.at(told["key"]), "library", "install")
        install.mkdir(parents=True)
        (install / "setup.sh").touch()
        self.shelf.complete(told["key"], {"commits": {"library": "a" * 40}, "notes": list(notes)})
        self.running.discard(told["unit"])

    def end(self, told: dict[str, Any], outcome: dict[str, Any] | None) -> None:
        self.running.discard(told["unit"])
        if outcome is not None:
            Path(self.places.outcome(told["key"])).write_text(json.dumps({"run": told["run"], **outcome}))


@pytest.fixture
def gateway(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Gateway:
    tools = tmp_path / "bin"
    tools.mkdir()
    for name in ("git", "colcon", "make", "cmake"):
        (tools / name).touch(mode=0o755)
    programs = "atlantis_netcfg.ansible_collections.atlantis.netcfg.plugins.module_utils.programs._PATH"
    monkeypatch.setattr(programs, str(tools))
    return Gateway(tmp_path)


def test_build_is_started_joined_activated_and_then_left_alone(gateway: Gateway) -> None:
    planned, wish = gateway.visit(check=True)
    assert (planned["state"], list(gateway.running), list((gateway.folder).glob("memory"))) == ("wanted", [], [])
    told, first = gateway.visit()
    assert first.changes == wish.changes == ["build of library v1 started"]
    assert told["state"] == "running"
    again, second = gateway.visit()
    assert (again["run"], second.changes) == (told["run"], [])
    with pytest.raises(ModuleError, match="is still running"):
        gateway.visit(started=told["run"])
    gateway.complete(told, ("a note",))
    ready, third = gateway.visit(started=told["run"])
    assert ready["state"] == "ready"
    assert third.changes == [f"build {told['key']} of library v1 activated"]
    assert third.notes == ["a note"]
    last, fourth = gateway.visit()
    assert (last["commits"], fourth.changes, fourth.notes) == ({"library": "a" * 40}, [], [])
    assert gateway.shelf.tags() == {URL: {"v1": "a" * 40}}


def test_reverted_inventory_reuses_the_kept_build(gateway: Gateway) -> None:
    keys = []
    for revision in ("v1", "v2"):
        told, _ = gateway.visit(revision)
        gateway.complete(told)
        gateway.visit(revision)
        keys.append(told["key"])
    started = sum(command[0] == "systemd-run" for command in gateway.commands)
    planned, wish = gateway.visit("v1", check=True)
    back, build = gateway.visit("v1")
    assert planned["state"] == back["state"] == "ready"
    assert build.changes == wish.changes == [f"build {keys[0]} of library v1 activated"]
    assert (gateway.shelf.link_target("current"), gateway.shelf.link_target("previous")) == (keys[0], keys[1])
    assert sum(command[0] == "systemd-run" for command in gateway.commands) == started


def test_token_is_kept_in_memory_and_removed_on_failure(gateway: Gateway) -> None:
    told, _ = gateway.visit()
    home = Path(gateway.places.job(told["key"]))
    assert home.stat().st_mode & 0o777 == 0o700
    assert (home / "library").read_text() == f"oauth2\n{TOKEN}\n"
    assert (home / "library").stat().st_mode & 0o777 == 0o600
    everything = [path for path in gateway.folder.rglob("*") if path.is_file() and TOKEN in path.read_text("latin-1")]
    assert everything == [home / "library"]
    assert TOKEN not in str(gateway.commands)
    gateway.starts = False
    gateway.running.clear()
    with pytest.raises(ModuleError, match="systemd did not start the build"):
        gateway.visit()
    assert not home.exists()


def test_build_job_is_self_contained_and_sandboxed(gateway: Gateway) -> None:
    told, _ = gateway.visit()
    (command,) = (one for one in gateway.commands if one[0] == "systemd-run")
    assert {"--collect", f"--unit={told['unit']}", "--property=ProtectSystem=strict"} <= set(command)
    assert command[-4:-2] == ["/usr/bin/python3", "-I"]
    with zipfile.ZipFile(command[-2]) as program:
        names = {name.rpartition("/")[2] for name in program.namelist()}
    assert {"__main__.py", "build_git.py", "build_make.py", "errors.py", "filesystem.py"} <= names


def test_failure_is_reported_once_and_the_next_visit_restarts(gateway: Gateway) -> None:
    told, _ = gateway.visit()
    gateway.end(told, {"ok": False, "message": "no such header", "hint": "ask"})
    with pytest.raises(ModuleError, match="no such header") as caught:
        gateway.visit(started=told["run"])
    assert caught.value.hint == f"ask; complete output: {told['log']} on the gateway"
    again, build = gateway.visit()
    assert build.changes == ["build of library v1 started"]
    gateway.end(again, None)
    with pytest.raises(ModuleError, match="was interrupted"):
        gateway.visit(started=again["run"])


def test_changed_inventory_stops_the_previous_build(gateway: Gateway) -> None:
    told, _ = gateway.visit("v1")
    Path(gateway.shelf.at(told["key"])).mkdir(parents=True)
    other, build = gateway.visit("v2")
    assert gateway.running == {other["unit"]}
    assert build.notes == [f"build {told['key']}, which is no longer in the inventory, was stopped"]
    assert not Path(gateway.shelf.at(told["key"])).exists()


def test_missing_build_tools_are_named(gateway: Gateway, tmp_path: Path) -> None:
    (tmp_path / "bin/colcon").unlink()
    (tmp_path / "bin/cmake").unlink()
    with pytest.raises(ModuleError, match="the gateway lacks colcon, cmake, which the build needs"):
        gateway.visit(examples=True)
    gateway.compiler = False
    with pytest.raises(ModuleError, match=r"lacks colcon, c\+\+, which the build needs"):
        gateway.visit()
    assert gateway.visit(check=True)[1].changes == ["build of the library, after its packages are installed"]


def test_key_matches_the_plan(gateway: Gateway) -> None:
    told, _ = gateway.visit(check=True)
    plan = build_plan.BuildPlan(
        build_plan.Repository(URL, "v1"), None, str(gateway.folder / "setup.sh"), "12 x86_64-linux-gnu"
    )
    assert told["key"] == plan.key
