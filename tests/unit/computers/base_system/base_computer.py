"""A computer in a folder, with a systemd that remembers what it loaded."""

import os
import stat
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from atlantis_netcfg.ansible_collections.atlantis.netcfg.plugins.module_utils.configure import Configure
from atlantis_netcfg.ansible_collections.atlantis.netcfg.plugins.module_utils.desired_state import DesiredState
from atlantis_netcfg.ansible_collections.atlantis.netcfg.plugins.module_utils.filesystem import FileSystem
from atlantis_netcfg.ansible_collections.atlantis.netcfg.plugins.module_utils.programs import ProgramResult
from atlantis_netcfg.ansible_collections.atlantis.netcfg.plugins.module_utils.programs import run as really_run

ME = {"owner": str(os.geteuid()), "group": str(os.getegid())}


@dataclass
class FakeUnit:
    """A unit; `conf` is the file that its program reads when it starts."""

    conf: str = ""
    load: str = "loaded"
    active: str = "inactive"
    sub: str = "dead"
    file: str = "disabled"
    condition: bool = True
    dies: bool = False
    waits: bool = False
    stale: bool = False
    loaded: str | None = None


@dataclass
class Computer:
    root: Path
    units: dict[str, FakeUnit] = field(default_factory=dict)
    ran: list[list[str]] = field(default_factory=list)
    answers: dict[str, ProgramResult] = field(default_factory=dict)
    """Of steps, by the first word."""
    slept_s: float = 0

    def configure(self, *, check: bool = False, **told: Any) -> Configure:  # noqa: ANN401 - as the module has it
        told["files"] = [{**ME, **row} for row in told.get("files", [])]
        told["directories"] = [{**ME, **row} for row in told.get("directories", [])]
        return Configure(FileSystem(str(self.root)), DesiredState.of(told), check=check, run=self.run, sleep=self.sleep)

    def converge(
        self,
        *,
        check: bool = False,
        environment: Mapping[str, str] | None = None,
        **told: Any,  # noqa: ANN401 - as the module has it
    ) -> list[str]:
        configure = self.configure(check=check, **told)
        configure.converge(environment or {})
        return configure.changes

    def put(self, path: str, text: str, mode: int = 0o644) -> None:
        place = self.root / path[1:]
        place.parent.mkdir(parents=True, exist_ok=True)
        place.write_text(text)
        place.chmod(mode)

    def text(self, path: str) -> str:
        return (self.root / path[1:]).read_text()

    def snapshot(self) -> dict[str, tuple[int, str]]:
        """Everything below the root, without the lock's folder: path -> mode, and content or target."""
        found = {}
        for path in sorted(self.root.rglob("*")):
            name = str(path.relative_to(self.root))
            if name.startswith("run"):
                continue
            mode = path.lstat().st_mode
            inside = str(path.readlink()) if stat.S_ISLNK(mode) else path.read_text() if stat.S_ISREG(mode) else ""
            found[name] = (mode, inside)
        return found

    def sleep(self, seconds: float) -> None:
        self.slept_s += seconds

    def run(self, argv: list[str]) -> ProgramResult:
        if argv[0] == "systemctl":
            return self._systemctl(argv[1], argv[-1])
        if argv[0] == "journalctl":
            return ProgramResult(0, "it said why\n")
        if argv[0] == "sh":
            return really_run(argv)
        self.ran.append(argv)
        return self.answers.get(argv[0], ProgramResult(0, ""))

    def _systemctl(self, verb: str, name: str) -> ProgramResult:
        unit = self.units.get(name, FakeUnit(load="not-found", file=""))
        if verb == "show":
            return ProgramResult(
                0,
                f"LoadState={unit.load}\nActiveState={unit.active}\nSubState={unit.sub}\nUnitFileState={unit.file}\n"
                f"ConditionResult={'yes' if unit.condition else 'no'}\n"
                f"NeedDaemonReload={'yes' if unit.stale else 'no'}\n",
            )
        if verb == "reset-failed":
            return ProgramResult(0, "")
        self.ran.append(["systemctl", verb, *([name] if verb != "daemon-reload" else [])])
        if verb == "daemon-reload":
            for each in self.units.values():
                each.stale = False
        elif verb in ("enable", "disable"):
            unit.file = f"{verb}d"
        elif verb == "stop":
            unit.active, unit.sub = "inactive", "dead"
        elif unit.dies:
            unit.active, unit.sub = "failed", "failed"
        elif unit.waits:
            unit.active, unit.sub = "activating", "start-pre"
        elif unit.condition:
            unit.active, unit.sub = "active", "running"
            unit.loaded = self.text(unit.conf) if unit.conf else None
        return ProgramResult(0, "")
