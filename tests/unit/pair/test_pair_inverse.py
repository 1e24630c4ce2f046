"""The way back of a pair's end, run by a twin: it is as before, however far the change came."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "twin"))

from twin_bench import Bench, make

from atlantis_netcfg.routeros._types import Action, Layer, Verb
from atlantis_netcfg.routeros.apply._scripts import scripts
from atlantis_netcfg.routeros.pair._fuse import script
from atlantis_netcfg.routeros.pair._inverse import NotInvertible, inverse

if TYPE_CHECKING:
    from collections.abc import Mapping

SPEC: dict[str, Any] = {"packages": ("routeros", "wireless"), "radios": ({"name": "wlan1"},)}
RADIO, PROFILES, CONNECT = (
    "/interface/wireless",
    "/interface/wireless/security-profiles",
    "/interface/wireless/connect-list",
)
OLD = """\
/interface wireless security-profiles
add authentication-types=wpa2-psk comment="atlantis: x" mode=dynamic-keys name=old \\
    wpa2-pre-shared-key="the old \\"key\\" \\$"
/interface wireless
set wlan1 disabled=no security-profile=old ssid="old name"
/interface wireless connect-list
add interface=wlan1 ssid=x
"""


def action(number: int, menu: str, verb: Verb, **more: Any) -> Action:  # noqa: ANN401 - fields of Action
    return Action(number=number, layer=Layer.FOUNDATION, menu=menu, verb=verb, subject="row", **more)


def rows(bench: Bench, *menus: str) -> Mapping[str, tuple[dict[str, str], ...]]:
    return {
        menu: tuple(
            dict(word[1:].partition("=")[::2] for word in answer.words)
            for answer in bench.device.run(bench.caller, [f"{menu}/print"])
            if answer.kind == "!re"
        )
        for menu in menus
    }


def change(seen: Mapping[str, tuple[dict[str, str], ...]]) -> tuple[Action, ...]:
    old = next(row for row in seen[PROFILES] if row["name"] == "old")
    new = (("name", "new"), ("mode", "dynamic-keys"), ("wpa2-pre-shared-key", "a new key"))
    return (
        action(1, PROFILES, Verb.ADD, values=new),
        action(
            2,
            RADIO,
            Verb.SET,
            ids=(seen[RADIO][0][".id"],),
            values=(("ssid", "new name"), ("security-profile", "new"), ("tx-power", "5"), ("hide-ssid", "yes")),
        ),
        action(3, PROFILES, Verb.REMOVE, ids=(old[".id"],)),
    )


@pytest.mark.parametrize("done", range(4))
def test_takes_back_however_far_it_came(done: int) -> None:
    bench = make(**SPEC)
    assert bench.script(OLD) == ""
    seen = rows(bench, RADIO, PROFILES, CONNECT)
    before = bench.text()
    actions = change(seen)
    for text, _ in scripts(actions[:done]):
        assert bench.script(text).startswith("ok")
    assert (bench.text() != before) == (done > 0)
    assert bench.script(inverse(actions, seen)) == ""
    assert bench.text() == before


PORT, MEMBER = "/interface/ethernet", "/interface/bridge/port"
SWAPPED = """\
/interface ethernet
set ether1 name=cable
/interface wireless
set wlan1 name=ether1
/interface ethernet
set cable name=wlan1
/interface bridge
add name=b
/interface bridge port
add bridge=b comment=hers interface=wlan1
"""
"""Cable and radio are called as the other one should be, and the bridge has the cable."""


def name(number: int, menu: str, row: str, new: str) -> Action:
    return replace(action(number, menu, Verb.SET, ids=(row,), values=(("name", new),)), layer=Layer.NAMES)


@pytest.mark.parametrize("done", range(6))
def test_takes_names_back_however_far_it_came(done: int) -> None:
    bench = make(**SPEC)
    assert bench.script(SWAPPED) == ""
    seen = rows(bench, RADIO, PORT, MEMBER)
    before = bench.text()
    cable = next(row[".id"] for row in seen[PORT] if row["name"] == "wlan1")
    radio, member = seen[RADIO][0][".id"], seen[MEMBER][0][".id"]
    actions = (
        name(1, PORT, cable, "ether1-atlantis"),
        name(2, RADIO, radio, "wlan1"),
        name(3, PORT, cable, "ether1"),
        action(4, MEMBER, Verb.ADD, values=(("bridge", "b"), ("interface", "wlan1"))),
        action(5, MEMBER, Verb.SET, ids=(member,), values=(("comment", "ours"), ("interface", "ether2"))),
    )
    for text, _ in scripts(actions[:done]):
        assert bench.script(text).startswith("ok")
    assert (bench.text() != before) == (done > 0)
    assert bench.script(inverse(actions, seen)) == ""
    assert bench.text() == before


def test_a_place_in_a_list_would_be_lost() -> None:
    bench = make(**SPEC)
    bench.script(OLD)
    seen = rows(bench, CONNECT)
    removal = action(1, CONNECT, Verb.REMOVE, ids=(seen[CONNECT][0][".id"],))
    with pytest.raises(NotInvertible, match="its place in the list would be lost"):
        inverse((removal,), seen)


def test_a_hidden_key_cannot_be_written_back() -> None:
    seen = {RADIO: ({".id": "*3", "default-name": "wlan1", "nv2-preshared-key": "*****"},)}
    change = action(1, RADIO, Verb.SET, ids=("*3",), values=(("nv2-preshared-key", "new"),))
    with pytest.raises(NotInvertible, match="cannot be read"):
        inverse((change,), seen)


def test_a_row_that_was_not_read_cannot_be_written_back() -> None:
    change = action(1, RADIO, Verb.SET, ids=("*3",), values=(("ssid", "new"),))
    with pytest.raises(NotInvertible, match="was not read"):
        inverse((change,), {RADIO: ()})


def test_the_job_writes_back_where_nobody_is_registered_and_goes() -> None:
    bench = make(**SPEC)
    bench.script("/interface wireless set wlan1 ssid=new")
    job = script(RADIO, "48:A9:8A:00:00:01", f":do {{\n{RADIO}/set wlan1 ssid=old\n}} on-error={{\n}}\n")
    words = ["/system/scheduler/add", "=name=atlantis-pair", "=interval=5m", f"=on-event={job}"]
    bench.say(*words, "=start-date=2026-01-01", "=start-time=08:01:00")
    bench.now += 59
    bench.device.tick()
    assert bench.value(RADIO, "ssid") == "new"
    bench.now += 2
    bench.device.tick()
    assert bench.value(RADIO, "ssid") == "old"
    assert bench.count("/system/scheduler") == 0
