"""Every dependency is pinned, is used, and has its row in docs/engineers/dependencies.md."""

import ast
import json
import re
import tomllib
from importlib import metadata
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).parents[3]
PROJECT: dict[str, Any] = tomllib.loads((ROOT / "pyproject.toml").read_text())
PAGE = (ROOT / "docs" / "engineers" / "dependencies.md").read_text(encoding="utf-8")
TABLE = re.findall(r"^\| ([^|]+) \| (run|build|dev|refused) \| ([^|]+) \| ([^|]+) \|$", PAGE, re.MULTILINE)
WITNESSES = ROOT / "tests" / "conformance"
LOCKS = {name: (ROOT / "requirements" / f"{name}.txt").read_text() for name in ("run", "dev", "awx")}
LOCKS["witnesses"] = (WITNESSES / "requirements.txt").read_text()


def locked(name: str) -> dict[str, tuple[str, list[str]]]:
    """Of a list: package -> version and hashes."""
    hashes = r"((?:\\\n +--hash=sha256:[0-9a-f]{64} ?)*)"
    entries = re.findall(rf"^([\w.-]+)==([^\s\\]+)[^\n\\]*{hashes}$", LOCKS[name], re.MULTILINE)
    return {normal(package): (version, re.findall(r"[0-9a-f]{64}", listed)) for package, version, listed in entries}


def normal(name: str) -> str:
    return re.sub(r"[-_.]+", "-", name).lower()


def names(requirements: list[str]) -> set[str]:
    return {normal(re.split(r"[^\w.-]", requirement)[0]) for requirement in requirements}


DECLARED = {
    "run": names(PROJECT["project"]["dependencies"]),
    "dev": names(PROJECT["project"]["optional-dependencies"]["dev"]),
    "build": names(PROJECT["build-system"]["requires"]),
}


@pytest.mark.parametrize("kind", DECLARED)
def test_each_dependency_is_pinned(kind: str) -> None:
    assert DECLARED[kind] <= locked("dev").keys()


@pytest.mark.parametrize("name", LOCKS)
def test_locks_have_hashes_and_name_no_registry(name: str) -> None:
    lines = [line for line in LOCKS[name].splitlines() if not line.startswith(("#", "    --hash=sha256:"))]
    assert len(lines) == len(locked(name)) > 30
    assert [package for package, (_, hashes) in locked(name).items() if not hashes] == []
    assert re.search(r"://|--index|--extra-index|--find-links", LOCKS[name]) is None


@pytest.mark.parametrize("name", ["dev", "awx"])
def test_runtime_versions_equal_the_tested_ones(name: str) -> None:
    run, other = locked("run"), locked(name)
    assert {package: other.get(package) for package in run} == run


def test_packages_fetched_by_ansible_builder_are_locked() -> None:
    """Its own pip commands, of version 3.2, find these installed."""
    fetched = {"ansible-core", "ansible-runner", "bindep", "dumb-init", "packaging", "pyyaml"}
    assert fetched <= locked("awx").keys()
    assert locked("awx")["dumb-init"][0] == "1.2.5"


@pytest.mark.parametrize("kind", DECLARED)
def test_table_lists_exactly_the_declared_packages(kind: str) -> None:
    assert {normal(name) for name, decision, _, _ in TABLE if decision == kind} == DECLARED[kind]


def test_nothing_refused_is_declared() -> None:
    refused = {normal(name) for row in TABLE if row[1] == "refused" for name in row[0].split(", ")}
    assert refused.isdisjoint(set().union(*DECLARED.values()))


def test_every_row_gives_licence_and_reason() -> None:
    rows = [line for line in PAGE.splitlines() if line.startswith("| ")]
    assert len(TABLE) == len(rows) - 1
    assert all(licence.strip() and why.strip() for _, _, licence, why in TABLE)


def test_each_runtime_dependency_is_imported() -> None:
    """Only what is used now: a dependency that nothing imports is a cost without a use."""
    imported = {
        name.partition(".")[0]
        for path in (ROOT / "atlantis_netcfg").rglob("*.py")
        for node in ast.walk(ast.parse(path.read_text()))
        for name in (
            [node.module or ""]
            if isinstance(node, ast.ImportFrom)
            else [a.name for a in getattr(node, "names", [])]
            if isinstance(node, ast.Import)
            else []
        )
    }
    provided: dict[str, set[str]] = {}
    for module, distributions in metadata.packages_distributions().items():
        for distribution in distributions:
            provided.setdefault(normal(distribution), set()).add(module)
    assert [name for name in sorted(DECLARED["run"]) if not provided[name] & imported] == []


def test_third_party_clients_are_pinned_and_separate_from_the_product() -> None:
    """Clients of others live in an environment of their own; docs/engineers/dependencies.md names them."""
    told = PAGE.partition("## Clients of others")[2].partition("\n## ")[0]
    pinned = locked("witnesses")
    node = json.loads((WITNESSES / "package.json").read_text())["dependencies"]
    for name in ("ansible", "librouteros", "RouterOS-api", "napalm-ros", "netmiko", "scapy"):
        assert name in told
        assert normal(name) in pinned
    assert "--require-hashes" in (ROOT / "tools" / "strangers").read_text()
    assert all(name in told and re.fullmatch(r"[\d.]+", version) for name, version in node.items())
    assert {"ansible", "napalm", "napalm-ros", "routeros-api", "scapy"}.isdisjoint(locked("dev"))


def test_the_lock_of_node_names_no_registry() -> None:
    lock = json.loads((WITNESSES / "package-lock.json").read_text())
    assert all("resolved" not in package for package in lock["packages"].values())
    assert all("integrity" in package for path, package in lock["packages"].items() if path)
