"""What real devices said, as data: `tests/data/recorded/cases.jsonl`, a case a row."""

import json
import shlex
from collections.abc import Callable
from pathlib import Path
from typing import Any

from row_subtests import Test, for_each_row
from twin_bench import Bench, make, row

from atlantis_netcfg.emulator.routeros.spec import ManagementSpec, User
from atlantis_netcfg.emulator.routeros.values import Address, Time, interval, seconds
from atlantis_netcfg.routeros.menus._values import PropertyKind, canonical

FILE = Path(__file__).parents[3] / "data" / "recorded" / "cases.jsonl"
DOORS = frozenset({"address", "api", "execute", "fields", "inspect", "listen", "parse", "time"})
ALL = [json.loads(line) for line in FILE.read_text(encoding="utf-8").splitlines()]
CASES = [case for case in ALL if case["door"] in DOORS]


def through(*doors: str) -> Callable[[Test], Test]:
    chosen = [case for case in CASES if case["door"] in doors]
    return for_each_row("case", chosen, ids=lambda case: f"{case['door']} {case['version']} {case['input'][:60]}")


def chr_(version: str) -> Bench:
    port = {"ports": ("ether1",), "poe_ports": (), "management": ManagementSpec(port="ether1")}
    return make(version=version, board="CHR", architecture="x86_64", users=(User(name="provision"),), **port)


def printed(router: Bench, case: dict[str, Any]) -> str:
    text: str = case["input"]
    if case["door"] == "time":
        return interval(seconds(Time().normalise(text)) or 0.0)
    if case["door"] == "address":
        return Address().parse(Address().normalise(text), router.device.core.store)
    if case["door"] == "execute":
        return router.script(text)
    if ".id=*1" in text:
        router.say("/ip/address/set", "=.id=*1", "=comment=")
    return " ".join(router.say(*shlex.split(text)))


@through("address", "api", "execute", "time")
def test_recorded(case: dict[str, Any]) -> None:
    router = chr_(case["version"])
    said = printed(router, case)
    if case["door"] == "time":
        assert (
            canonical(PropertyKind.TIME, said)
            == canonical(PropertyKind.TIME, case["input"])
            == canonical(PropertyKind.TIME, case["says"])
        )
    elif "says" in case:
        assert said == case["says"]
    elif "begins" in case:
        assert said.startswith(case["begins"])
    else:
        first, star, _ = case["holds"].partition("*")
        assert first + star in said
    for name, value in case.get("reads", {}).items():
        if name not in ("menu", "where"):
            found = f"?{'dst-address' if case['reads']['menu'] == '/ip/route' else 'address'}={case['reads']['where']}"
            assert router.value(case["reads"]["menu"], name, found) == value


@through("fields")
def test_recorded_fields(case: dict[str, Any]) -> None:
    router = chr_(case["version"])
    words = shlex.split(case["input"])
    router.say(*words)
    (found,) = (
        row(answer)
        for answer in router.device.run(router.caller, [f"{words[0].rpartition('/')[0]}/print"])
        if answer.kind == "!re"
    )
    assert set(case["there"]) <= set(found)
    assert not set(case["absent"]) & set(found)
    assert {name: found[name] for name in case.get("values", {})} == case.get("values", {})


@through("parse")
def test_recorded_parsing(case: dict[str, Any]) -> None:
    router = chr_(case["version"])
    text = case["input"].translate({ord("\\"): "\\\\", ord('"'): '\\"', ord("$"): "\\$", ord("\n"): "\\n"})
    said = router.script(f':put [:parse "{text}"]')
    if "says" in case:
        assert said == case["says"]
    else:
        assert said.startswith(("syntax error", "expected")) is case["refused"]


@through("inspect")
def test_recorded_inspecting(case: dict[str, Any]) -> None:
    """Walk the words of a command as whoever recorded it did: menus and commands, then the names of arguments."""
    router = chr_(case["version"])
    path: list[str] = []
    known = True
    first, *others = case["input"].split()
    for word in [*first.strip("/").split("/"), *others]:
        name = word.partition("=")[0]
        found = router.say("/console/inspect", "=request=child", f"=path={','.join(path)}")
        kinds = {entry[len("!re =name=") :].split(" ")[0]: entry for entry in found if entry.startswith("!re")}
        known = known and name in kinds
        if known and "=node-type=arg" not in kinds[name]:
            path.append(name)
    assert known is case["known"]


def test_recorded_listening() -> None:
    """A row that goes, and an end that was asked for."""
    gone, ended = (case["says"] for case in ALL if case["door"] == "listen")
    router = chr_("7.23.1")
    router.say("/ip/address/add", "=address=198.51.100.1/32", "=interface=ether1")
    router.say("/ip/address/listen", ".tag=7")
    router.say("/ip/address/remove", "=.id=*2")
    assert [" ".join(answer.words) for _, answer in router.device.pending(router.caller)] == [gone]
    router.say("/cancel", "=tag=7")
    pending = router.device.pending(router.caller)
    assert " ".join(" ".join((answer.kind, *answer.words)) for _, answer in pending) == ended


def test_recordings_cover_every_access_method_and_name_their_source() -> None:
    assert {case["door"] for case in ALL} == DOORS | {"ssh"}
    assert all(case["source"] and case["version"] for case in ALL)
    assert len(ALL) >= 150
    assert len(CASES) >= 150
