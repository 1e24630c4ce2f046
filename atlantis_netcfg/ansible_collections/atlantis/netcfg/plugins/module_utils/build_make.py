"""The build: a separate program on the gateway, which does not depend on an SSH session.

`build_start` starts it as a transient systemd unit with the name of its job file. It leaves either a complete build or
nothing that could be mistaken for one, and writes its outcome to a file in memory.

colcon builds the library; cmake and make build the examples. The order is the report's (4.6.2). The library is sourced
before the examples are built, which the report leaves out.
"""

# ruff: noqa: PTH102, PTH103, PTH105, PTH108, PTH110, PTH112, PTH113, PTH114, PTH118, PTH120, PTH123
# ruff: noqa: PTH202, PTH208
# Paths are text on the gateways' side, where all modules share it.

from __future__ import annotations

import errno
import fcntl
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from dataclasses import dataclass
from typing import Any, Callable, Iterator

from atlantis_netcfg.core.messages import arg, msg
from atlantis_netcfg.core.stored_messages import pack

from .build_git import Git, configure
from .build_messages import CardFull, about_building
from .build_plan import BuildPlan, BuildStore, is_commit
from .errors import ModuleError, as_module_error

_MEMORY_OF_A_JOB_KIB = 1_200 * 1024
"""A compiler takes about a gigabyte for the message types of ROS 2."""
_TAIL = 200_000
_PATH = "/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin"


def jobs_within(meminfo: str, cores: int, max_jobs: int | None = None) -> int:
    """Return the number of parallel compilers: one per core, limited by the free memory (`/proc/meminfo`)."""
    free = next((int(line.split()[1]) for line in meminfo.splitlines() if line.startswith("MemAvailable:")), 0)
    return max(1, min(cores, max_jobs or cores, free // _MEMORY_OF_A_JOB_KIB))


@dataclass(frozen=True)
class BuildTools:
    """Runs the build tools in the folder of a build; their output goes to the file `log`."""

    folder: str
    ros_setup: str
    jobs: int
    log: str
    say: Callable[[str], None]

    def clean(self) -> None:
        """Remove the output of an interrupted attempt: after a power cut its files may be empty but look complete."""
        for name in ("library/build", "library/install", "library/log", "examples/build", "tmp"):
            shutil.rmtree(os.path.join(self.folder, name), ignore_errors=True)

    def library(self) -> None:
        """Run `colcon build`, one package at a time; within a package it compiles in parallel. Raises ModuleError."""
        self._run("the library", "library", "colcon build --executor sequential")
        install = os.path.join(self.folder, "library", "install")
        if not os.path.isfile(os.path.join(install, "setup.sh")) or not any(
            os.path.isdir(os.path.join(install, name)) for name in os.listdir(install)
        ):
            raise ModuleError(
                "colcon found no package in the library", "check its address and revision with the partner"
            )

    def examples(self) -> None:
        """Run `cmake ..` and `make`, with the library sourced. Raises ModuleError."""
        os.mkdir(os.path.join(self.folder, "examples", "build"))
        self._run("the examples", "examples/build", "cmake .. && make", with_library=True)

    def tidy(self) -> None:
        """Remove intermediate files: the SD card is small and has to hold two builds."""
        for name in ("library/build", "library/log", "tmp"):
            shutil.rmtree(os.path.join(self.folder, name), ignore_errors=True)

    def check(self) -> None:
        """Check that all built programs find their shared libraries. Raises ModuleError."""
        programs = sorted(self._binaries())
        # ldd ends with 1 for what is linked statically, which lacks nothing.
        text = self._shell('for one in "$@"; do echo "$one:"; ldd "$one"; done; true', ".", programs, with_library=True)
        program = ""
        for line in text.splitlines():
            if line.endswith(":") and not line.startswith("\t"):
                program = os.path.relpath(line[:-1], self.folder)
            elif "not found" in line:
                raise ModuleError(
                    f"the build does not run: {arg(program)} does not find {arg(line.split()[0].rstrip(':'))}",
                    "send this to the partner who made it; the build in use is unchanged",
                )
        shutil.rmtree(os.path.join(self.folder, "tmp"), ignore_errors=True)
        self.say(f"{len(programs)} programs and libraries find their dependencies")

    def _run(self, what: str, where: str, command: str, *, with_library: bool = False) -> None:
        """Run a command and append its output to the log. Raises ModuleError if it fails."""
        self.say(f"building {what} with {self.jobs} jobs: {command}")
        start_offset = os.path.getsize(self.log)
        with open(self.log, "ab") as log:
            process = subprocess.run(  # noqa: S603
                ["/bin/sh", "-c", f"{self._source_commands(with_library=with_library)}{command}"],
                cwd=os.path.join(self.folder, where),
                env=self._environment(),
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=subprocess.STDOUT,
                check=False,
            )
        if process.returncode != 0:
            with open(self.log, "rb") as log:
                log.seek(max(start_offset, os.path.getsize(self.log) - _TAIL))
                text = log.read().decode(errors="replace")
            raise about_building(what, text)

    def _shell(self, command: str, where: str, arguments: list[str], *, with_library: bool) -> str:
        process = subprocess.run(  # noqa: S603
            ["/bin/sh", "-c", f"{self._source_commands(with_library=with_library)}{command}", "sh", *arguments],
            cwd=os.path.join(self.folder, where),
            env=self._environment(),
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            check=False,
        )
        text = process.stdout.decode(errors="replace")
        if process.returncode != 0:
            raise about_building("the library", text)
        return text

    def _source_commands(self, *, with_library: bool) -> str:
        install = os.path.join(self.folder, "library", "install", "setup.sh")
        return "".join(f". '{path}' && " for path in (self.ros_setup, *([install] if with_library else [])))

    def _environment(self) -> dict[str, str]:
        scratch = os.path.join(self.folder, "tmp")
        os.makedirs(scratch, exist_ok=True)
        return {
            "PATH": _PATH,
            "HOME": scratch,
            "TMPDIR": scratch,
            "COLCON_HOME": scratch,
            "LC_ALL": "C.UTF-8",
            "MAKEFLAGS": f"-j{self.jobs}",
            "CMAKE_BUILD_PARALLEL_LEVEL": str(self.jobs),
        }

    def _binaries(self) -> Iterator[str]:
        for base in ("library/install", "examples/build"):
            for folder, below, files in os.walk(os.path.join(self.folder, base)):
                below[:] = [name for name in below if name != "CMakeFiles"]
                for file in files:
                    path = os.path.join(folder, file)
                    if os.path.isfile(path) and not os.path.islink(path) and not file.endswith(".o") and _is_elf(path):
                        yield path


def _is_elf(path: str) -> bool:
    with open(path, "rb") as file:
        return file.read(4) == b"\x7fELF"


def main(job_file: str) -> int:
    """Run the build job; return 1 if it failed, with the reason in its outcome file."""
    signal.signal(signal.SIGTERM, _handle_stop_signal)
    with open(job_file, encoding="utf-8") as file:
        job = json.load(file)
    began = time.monotonic()
    try:
        notes = work(job, os.path.dirname(job_file))
        outcome = {"run": job["run"], "ok": True, "notes": notes}
        _print_step(f"complete after {time.monotonic() - began:.0f} s")
    except ModuleError as refused:
        outcome = {"run": job["run"], "ok": False, "message": refused.message, "hint": refused.hint}
        _print_step(f"failed after {time.monotonic() - began:.0f} s: {refused.message}")
    with open(f"{job['outcome']}.new", "w", encoding="utf-8") as file:
        json.dump(pack(outcome), file)
    os.replace(f"{job['outcome']}.new", job["outcome"])
    return 0 if outcome["ok"] else 1


def work(job: dict[str, Any], home: str, sleep: Callable[[float], None] = time.sleep) -> list[str]:
    """Fetch, build, check, complete; gives notes for a person, and removes the tokens in `home`. Raises ModuleError."""
    plan = BuildPlan.of(job["plan"])
    shelf = BuildStore(job["prefix"])
    folder = shelf.at(plan.key)
    try:
        os.makedirs(folder, exist_ok=True)
        with open(os.path.join(job["prefix"], ".lock"), "w", encoding="utf-8") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            return _build(job, plan, shelf, home, sleep)
    except CardFull:
        shelf.discard(plan.key)
        raise
    except OSError as error:
        if error.errno in (errno.ENOSPC, errno.EDQUOT):
            shelf.discard(plan.key)
        raise as_module_error(error, folder) from error
    finally:
        _forget(home, plan)


def _build(
    job: dict[str, Any], plan: BuildPlan, shelf: BuildStore, home: str, sleep: Callable[[float], None]
) -> list[str]:
    if shelf.marker(plan.key) is not None:
        return []
    folder = shelf.at(plan.key)
    with open("/proc/meminfo", encoding="ascii") as meminfo:
        jobs = jobs_within(meminfo.read(), os.cpu_count() or 1, job["jobs"])
    make = BuildTools(folder, plan.ros_setup, jobs, job["log"], _print_step)
    make.clean()
    configure(home, job["offline"], [repository.url for repository in plan.repositories.values()])
    commits, current = {}, shelf.link_target("current")
    for name, item in plan.repositories.items():
        _print_step(
            f"downloading the {name}, revision {item.revision}, from {item.url}" + _offline_note(job["offline"])
        )
        seed = os.path.join(shelf.at(current), name) if current is not None else None
        commits[name] = Git(item, name, os.path.join(folder, name), home, job["offline"], _print_step, sleep).fetch(
            seed
        )
        _print_step(f"the {name} is at commit {commits[name]}")
    _forget(home, plan)
    notes = _find_moved_tags(plan, shelf, commits)
    make.library()
    if plan.examples is not None:
        make.examples()
    make.tidy()  # what leans on something that goes with it does not pass the check
    make.check()
    shelf.complete(plan.key, {**plan.as_dict(), "commits": commits, "notes": notes})
    return notes


def _find_moved_tags(plan: BuildPlan, shelf: BuildStore, commits: dict[str, str]) -> list[str]:
    """Return notes about tags that point to another commit than when they were last built."""
    tags = shelf.tags()
    notes = []
    for name, repository in plan.repositories.items():
        before = tags.get(repository.url, {}).get(repository.revision, commits[name])
        if not is_commit(repository.revision) and before != commits[name]:
            notes.append(
                msg(
                    f"the tag {arg(repository.revision)} of the {arg(name)} has moved: it pointed to commit "
                    f"{arg(before)} at the last build, and now points to {arg(commits[name])}; ask the partner "
                    "whether that is intended"
                )
            )
    for note in notes:
        _print_step(note)
    return notes


def _forget(home: str, plan: BuildPlan) -> None:
    for name in plan.repositories:
        for path in (os.path.join(home, name), os.path.join(home, f"{name}.askpass")):
            if os.path.exists(path):
                os.unlink(path)


def _offline_note(offline: str | None) -> str:
    return f", from {offline}" if offline is not None else ""


def _print_step(line: str) -> None:
    print(f"== {line}", flush=True)  # noqa: T201 - the log of the build


def _handle_stop_signal(*_: object) -> None:
    raise ModuleError(
        "the build was stopped before it was complete", "run the same command again: what was downloaded is kept"
    )


if __name__ == "__main__":
    sys.exit(main(sys.argv[1]))
