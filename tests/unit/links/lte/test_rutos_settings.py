"""What would be set on a RutOS unit: pure, then against the twin's strict `uci` over real SSH."""

import dataclasses
from pathlib import Path
from typing import Any

import pytest

from atlantis_netcfg.core.secret import Secret
from atlantis_netcfg.emulator.rutos import RunningRutos, RutosSpec
from atlantis_netcfg.links.lte import LteReading, Registration
from atlantis_netcfg.links.lte.rutos_settings import (
    RELOAD,
    SHOW,
    WRITE,
    LteSettings,
    SettingError,
    batch,
    changes,
    parse_show,
    why_pin_blocks,
)
from atlantis_netcfg.routeros.console.ssh import open_commands
from atlantis_netcfg.routeros.console.types import ConsoleLoginError, HostKeyMismatch, UnknownHostKey

HOME = LteReading(source="rutos", state=Registration.REGISTERED_HOME, sim_slot=1)
LOCKED = LteReading(source="rutos", state=Registration.SIM_PIN_REQUIRED, sim_slot=1, pin_tries_left=3)
SHOWN = """\
network.loopback=interface
network.loopback.proto='static'
network.mob1s1a1=interface
network.mob1s1a1.proto='wwan'
network.mob1s1a1.sim='1'
network.mob1s1a1.auto_apn='1'
network.mob1s1a1.auth='none'
network.mob1s2a1=interface
network.mob1s2a1.proto='wwan'
network.mob1s2a1.sim='2'
simcard.@sim[0]=sim
simcard.@sim[0].position='1'
simcard.@sim[0].primary='1'
simcard.@sim[1]=sim
simcard.@sim[1].position='2'
simcard.@sim[1].deny_roaming='1'
simcard.@sim[1].note='it'\\''s' 'a list'
"""
PIN = Secret("1234")


def lines(reading: LteReading, **wanted: Any) -> list[str]:  # noqa: ANN401 (fields of LteSettings)
    return [one.line for one in changes(reading, LteSettings(**wanted), parse_show(SHOWN))]


def test_sections_are_parsed_with_their_lists() -> None:
    sections = parse_show(SHOWN)
    assert sections["simcard", "@sim[1]"] == {"": "sim", "position": "2", "deny_roaming": "1", "note": "it's a list"}


def test_only_differences_are_set() -> None:
    assert lines(HOME, roaming=True) == []
    assert lines(HOME) == ["set simcard.@sim[0].deny_roaming='1'"]
    assert lines(dataclasses.replace(HOME, sim_slot=2)) == []
    assert lines(HOME, apn="internet", roaming=True) == [
        "set network.mob1s1a1.auto_apn='0'",
        "set network.mob1s1a1.apn='internet'",
    ]


def test_user_gets_an_auth_method_and_secrets_are_masked() -> None:
    told = lines(HOME, apn="internet", user="one", password=Secret("hunter2"), roaming=True)
    assert told[2:] == [
        "set network.mob1s1a1.auth='pap'",
        "set network.mob1s1a1.username='one'",
        "set network.mob1s1a1.password='********'",
    ]


def test_pin_is_set_only_while_the_sim_requires_it() -> None:
    assert lines(HOME, pin=PIN, roaming=True) == []
    assert lines(LOCKED, pin=PIN, roaming=True) == ["set simcard.@sim[0].pincode='********'"]


@pytest.mark.parametrize(
    ("reading", "pin", "tried", "why"),
    [
        (HOME, PIN, "sent at noon", None),
        (LOCKED, PIN, "", None),
        (LOCKED, PIN, "sent at noon", "sent at noon"),
        (LOCKED, None, "", "but the inventory has none"),
        (dataclasses.replace(LOCKED, pin_refused=True), PIN, "", "the SIM refused the PIN"),
        (dataclasses.replace(LOCKED, pin_tries_left=1), PIN, "", "the SIM has one PIN try left"),
        (dataclasses.replace(LOCKED, state=Registration.SIM_PUK_REQUIRED), PIN, "", "asks for its PUK"),
    ],
)
def test_reasons_not_to_set_a_pin(reading: LteReading, pin: Secret | None, tried: str, why: str | None) -> None:
    held = why_pin_blocks(reading, LteSettings(pin=pin), parse_show(SHOWN), pin_refusal=tried)
    assert held is None if why is None else why in str(held)


def test_saved_pin_that_did_not_unlock_is_wrong() -> None:
    sections = parse_show(SHOWN + "simcard.@sim[0].pincode='1234'\n")
    assert "the unit has the inventory's PIN stored" in str(
        why_pin_blocks(LOCKED, LteSettings(pin=PIN), sections, pin_refusal="")
    )


@pytest.mark.parametrize(
    ("shown", "words"), [("network.lan=interface\n", "no mobile interface for slot 1"), ("", "no mobile interface")]
)
def test_an_unexpected_configuration_is_refused(shown: str, words: str) -> None:
    with pytest.raises(SettingError, match=words):
        changes(HOME, LteSettings(apn="internet"), parse_show(shown))
    with pytest.raises(SettingError, match="no section `sim` for slot 1"):
        changes(HOME, LteSettings(), parse_show(shown))


@pytest.mark.parametrize("bad", ["it's", "a\\b", "a\nset network.lan.proto='x"])
def test_values_cannot_escape_their_quotes(bad: str) -> None:
    with pytest.raises(SettingError) as caught:
        changes(HOME, LteSettings(apn="internet", password=Secret(bad)), parse_show(SHOWN))
    assert bad not in str(caught.value)


def test_settings_are_written_over_ssh_and_read_back(tmp_path: Path) -> None:
    wanted = LteSettings(apn="internet", user="one", password=Secret("hunter2"))
    spec = RutosSpec(name="te4sea-4g", admin_password="an-admin's")
    with RunningRutos(spec, tmp_path) as running:
        at, twin = running.ready, running.unit
        door = (at["host"], at["ssh"], "root")
        with open_commands(*door, Secret("an-admin's"), pin=at["host_key"]) as ssh:
            before = changes(HOME, wanted, parse_show(ssh.run(SHOW).out))
            assert [one.option for one in before] == [
                *("auto_apn", "apn", "auth", "username", "password"),
                "deny_roaming",
            ]
            end = ssh.run(WRITE, input_text=batch(before))
            assert (end.code, end.error) == (0, "")
            assert ssh.run(RELOAD).code == 0
            assert changes(HOME, wanted, parse_show(ssh.run(SHOW).out)) == ()
            assert ssh.count == 4
        assert twin.shell.commands == [SHOW, WRITE, RELOAD, SHOW]
        assert "hunter2" not in "".join(twin.shell.commands)
        assert (twin.uci.commits, twin.modem.settings["apn"]) == (2, "internet")
        with pytest.raises(UnknownHostKey):
            open_commands(*door, Secret("an-admin's"), pin=None)
        with pytest.raises(HostKeyMismatch):
            open_commands(*door, Secret("an-admin's"), pin="SHA256:another")
        with pytest.raises(ConsoleLoginError):
            open_commands(*door, Secret("wrong"), pin=at["host_key"])


def test_emulator_refuses_what_uci_refuses(tmp_path: Path) -> None:
    with RunningRutos(RutosSpec(name="te4sea-4g", admin_password="x"), tmp_path) as running:
        at = running.ready
        with open_commands(at["host"], at["ssh"], "root", Secret("x"), pin=at["host_key"]) as ssh:
            assert ssh.run("uci show nosuch") == dataclasses.replace(
                ssh.run("uci show nosuch"), code=1, out="", error="uci: Entry not found\n"
            )
            end = ssh.run(WRITE, input_text="set network.nosuch.apn='x'\nset network.mob1s1a1.nosuch='x'\nfoo\n")
            assert end.error.splitlines() == ["uci: Entry not found", "uci: Invalid argument", "Unknown command"]
            assert ssh.run("rm -rf /").code == 127
