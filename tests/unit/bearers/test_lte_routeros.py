from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import trees
import yaml

from atlantis_netcfg.bearers.lte.routeros import IDENTITIES, log_query, queries, queries_6, read, redacted

CASES: list[dict[str, Any]] = yaml.safe_load((Path(__file__).parent / "lte_routeros_cases.yml").read_text("utf-8"))
FIELDS = frozenset(trees.offered()["/interface/lte/monitor proplist"])


def ident(case: dict[str, Any]) -> str:
    return str(case["name"])


@pytest.mark.parametrize("case", CASES, ids=ident)
def test_read(case: dict[str, Any]) -> None:
    beside = (case.get(name) for name in ("interfaces", "profiles", "addresses", "log"))
    interfaces, profiles, addresses, log = beside
    found = read(case["monitor"], interfaces, profiles, addresses, log)
    assert {name: getattr(found, name) for name in case["reading"]} == case["reading"]


@pytest.mark.parametrize("case", CASES, ids=ident)
def test_identities_go_nowhere(case: dict[str, Any]) -> None:
    monitor = case["monitor"] or {}
    said = repr(read(monitor)) + repr(redacted(monitor))
    assert [name for name in IDENTITIES & monitor.keys() if monitor[name] in said] == []


def test_identities_are_fields_of_the_device() -> None:
    assert {"imei", "imsi", "iccid", "subscriber-number"} <= IDENTITIES & FIELDS


@pytest.mark.parametrize("version", trees.VERSIONS)
def test_the_device_has_the_words(version: str) -> None:
    tree = trees.Tree(version)
    for query in (*queries("lte1"), log_query()):
        assert tree.has_command(query.menu, query.command)
        assert {name.lstrip(".") for name, _ in query.words} <= tree.arguments(query.menu, query.command)


def test_no_secret_is_asked_for() -> None:
    asked = {name for query in queries("lte1") for name in query.proplist}
    assert not asked & {"pin", "password", "user", *IDENTITIES}


def test_version_6_has_words_of_its_own() -> None:
    first = queries_6("lte1")[0]
    assert (first.path, first.words) == ("/interface/lte/info", (("number", "lte1"), ("once", "")))
