"""Build the fetched sources: colcon for the library, cmake and make for the examples, and a look at what came of it.

As the report has it (4.6.2), and in its order; the library is sourced before the examples are built, which the report
leaves out.
"""

# ruff: noqa: PTH102, PTH103, PTH112, PTH113, PTH114, PTH118
# ruff: noqa: PTH123, PTH202, PTH208 - paths are text on the gateways' side, where all modules share it

from __future__ import annotations

import os
import shutil
import subprocess
from dataclasses import dataclass
from typing import TYPE_CHECKING

from .build_words import about_building
from .refused import Refused

if TYPE_CHECKING:
    from typing import Callable, Iterator

__all__ = ["Make", "jobs_within"]

_MEMORY_OF_A_JOB_KIB = 1_200 * 1024
"""A compiler at work on the message types of ROS 2 takes about a gigabyte."""
_TAIL = 200_000
_PATH = "/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin"


def jobs_within(meminfo: str, cores: int, desired: int | None = None) -> int:
    """How many compilers run at once: one a core, and no more than fit into the free memory (`/proc/meminfo`)."""
    free = next((int(line.split()[1]) for line in meminfo.splitlines() if line.startswith("MemAvailable:")), 0)
    return max(1, min(cores, desired or cores, free // _MEMORY_OF_A_JOB_KIB))


@dataclass(frozen=True)
class Make:
    """The tools at work in the folder of a build; what they say goes to the file `log`."""

    folder: str
    ros_setup: str
    jobs: int
    log: str
    say: Callable[[str], None]

    def clean(self) -> None:
        """Remove what an attempt that was cut off has built: files of a power cut may be empty, and look done."""
        for name in ("library/build", "library/install", "library/log", "examples/build", "tmp"):
            shutil.rmtree(os.path.join(self.folder, name), ignore_errors=True)

    def library(self) -> None:
        """`colcon build`, one package after the other; compilers of one package run side by side. Raises Refused."""
        self._run("the library", "library", "colcon build --executor sequential")
        install = os.path.join(self.folder, "library", "install")
        if not os.path.isfile(os.path.join(install, "setup.sh")) or not any(
            os.path.isdir(os.path.join(install, name)) for name in os.listdir(install)
        ):
            raise Refused("colcon found no package in the library", "compare its address and revision with the partner")

    def examples(self) -> None:
        """`cmake ..` and `make`, with the library sourced. Raises Refused."""
        os.mkdir(os.path.join(self.folder, "examples", "build"))
        self._run("the examples", "examples/build", "cmake .. && make", sourced=True)

    def tidy(self) -> None:
        """Remove what is needed no longer: a card is small, and two builds stand on it."""
        for name in ("library/build", "library/log", "tmp"):
            shutil.rmtree(os.path.join(self.folder, name), ignore_errors=True)

    def check(self) -> None:
        """See that everything that was built finds its libraries. Raises Refused."""
        programs = sorted(self._binaries())
        # ldd ends with 1 for what is linked statically, which lacks nothing.
        text = self._shell('for one in "$@"; do echo "$one:"; ldd "$one"; done; true', ".", programs, sourced=True)
        program = ""
        for line in text.splitlines():
            if line.endswith(":") and not line.startswith("\t"):
                program = os.path.relpath(line[:-1], self.folder)
            elif "not found" in line:
                raise Refused(
                    f"what was built does not run: {program} does not find {line.split()[0].rstrip(':')}",
                    "the partner who made it can read this; the build in use stays as it was",
                )
        shutil.rmtree(os.path.join(self.folder, "tmp"), ignore_errors=True)
        self.say(f"{len(programs)} programs and libraries find what they need")

    def _run(self, what: str, where: str, command: str, *, sourced: bool = False) -> None:
        """Run a command, its words straight into the log."""
        self.say(f"building {what} with {self.jobs} jobs: {command}")
        started = os.path.getsize(self.log)
        with open(self.log, "ab") as log:
            done = subprocess.run(  # noqa: S603
                ["/bin/sh", "-c", f"{self._sources(sourced=sourced)}{command}"],
                cwd=os.path.join(self.folder, where),
                env=self._environment(),
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=subprocess.STDOUT,
                check=False,
            )
        if done.returncode != 0:
            with open(self.log, "rb") as log:
                log.seek(max(started, os.path.getsize(self.log) - _TAIL))
                text = log.read().decode(errors="replace")
            raise about_building(what, text)

    def _shell(self, command: str, where: str, arguments: list[str], *, sourced: bool) -> str:
        done = subprocess.run(  # noqa: S603
            ["/bin/sh", "-c", f"{self._sources(sourced=sourced)}{command}", "sh", *arguments],
            cwd=os.path.join(self.folder, where),
            env=self._environment(),
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            check=False,
        )
        text = done.stdout.decode(errors="replace")
        if done.returncode != 0:
            raise about_building("the library", text)
        return text

    def _sources(self, *, sourced: bool) -> str:
        install = os.path.join(self.folder, "library", "install", "setup.sh")
        return "".join(f". '{path}' && " for path in (self.ros_setup, *([install] if sourced else [])))

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
