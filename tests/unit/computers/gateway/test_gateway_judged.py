"""Judgements of the gateway suite that no machine can bring about: a clock that is off, builds, versions."""

import json
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path
from typing import Any

import pytest

from atlantis_netcfg.inventory import load
from checks import test_gateways as suite
from checks.gateway_promises import BUILT, FileThere, Promises, UnitThere
from checks.gateway_reached import Answers, NotReached, ask

ROOT = Path(__file__).parents[4]


def promised(**promises: Any) -> Promises:  # noqa: ANN401 - fields of Promises
    return Promises(load(ROOT / "inventory").hosts["coastal-gateway"], **promises)


def told(**answers: Any) -> Answers:  # noqa: ANN401 - what the probe tells
    return Answers(answers, (1000.0, 1001.0))


def expected(words: str | None) -> AbstractContextManager[object]:
    return nullcontext() if words is None else pytest.raises(AssertionError, match=words)


@pytest.mark.parametrize(
    ("now", "words"),
    [(999.0, None), (1000.5, None), (1003.0, None), (1004.0, "are 3 s apart"), (-3e8, "are 300001000 s apart")],
)
def test_clock_tolerance_includes_the_request_time(now: float, words: str | None) -> None:
    with expected(words):
        suite.test_clock_is_right(promised(), told(now=now))


@pytest.mark.parametrize(
    ("tracking", "words"),
    [
        ("0A400101,10.64.1.1,3,1,0,Normal\n", None),
        ("00000000,,0,0,0,Not synchronised\n", "chrony says `Not synchronised`"),
        ("7F7F0101,,10,0,0,Normal\n", "the clock follows itself"),
        (None, "`tracking` cannot be asked"),
    ],
)
def test_clock_must_follow_a_source(tracking: str | None, words: str | None) -> None:
    with expected(words):
        suite.test_clock_follows_a_source(told(said={"tracking": tracking}))


@pytest.mark.parametrize(
    ("found", "wanted", "words"),
    [
        ({"x": "1.2-3"}, None, None),
        ({"x": "1.2-3"}, "1.2-3", None),
        ({"x": "1.2-3focal"}, "1.2-3*", None),
        ({"x": "1.2-4"}, "1.2-3*", "x 1.2-4 is installed, declared is 1.2-3"),
        ({}, None, "x is not installed, or only half"),
    ],
)
def test_package_versions_are_judged(found: dict[str, str], wanted: str | None, words: str | None) -> None:
    with expected(words):
        suite.test_package(promised(packages={"x": wanted}), "x", told(packages=found))


@pytest.mark.parametrize(
    ("built", "words"),
    [
        ({"library": {"revision": "v1"}, "examples": {"revision": "v2"}}, None),
        ({"library": {"revision": "v0"}, "examples": {"revision": "v2"}}, "the library in use is v0, declared is v1"),
        ({"library": {"revision": "v1"}, "examples": None}, "the examples in use is None, declared is v2"),
        (None, "the library in use is None, declared is v1"),
    ],
)
def test_build_in_use_is_judged(built: object, words: str | None) -> None:
    promises = promised(build={"library": {"revision": "v1"}, "examples": {"revision": "v2"}})
    with expected(words):
        suite.test_the_declared_library_is_in_use(promises, told(texts={BUILT: json.dumps(built) if built else None}))


@pytest.mark.parametrize(
    ("state", "by", "enabled", "active", "words"),
    [
        ("active", "enabled", True, True, None),
        ("active", "static", True, True, None),
        ("inactive", "", False, False, None),
        ("inactive", "enabled", True, None, None),
        ("failed", "enabled", True, None, "x has failed"),
        ("active", "disabled", True, True, "x is disabled, enabled is True"),
        ("inactive", "", True, True, "x is not there, enabled is True"),
        ("activating", "enabled", True, True, "x is activating, declared is active: True"),
        ("active", "disabled", False, False, "x is active, declared is active: False"),
    ],
)
def test_units_are_judged(state: str, by: str, enabled: bool | None, active: bool | None, words: str | None) -> None:  # noqa: FBT001
    promises = promised(units={"x": UnitThere("x", enabled, active)})
    with expected(words):
        suite.test_unit(promises, "x", told(units={"x": {"ActiveState": state, "UnitFileState": by}}))


@pytest.mark.parametrize(
    ("room", "words"),
    [
        ({"free_mb": 4000, "free": 0.2, "free_inodes": 0.5}, None),
        ({"free_mb": 3500, "free": 0.05, "free_inodes": 0.5}, None),
        ({"free_mb": 900, "free": 0.05, "free_inodes": 0.5}, "/: 900 MB free"),
        ({"free_mb": 200, "free": 0.9, "free_inodes": 0.5}, "/: 200 MB free"),
        ({"free_mb": 4000, "free": 0.2, "free_inodes": 0.01}, "1% of its inodes"),
    ],
)
def test_free_space_is_judged(room: dict[str, float], words: str | None) -> None:
    with expected(words):
        suite.test_card_has_room(told(room={"/": room}))


def test_open_firewall_is_detected() -> None:
    rules = "table inet atlantis {\n chain input {\n type filter hook input priority filter; policy accept;\n }\n}\n"
    with expected("what comes in is let in"):
        suite.test_firewall_is_the_declared_one(promised(), told(said={"firewall": rules, "firewall_meant": rules}))


@pytest.mark.parametrize(("used", "words"), [("16.0M", None), ("210.0M", None), ("1.2G", "the journal takes 1.2G")])
def test_journal_limit_is_judged(used: str, words: str | None) -> None:
    path = "/etc/systemd/journald.conf.d/atlantis.conf"
    promises = promised(files={path: FileThere(path, b"[Journal]\nSystemMaxUse=200M\n")})
    said = {
        "journal": "# /etc/systemd/journald.conf\n[Journal]\n#SystemMaxUse=\nSystemMaxUse=200M\n",
        "journal_usage": f"Archived and active journals take up {used} in the file system.\n",
    }
    with expected(words):
        suite.test_journal_is_bounded(promises, told(said=said))


def test_example_inventory_contacts_no_computer() -> None:
    declaration = load(ROOT / "inventory")
    with pytest.raises(NotReached, match="still contains example values"):
        ask(declaration, Promises(declaration.hosts["coastal-gateway"]), None)
