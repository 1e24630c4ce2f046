"""What only clients of others ask of the router."""

from __future__ import annotations

import pytest
from twin_bench import make

from atlantis_netcfg.emulator.routeros.answers import Trap


def test_what_runs_is_said_before_anybody_looked_for_updates() -> None:
    assert make().say("/system/package/update/print") == ["!re =channel=stable =installed-version=7.18.2", "!done"]


def test_each_cpu_has_its_load() -> None:
    router = make()
    assert len(router.say("/system/resource/cpu/print")) == 5
    assert router.say("/system/resource/cpu/print", "=.proplist=cpu,load")[0] == "!re =cpu=cpu0 =load=1"


def test_interfaces_count_what_passes() -> None:
    row = make().say("/interface/print", "=stats=", "?name=ether1")[0]
    assert "=rx-byte=0 =tx-byte=0 =rx-packet=0 =tx-packet=0" in row


def test_settings_are_got_by_the_name_of_the_value_alone() -> None:
    router = make()
    script = "=script=:put [/system/identity/get name]"
    assert router.say("/execute", script, "=as-string=") == ["!done =ret=MikroTik"]
    script = "=script=:put [/interface/get ether1 name]"
    assert router.say("/execute", script, "=as-string=") == ["!done =ret=ether1"]


@pytest.mark.parametrize("name", ["before", "before.backup"])
def test_a_backup_is_loaded_with_and_without_its_ending(name: str) -> None:
    router = make()
    router.say("/system/backup/save", "=name=before", "=dont-encrypt=yes")
    router.say("/system/identity/set", "=name=changed")
    assert router.say("/system/backup/load", f"=name={name}", "=password=")[-1] == "!done"
    assert router.say("/system/identity/print") == ["!re =name=MikroTik", "!done"]


def test_a_backup_that_is_not_there() -> None:
    router = make()
    try:
        said = router.say("/system/backup/load", "=name=nowhere", "=password=")
    except Trap as trap:
        said = [f"!trap =message={trap.message}"]
    assert "no such item" in said[0]


def test_counters_of_interfaces_are_shown_when_asked_for() -> None:
    assert "rx-byte" not in make().say("/interface/print", "?name=ether1")[0]
