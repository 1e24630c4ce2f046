"""Start a build or find it running, activate a complete one, report a failed one: one short SSH session each.

A build takes several minutes, and the link may fail before it ends. So it runs as the transient unit
`atlantis-build-KEY`, whose files are in `/run/atlantis/build-KEY`, a runtime directory that systemd removes however the
unit ends.
"""

# ruff: noqa: PTH102, PTH103, PTH108, PTH110, PTH113, PTH118
# ruff: noqa: PTH123, PTH208 - paths are text on the gateways' side, where all modules share it

from __future__ import annotations

import inspect
import json
import os
import shutil
import time
import uuid
import zipfile
from dataclasses import dataclass, field
from typing import Any, Callable, Mapping

from atlantis_netcfg.core import messages, stored_messages
from atlantis_netcfg.core.messages import arg, msg
from atlantis_netcfg.core.stored_messages import unpack

from . import build_git, build_make, build_messages, build_plan, errors, filesystem
from .build_git import store_token
from .build_plan import BuildPlan, BuildStore, Repository
from .errors import ModuleError, as_module_error
from .programs import ProgramResult, is_there, require_success, run

_MODULES = (build_git, build_make, build_plan, build_messages, errors, filesystem)
"""Modules of the build program; importing them here is what ships them to the gateway."""
_RUNNING = ("active", "activating", "deactivating", "reloading")
_FENCE = (
    # What a partner's CMakeLists.txt does stays in the folders of the build, and leaves the running gateway its share.
    "ProtectSystem=strict",
    "ProtectHome=read-only",
    "NoNewPrivileges=yes",
    "Nice=10",
    "IOSchedulingClass=idle",
    "OOMScoreAdjust=500",
    # A compiler that is killed for want of memory is told by the build; it does not end it silently.
    "OOMPolicy=continue",
)


@dataclass(frozen=True)
class BuildFolders:
    """Paths of the builds, their state in memory and their logs on the gateway."""

    prefix: str = "/opt/atlantis/interop"
    memory: str = "/run/atlantis"
    """Lost at a power cut, together with the tokens and outcomes in it."""
    logs: str = "/var/log/atlantis"

    def job(self, key: str) -> str:
        """Return the folder of a running build."""
        return os.path.join(self.memory, f"build-{key}")

    def outcome(self, key: str) -> str:
        """Return the path of the outcome file of the last build of a key."""
        return os.path.join(self.memory, f"outcome-{key}.json")

    def log(self, key: str) -> str:
        """Return the path of the log of a build."""
        return os.path.join(self.logs, f"build-{key}.log")


def compiler(run: Callable[[list[str]], ProgramResult] = run) -> str | None:
    """Return the version and target of the C++ compiler; None if there is none."""
    version, target = run(["c++", "-dumpversion"]), run(["c++", "-dumpmachine"])
    return None if version.code != 0 else f"{version.output.strip()} {target.output.strip()}"


def pack(path: str) -> None:
    """Write the build program as a zip file, from the source of this package's modules."""
    with zipfile.ZipFile(path, "w") as archive:
        for package in ("build", "atlantis_netcfg", "atlantis_netcfg/core"):
            archive.writestr(f"{package}/__init__.py", "")
        archive.writestr("__main__.py", "import sys\nfrom build.build_make import main\nsys.exit(main(sys.argv[1]))\n")
        for module in _MODULES:
            archive.writestr(f"build/{module.__name__.rpartition('.')[2]}.py", inspect.getsource(module))
        for module in (messages, stored_messages):
            archive.writestr(f"{module.__name__.replace('.', '/')}.py", inspect.getsource(module))


@dataclass
class Build:
    """One visit to the gateway to build the desired revisions; `changes` and `notes` are its result."""

    library: Repository
    examples: Repository | None
    tokens: Mapping[str, str | None]
    """Repository name -> access token."""
    ros_setup: str
    jobs: int | None
    offline: str | None
    check: bool
    places: BuildFolders = field(default_factory=BuildFolders)
    run: Callable[[list[str]], ProgramResult] = run
    changes: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)

    def visit(self, run_id: str | None) -> dict[str, Any]:
        """Advance the build by one step; `run_id` is the run whose outcome is to be reported. Raises ModuleError."""
        try:
            return self._start_or_follow_build(run_id)
        except OSError as error:
            raise as_module_error(error, str(error.filename or self.places.prefix)) from error

    def _start_or_follow_build(self, run_id: str | None) -> dict[str, Any]:
        compiler_version = compiler(self.run)
        if compiler_version is None and self.check:
            self.changes.append("build of the library, after its packages are installed")
            return {"state": "wanted"}
        plan = BuildPlan(self.library, self.examples, self.ros_setup, compiler_version or "")
        shelf = BuildStore(self.places.prefix)
        values = {"key": plan.key, "unit": _unit(plan.key), "log": self.places.log(plan.key)}
        marker = shelf.marker(plan.key)
        if marker is not None:
            self._activate_build(plan, shelf, marker)
            return {**values, "state": "ready", "commits": marker["commits"]}
        if self._is_running(plan.key):
            if run_id is not None:
                raise ModuleError(
                    f"the build of {arg(plan.words)} is still running on the gateway",
                    f"run the same command again later: the build continues by itself; {arg(values['log'])} shows its "
                    "progress",
                )
            return {**values, "state": "running", "run": self._running_run_id(plan.key)}
        if run_id is not None:
            raise self._build_failure(plan, run_id)
        self.changes.append(msg(f"build of {arg(plan.words)} started"))
        if self.check:
            return {**values, "state": "wanted"}
        self._prerequisites(compiler_version)
        return {**values, "state": "running", "run": self._start(plan, shelf)}

    def _activate_build(self, plan: BuildPlan, shelf: BuildStore, marker: Mapping[str, Any]) -> None:
        if shelf.link_target("current") != plan.key:
            self.changes.append(msg(f"build {arg(plan.key)} of {arg(plan.words)} activated"))
            self.notes.extend(marker["notes"])
            if self.check:
                return
            shelf.note_tags(plan, marker["commits"])
            shelf.use(plan.key)
        if not self.check:
            for key in shelf.prune([key for key in self._list_unfinished(shelf) if self._is_running(key)]):
                self._remove_log(key)

    def _start(self, plan: BuildPlan, shelf: BuildStore) -> str:
        """Write the job and start it with systemd; stop a running build that is no longer desired."""
        for key in self._list_unfinished(shelf):
            if key != plan.key:
                if self._is_running(key):
                    self.run(["systemctl", "stop", _unit(key)])
                    self.notes.append(msg(f"build {arg(key)}, which is no longer in the inventory, was stopped"))
                shelf.discard(key)
                self._remove_log(key)
        home, name = self.places.job(plan.key), uuid.uuid4().hex
        shutil.rmtree(home, ignore_errors=True)
        os.makedirs(self.places.logs, exist_ok=True)
        os.makedirs(self.places.prefix, exist_ok=True)
        os.makedirs(self.places.memory, exist_ok=True)
        os.mkdir(home, 0o700)
        try:
            pack(os.path.join(home, "program.pyz"))
            job = {
                "run": name,
                "plan": plan.as_dict(),
                "prefix": self.places.prefix,
                "jobs": self.jobs,
                "offline": self.offline,
                "log": self.places.log(plan.key),
                "outcome": self.places.outcome(plan.key),
            }
            with open(os.path.join(home, "job.json"), "w", encoding="utf-8") as file:
                json.dump(job, file)
            with open(self.places.log(plan.key), "w", encoding="utf-8") as log:
                log.write(f"== {time.strftime('%Y-%m-%d %H:%M:%S')} by the gateway's clock: build of {plan.words}\n")
            for repository, token in self.tokens.items():
                if token and self.offline is None:
                    store_token(home, repository, plan.repositories[repository].url, token)
            require_success(self.run(self._command(plan.key)), "systemd did not start the build")
        except BaseException:
            shutil.rmtree(home, ignore_errors=True)
            raise
        return name

    def _command(self, key: str) -> list[str]:
        home, log = self.places.job(key), self.places.log(key)
        writable = f"ReadWritePaths={self.places.prefix} {self.places.logs} {self.places.memory}"
        properties = [
            *_FENCE,
            writable,
            f"RuntimeDirectory={os.path.relpath(home, '/run')}",
            "RuntimeDirectoryMode=0700",
            f"StandardOutput=append:{log}",
            f"StandardError=append:{log}",
        ]
        command = ["systemd-run", "--quiet", "--collect", f"--unit={_unit(key)}"]
        command += [f"--description=ATLANTIS builds the interoperability library ({key})"]
        command += [f"--property={item}" for item in properties]
        return [*command, "/usr/bin/python3", "-I", os.path.join(home, "program.pyz"), os.path.join(home, "job.json")]

    def _build_failure(self, plan: BuildPlan, run_id: str) -> ModuleError:
        """Return the error that explains why a started build has not produced a result."""
        try:
            with open(self.places.outcome(plan.key), encoding="utf-8") as file:
                outcome = unpack(json.load(file))
        except (OSError, ValueError):
            outcome = {}
        log = self.places.log(plan.key)
        if outcome.get("run") == run_id and not outcome.get("ok"):
            hint = outcome["hint"]
            return ModuleError(
                outcome["message"], f"{arg(hint)}{'; ' if hint else ''}complete output: {arg(log)} on the gateway"
            )
        return ModuleError(
            f"the build of {arg(plan.words)} was interrupted: the gateway lost power, or the build was ended there",
            f"run the same command again: it continues with what was downloaded; complete output: {arg(log)} on the "
            "gateway",
        )

    def _prerequisites(self, compiler_version: str | None) -> None:
        if not os.path.isfile(self.ros_setup):
            raise ModuleError(
                f"ROS 2 is not installed on the gateway: {arg(self.ros_setup)} does not exist",
                "set `ros2:` next to `interop:` in the inventory, with the release to use",
            )
        programs = ["git", "colcon", "make", *(["cmake"] if self.examples is not None else [])]
        missing = [name for name in programs if not is_there(name)] + ([] if compiler_version else ["c++"])
        if missing:
            raise ModuleError(
                f"the gateway lacks {arg(', '.join(missing))}, which the build needs",
                "the packages in `interop.packages` provide them: build-essential, cmake, git; colcon comes with ROS 2",
            )

    def _is_running(self, key: str) -> bool:
        result = self.run(["systemctl", "show", "--property", "ActiveState", "--value", _unit(key)])
        return result.output.strip() in _RUNNING

    def _running_run_id(self, key: str) -> str:
        try:
            with open(os.path.join(self.places.job(key), "job.json"), encoding="utf-8") as file:
                return str(json.load(file)["run"])
        except (OSError, ValueError, KeyError):
            return ""

    @staticmethod
    def _list_unfinished(shelf: BuildStore) -> list[str]:
        try:
            keys = sorted(os.listdir(os.path.join(shelf.prefix, "builds")))
        except FileNotFoundError:
            return []
        return [key for key in keys if shelf.marker(key) is None]

    def _remove_log(self, key: str) -> None:
        for path in (self.places.log(key), self.places.outcome(key)):
            if os.path.exists(path):
                os.unlink(path)


def _unit(key: str) -> str:
    return f"atlantis-build-{key}.service"
