from pathlib import Path
from typing import Any

import pytest
import trees
import yaml
from row_subtests import for_each_row

from atlantis_netcfg.links.lte import Registration
from atlantis_netcfg.links.lte.routeros import IDENTITIES, log_query, modem_name, queries, read, redact

CASES: list[dict[str, Any]] = yaml.safe_load((Path(__file__).parent / "lte_routeros_cases.yml").read_text("utf-8"))
FIELDS = frozenset(trees.offered()["/interface/lte/monitor proplist"])


def ident(case: dict[str, Any]) -> str:
    return str(case["name"])


@for_each_row("case", CASES, ids=ident)
def test_read(case: dict[str, Any]) -> None:
    beside = (case.get(name) for name in ("interfaces", "profiles", "addresses", "log"))
    interfaces, profiles, addresses, log = beside
    found = read(case["monitor"], interfaces, profiles, addresses, log)
    assert {name: getattr(found, name) for name in case["reading"]} == case["reading"]


@for_each_row("case", CASES, ids=ident)
def test_identities_are_redacted(case: dict[str, Any]) -> None:
    monitor = case["monitor"] or {}
    said = repr(read(monitor)) + repr(redact(monitor))
    assert [name for name in IDENTITIES & monitor.keys() if monitor[name] in said] == []


def test_identities_are_fields_of_the_device() -> None:
    assert {"imei", "imsi", "iccid", "subscriber-number"} <= IDENTITIES & FIELDS


@pytest.mark.parametrize("version", trees.VERSIONS)
def test_queries_exist_on_the_device(version: str) -> None:
    tree = trees.Tree(version)
    for query in (*queries("lte1"), log_query()):
        assert tree.has_command(query.menu, query.command)
        assert {name.lstrip(".") for name, _ in query.words} <= tree.arguments(query.menu, query.command)


def test_no_secret_is_queried() -> None:
    asked = {name for query in queries("lte1") for name in query.proplist}
    assert not asked & {"pin", "password", "user", *IDENTITIES}


RENAMED = [{"name": "lte1", "default-name": "lte2", "disabled": "true"}, {"name": "starlink", "default-name": "lte1"}]


def test_modem_is_identified_by_its_default_name() -> None:
    addresses = [
        {"address": "10.0.0.1/32", "interface": "lte1"},
        {"address": "100.72.9.14/32", "interface": "starlink"},
    ]
    log = [{"message": "lte1: rcvd +CPIN: SIM PUK"}, {"message": "starlink: rcvd +CPIN: SIM PIN"}]
    found = read(None, RENAMED, None, addresses, log)
    assert (found.address, found.state) == ("100.72.9.14", Registration.SIM_PIN_REQUIRED)


@pytest.mark.parametrize(
    ("interfaces", "name"),
    [(RENAMED, "starlink"), ([{"name": "lte1"}], "lte1"), ([], "lte1"), (None, "lte1")],
    ids=["renamed", "a RouterOS without default names", "no modem", "refused"],
)
def test_current_modem_name(interfaces: list[dict[str, str]] | None, name: str) -> None:
    assert modem_name(interfaces) == name
