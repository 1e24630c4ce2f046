"""Which OpenVPN is let run: branches that are mended, and the packages of Debian that are."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from atlantis_netcfg.ansible_collections.atlantis.netcfg.plugins.module_utils.errors import ModuleError
from atlantis_netcfg.ansible_collections.atlantis.netcfg.plugins.module_utils.programs import ProgramResult
from atlantis_netcfg.ansible_collections.atlantis.netcfg.plugins.modules.minimum_version import (
    Branch,
    MinimumVersion,
    require_minimum_version,
)
from atlantis_netcfg.vpn.server import FLOOR, IS_CURRENT

DECLARED = MinimumVersion(
    FLOOR["program"],
    FLOOR["package"],
    tuple(Branch(one["branch"], one["upstream"], tuple(one["packages"])) for one in FLOOR["branches"]),
)


def held(upstream: str, package: str = "", **how: bool) -> str:
    """The program tells `upstream`, dpkg the package; versions are compared by the real dpkg."""

    def run(words: list[str]) -> ProgramResult:
        if words[0] == DECLARED.program:
            return (
                ProgramResult(0, f"OpenVPN {upstream} x86_64-pc-linux-gnu [SSL (OpenSSL)]\n")
                if upstream
                else ProgramResult(127, "")
            )
        if words[0] == "dpkg-query":
            return ProgramResult(0, package) if package else ProgramResult(1, "no packages found")
        return ProgramResult(subprocess.run(words, check=False).returncode, "")

    return require_minimum_version(DECLARED, run=run, **how)


@pytest.mark.parametrize(
    ("upstream", "package"),
    [
        ("2.6.14", "2.6.14-0+deb12u2"),
        ("2.6.14", "2.6.14-0+deb12u10"),
        ("2.6.21", ""),
        ("2.6.22", "2.6.22-1"),
        ("2.7.5", "2.7.5-2"),
        ("2.7.10", ""),
        ("2.8.0", ""),
        ("2.6.21", "2.6.14-0+deb12u1"),  # a newer one beside the package
    ],
)
def test_patched_version_passes(upstream: str, package: str) -> None:
    assert held(upstream, package).startswith(upstream)


@pytest.mark.parametrize(
    ("upstream", "package"),
    [
        ("2.6.14", "2.6.14-0+deb12u1"),
        ("2.6.14", "2.6.14-1"),  # of another release, which has a higher number and none of the patches
        ("2.6.14", "2.6.14-1+deb13u2"),
        ("2.6.3", "2.6.3-1+deb12u4"),
        ("2.6.12", "2.6.14-0+deb12u2"),  # an older one in the package's place
        ("2.6.20", ""),
        ("2.7.0", "2.7.0-1"),
        ("2.7.4", ""),
        ("2.5.11", ""),
        ("2.4.12", ""),
    ],
)
def test_vulnerable_version_is_refused_with_the_command(upstream: str, package: str) -> None:
    with pytest.raises(ModuleError, match="has known vulnerabilities:") as refused:
        held(upstream, package)
    assert "apt-get install openvpn" in refused.value.hint


def test_absent_package_passes_only_in_a_plan() -> None:
    assert held("", absent_passes=True) == ""
    with pytest.raises(ModuleError, match="does not report its version"):
        held("")


# The program on the server that notes when each member was last seen.


PROGRAM = Path(__file__).parents[4] / "templates" / "openvpn" / "vpn_seen.py"
NAMES = "Common Name\tReal Address\tVirtual Address\tVirtual IPv6 Address\tBytes Received"


def status(time: int, *names: str, end: str = "END\n") -> str:
    rows = "".join(
        f"CLIENT_LIST\t{name}\t192.0.2.7:5{number}\t10.80.16.{number}\t\t1\n" for number, name in enumerate(names)
    )
    return f"TITLE\tOpenVPN\nTIME\t2026-11-22 07:00:00\t{time}\nHEADER\tCLIENT_LIST\t{NAMES}\n{rows}{end}"


def noted(folder: Path, text: str | None) -> dict[str, dict[str, object]]:
    if text is not None:
        (folder / "status").write_text(text)
    place = folder / "seen.json"
    subprocess.run([sys.executable, "-I", str(PROGRAM), str(folder / "status"), str(place)], check=True)
    return json.loads(place.read_text())["seen"] if place.exists() else {}


def test_listed_clients_are_recorded_and_preserved(tmp_path: Path) -> None:
    first = noted(tmp_path, status(100, "inesc-a", "inesc-b", "UNDEF"))
    assert first.keys() == {"inesc-a", "inesc-b"}
    assert first["inesc-b"] == {"last": 100, "real": "192.0.2.7:51", "address": "10.80.16.1"}
    later = noted(tmp_path, status(200, "inesc-b"))
    assert (later["inesc-a"]["last"], later["inesc-b"]["last"]) == (100, 200)


@pytest.mark.parametrize("text", [None, "", "TITLE\tOpenVPN\n", status(100, "inesc-a", end="")])
def test_incomplete_status_is_ignored(tmp_path: Path, text: str | None) -> None:
    assert noted(tmp_path, text) == {}


@pytest.mark.parametrize("text", ["", "{", "[]", '{"format": 2, "seen": {}}', '{"format": 1}'])
def test_unreadable_file_is_recreated(tmp_path: Path, text: str) -> None:
    (tmp_path / "seen.json").write_text(text)
    assert noted(tmp_path, status(100, "inesc-a")).keys() == {"inesc-a"}


@pytest.mark.parametrize(
    ("installed", "archived", "code"),
    [("2.6.14-0+deb12u2", "2.6.14-0+deb12u2", 0), ("2.6.14-0+deb12u1", "2.6.14-0+deb12u2", 1), ("2.7.5", "2.6.14", 0)],
)
def test_server_older_than_its_archive_is_detected(tmp_path: Path, installed: str, archived: str, code: int) -> None:
    policy = f"openvpn:\n  Installed: {installed}\n  Candidate: {archived}\n  Version table:\n"
    for name, text in (("dpkg-query", installed), ("apt-cache", policy)):
        (tmp_path / name).write_text(f"#!/bin/sh\ncat <<'END'\n{text}\nEND\n")
        (tmp_path / name).chmod(0o755)
    path = {"PATH": f"{tmp_path}:{os.environ['PATH']}"}
    assert subprocess.run(IS_CURRENT.run, env=path, check=False).returncode == code
