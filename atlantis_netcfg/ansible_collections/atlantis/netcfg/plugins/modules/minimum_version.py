"""Module `atlantis.netcfg.minimum_version`: reject a program that is too old to be secure before it is started."""

# ruff: noqa: E402, TID252 - a module begins with its documentation, and Ansible ships what is imported relatively

from __future__ import annotations

DOCUMENTATION = r"""
module: minimum_version
short_description: Refuse a program whose version is known to be unsafe
description:
  - Reads the version of the program that is installed, and that of its Debian package, and changes nothing.
  - A distribution mends an old version without giving it a new number; such packages are named one by one.
  - In check mode a program that is not installed yet passes.
options:
  program: {description: Path of the program; it is asked with C(--version)., type: str, required: true}
  package: {description: Its Debian package., type: str, required: true}
  branches:
    description: The branches that are still mended; a later branch than all of them passes.
    type: list
    elements: dict
    required: true
    suboptions:
      branch: {description: Its first two numbers., type: str, required: true}
      upstream: {description: The first version of it that passes., type: str, required: true}
      packages:
        description: Debian packages of older versions that pass, with what comes after them for the same release.
        type: list
        elements: str
        default: []
author: ATLANTIS pilot team
"""

EXAMPLES = r"""
- name: Refuse an OpenVPN with known holes
  atlantis.netcfg.minimum_version:
    program: /usr/sbin/openvpn
    package: openvpn
    branches: [{branch: "2.6", upstream: "2.6.21", packages: ["2.6.14-0+deb12u2"]}]
"""

RETURN = r"""
version:
  description: What is installed; empty where nothing is, in check mode.
  type: str
  returned: success
hint:
  description: What to do about a failure.
  type: str
  returned: on failure
"""


import re
from dataclasses import dataclass
from functools import reduce
from typing import Any, Callable

from ansible.module_utils.basic import AnsibleModule

from atlantis_netcfg.core.messages import arg, msg

from ..module_utils.errors import ModuleError
from ..module_utils.programs import ProgramResult, run

_NOT_THERE = 127


@dataclass(frozen=True)
class Branch:
    """A maintained branch: its first fixed upstream version, and the fixed distribution packages of older versions."""

    branch: str
    upstream: str
    packages: tuple[str, ...] = ()


@dataclass(frozen=True)
class MinimumVersion:
    """Minimum version of a program: its package and the accepted branches."""

    program: str
    package: str
    branches: tuple[Branch, ...]


def require_minimum_version(
    floor: MinimumVersion, *, absent_passes: bool = False, run: Callable[[list[str]], ProgramResult] = run
) -> str:
    """Return the installed version. Raises ModuleError if it is too old or unknown."""
    result = run([floor.program, "--version"])
    if result.code == _NOT_THERE and absent_passes:
        return ""
    match = re.match(r"\S+ (\d+(?:\.\d+)+)", result.output)
    if match is None:
        raise ModuleError(
            f"{arg(floor.program)} does not report its version, so it is not started",
            f"check `{arg(floor.program)} --version` on that computer; its package is {arg(floor.package)}",
        )
    upstream = match[1]
    package = run(["dpkg-query", "--show", "--showformat=${Version}", floor.package])
    version = package.output.strip() if package.code == 0 and _upstream(package.output) == upstream else ""
    if _passes(floor, upstream, version, run):
        return version or upstream
    versions = [text for branch in floor.branches for text in (branch.upstream, *branch.packages)]
    fixed_versions = reduce(lambda first, other: msg(f"{arg(first)} or {arg(other)}"), versions)
    raise ModuleError(
        f"{arg(floor.package)} {arg(version or upstream)} has known vulnerabilities: {arg(fixed_versions)} or later "
        "is needed. It was not started",
        f"on that computer: `apt-get update && apt-get install {arg(floor.package)}`; if its distribution has nothing "
        "newer, upgrade to a newer release",
    )


def _passes(floor: MinimumVersion, upstream: str, package: str, run: Callable[[list[str]], ProgramResult]) -> bool:
    """Return whether the version is recent enough in a maintained branch; newer branches than listed pass."""
    number = _numbers(upstream)
    if number[:2] > max(_numbers(branch.branch) for branch in floor.branches):
        return True
    local = next((item for item in floor.branches if _numbers(item.branch) == number[:2]), None)
    if local is None:
        return False
    return number >= _numbers(local.upstream) or any(
        _follows(package, fixed_version, run) for fixed_version in local.packages
    )


def _follows(package: str, fixed_version: str, run: Callable[[list[str]], ProgramResult]) -> bool:
    """Return whether a package is the fixed one or later in the same release; `2.6.14-1` of another release is not."""
    line = fixed_version.rstrip("0123456789")
    if not package.startswith(line):
        return False
    return run(["dpkg", "--compare-versions", package, "ge", fixed_version]).code == 0


def _upstream(version: str) -> str:
    return re.sub(r"^\d+:", "", version.strip()).rpartition("-")[0]


def _numbers(version: str) -> tuple[int, ...]:
    return tuple(int(number) for number in version.split("."))


_TEXT = {"type": "str", "required": True}
ARGUMENTS: dict[str, Any] = {
    "program": _TEXT,
    "package": _TEXT,
    "branches": {
        "type": "list",
        "elements": "dict",
        "required": True,
        "options": {
            "branch": _TEXT,
            "upstream": _TEXT,
            "packages": {"type": "list", "elements": "str", "default": []},
        },
    },
}


def main() -> None:
    """Run the module."""
    module = AnsibleModule(ARGUMENTS, supports_check_mode=True)
    result = module.params
    branches = tuple(Branch(item["branch"], item["upstream"], tuple(item["packages"])) for item in result["branches"])
    try:
        version = require_minimum_version(
            MinimumVersion(result["program"], result["package"], branches), absent_passes=module.check_mode
        )
    except ModuleError as refused:
        module.fail_json(msg=refused.message, hint=refused.hint)
    module.exit_json(changed=False, version=version)


if __name__ == "__main__":
    main()
