"""The way back of a pair's end, run by a twin: it is as before, however far the change came."""

import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "emulator" / "routeros"))

from twin_bench import Bench, make

from atlantis_netcfg.core.versions import Version
from atlantis_netcfg.routeros import desired
from atlantis_netcfg.routeros._types import Action, Facts, Layer, Observation, Plan, Verb
from atlantis_netcfg.routeros.apply._inverse import CannotInvert, inverse
from atlantis_netcfg.routeros.apply._scripts import scripts
from atlantis_netcfg.routeros.planner import plan
from atlantis_netcfg.routeros.scheduler_jobs import pair_script

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


FACTS = Facts("far", Version(7, 18), "", "", {}, (), None, True, None, "", 0)


def rollback(actions: tuple[Action, ...], seen: Mapping[str, tuple[dict[str, str], ...]]) -> str:
    """The script of a bridge's far end: keys are put back, too."""
    return inverse(Observation(FACTS, seen), Plan("far", actions, ""), with_secrets=True)


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
def test_rollback_restores_from_any_step(done: int) -> None:
    bench = make(**SPEC)
    assert bench.script(OLD) == ""
    seen = rows(bench, RADIO, PROFILES, CONNECT)
    before = bench.text()
    actions = change(seen)
    for text, _ in scripts(actions[:done]):
        assert bench.script(text).startswith("ok")
    assert (bench.text() != before) == (done > 0)
    assert bench.script(rollback(actions, seen)) == ""
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


DECLARED = """\
/interface ethernet
set [ find default-name=ether1 ] name=ether1
/interface wireless
set [ find default-name=wlan1 ] name=wlan1
/interface bridge port
add bridge=b comment="atlantis: radio" interface=wlan1
add bridge=b comment="atlantis: cable" interface=ether1
"""


@pytest.mark.parametrize("done", range(6))
def test_rollback_restores_swapped_names_from_any_step(done: int) -> None:
    bench = make(**SPEC)
    assert bench.script(SWAPPED) == ""
    seen = rows(bench, RADIO, PORT, MEMBER)
    before = bench.text()
    aim = plan("far", desired.read(DECLARED), Observation(FACTS, seen))
    assert [action.layer is Layer.NAMES for action in aim.actions] == [True, True, True, False, False]
    for text, _ in scripts(aim.actions[:done]):
        assert bench.script(text).startswith("ok")
    assert (bench.text() != before) == (done > 0)
    assert bench.script(rollback(aim.actions, seen)) == ""
    assert bench.text() == before


@pytest.mark.parametrize("done", range(2))
def test_rollback_restores_a_row_at_its_position(done: int) -> None:
    bench = make(**SPEC)
    assert bench.script(OLD + "add interface=wlan1 ssid=y\n") == ""
    seen, before = rows(bench, CONNECT), bench.text()
    removal = action(1, CONNECT, Verb.REMOVE, ids=(seen[CONNECT][0][".id"],))
    for text, _ in scripts((removal,)[:done]):
        assert bench.script(text).startswith("ok")
    assert (bench.text() != before) == (done > 0)
    assert bench.script(rollback((removal,), seen)) == ""
    assert bench.text() == before


def test_a_hidden_key_cannot_be_written_back() -> None:
    bench = make(**SPEC)
    seen = rows(bench, RADIO)
    hidden = {RADIO: ({**seen[RADIO][0], "nv2-preshared-key": "*****"},)}
    key = action(1, RADIO, Verb.SET, ids=(seen[RADIO][0][".id"],), values=(("nv2-preshared-key", "new"),))
    with pytest.raises(CannotInvert, match="cannot be read"):
        rollback((key,), hidden)


def test_inverse_with_a_key_in_clear_is_refused() -> None:
    bench = make(**SPEC)
    assert bench.script(OLD) == ""
    seen = rows(bench, RADIO, PROFILES, CONNECT)
    with pytest.raises(CannotInvert, match="a password in clear"):
        inverse(Observation(FACTS, seen), Plan("far", change(seen), ""))


def test_scheduled_job_rolls_back_an_unregistered_radio_and_removes_itself() -> None:
    bench = make(**SPEC)
    bench.script("/interface wireless set wlan1 ssid=new")
    job = pair_script(RADIO, "48:A9:8A:00:00:01", f":do {{\n{RADIO}/set wlan1 ssid=old\n}} on-error={{\n}}\n")
    words = ["/system/scheduler/add", "=name=atlantis-pair", "=interval=5m", f"=on-event={job}"]
    bench.say(*words, "=start-date=2026-01-01", "=start-time=08:01:00")
    bench.now += 59
    bench.device.tick()
    assert bench.value(RADIO, "ssid") == "new"
    bench.now += 2
    bench.device.tick()
    assert bench.value(RADIO, "ssid") == "old"
    assert bench.count("/system/scheduler") == 0
