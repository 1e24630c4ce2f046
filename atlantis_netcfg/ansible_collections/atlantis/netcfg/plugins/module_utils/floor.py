"""The version of a program, held against the versions that are known to be mended."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING

from .programs import run
from .refused import Refused

if TYPE_CHECKING:
    from typing import Callable

    from .programs import Done

__all__ = ["Branch", "Floor", "hold"]

_NOT_THERE = 127


@dataclass(frozen=True)
class Branch:
    """A branch that is still mended: from which version of its own, and in which packages of older ones."""

    branch: str
    upstream: str
    packages: tuple[str, ...] = ()


@dataclass(frozen=True)
class Floor:
    """A program, its package, and what passes."""

    program: str
    package: str
    branches: tuple[Branch, ...]


def hold(floor: Floor, *, absent_passes: bool = False, run: Callable[[list[str]], Done] = run) -> str:
    """Give the version that is installed. Raises Refused where it is too old, or where it cannot be told."""
    result = run([floor.program, "--version"])
    if result.code == _NOT_THERE and absent_passes:
        return ""
    found = re.match(r"\S+ (\d+(?:\.\d+)+)", result.output)
    if found is None:
        raise Refused(
            f"{floor.program} does not tell its version, so that it is not started",
            f"`{floor.program} --version` on that computer; its package is {floor.package}",
        )
    upstream = found[1]
    package = run(["dpkg-query", "--show", "--showformat=${Version}", floor.package])
    version = package.output.strip() if package.code == 0 and _upstream(package.output) == upstream else ""
    if _passes(floor, upstream, version, run):
        return version or upstream
    desired = " or ".join(text for branch in floor.branches for text in (branch.upstream, *branch.packages))
    raise Refused(
        f"{floor.package} {version or upstream} has holes that are known and mended: {desired}, or later, is needed."
        " It was not started",
        f"on that computer: `apt-get update && apt-get install {floor.package}`; "
        "where its distribution has nothing newer, it needs a newer release",
    )


def _passes(floor: Floor, upstream: str, package: str, run: Callable[[list[str]], Done]) -> bool:
    """Whether it is of a mended branch and late enough there; a later branch than all of them is."""
    number = _numbers(upstream)
    if number[:2] > max(_numbers(branch.branch) for branch in floor.branches):
        return True
    local = next((item for item in floor.branches if _numbers(item.branch) == number[:2]), None)
    if local is None:
        return False
    return number >= _numbers(local.upstream) or any(_follows(package, mended, run) for mended in local.packages)


def _follows(package: str, mended: str, run: Callable[[list[str]], Done]) -> bool:
    """Whether a package is that one or a later one of the same release: `2.6.14-1` of another one is not mended."""
    line = mended.rstrip("0123456789")
    if not package.startswith(line):
        return False
    return run(["dpkg", "--compare-versions", package, "ge", mended]).code == 0


def _upstream(version: str) -> str:
    return re.sub(r"^\d+:", "", version.strip()).rpartition("-")[0]


def _numbers(version: str) -> tuple[int, ...]:
    return tuple(int(number) for number in version.split("."))
