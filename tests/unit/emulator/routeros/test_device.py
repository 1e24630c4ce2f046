"""Sessions, time, flash: what the wire builds on."""

import hashlib
import json
from datetime import UTC, datetime

import pytest
from twin_bench import make

from atlantis_netcfg.emulator.routeros.answers import Trap
from atlantis_netcfg.emulator.routeros.device import NOT_REHEARSED, Device
from atlantis_netcfg.emulator.routeros.spec import RouterSpec

REFUSED = r"invalid user name or password \(6\)"


@pytest.mark.parametrize(
    ("user", "password"), [("provision", "x"), ("nobody", ""), ("gone", "x"), ("afar", "y"), ("admin", "")]
)
def test_login_refused(user: str, password: str) -> None:
    router = make()
    with pytest.raises(Trap, match=REFUSED):
        router.session(user, password)


def test_login_needs_the_policy_of_the_service() -> None:
    router = make()
    router.say("/user/group/add", "=name=terminal", "=policy=read,ssh")
    router.say("/user/add", "=name=t", "=group=terminal", "=password=t")
    with pytest.raises(Trap, match=REFUSED):
        router.session("t", "t")


def test_challenge_response_login() -> None:
    router = make()
    challenge = router.device.challenge()
    digest = hashlib.md5(b"\0look" + bytes.fromhex(challenge), usedforsecurity=False).hexdigest()
    caller = router.device.login_response("watch", challenge, f"00{digest}", via="api", address="10.64.101.10")
    assert router.say("/system/identity/print", by=caller) == ["!re =name=MikroTik", "!done"]
    with pytest.raises(Trap, match="cannot log in"):
        router.device.login_response("watch", challenge, f"00{'0' * 32}", via="api", address="10.64.101.10")


def test_active_users_are_listed() -> None:
    router = make()
    router.session("watch", "look")
    assert router.say("/user/active/print", "=.proplist=name,address,via,group") == [
        "!re =name=provision =address=10.64.101.10 =via=api =group=full",
        "!re =name=watch =address=10.64.101.10 =via=api =group=read",
        "!done",
    ]
    router.device.logout(router.caller, clean=True)
    other = router.session()
    assert len(router.say("/user/active/print", by=other)) == 3


def test_quit() -> None:
    assert make().say("/quit") == ["!fatal session terminated on request"]


def test_listen_reports_changes_until_cancelled() -> None:
    router = make()
    listener = router.session()
    assert router.say("/ip/pool/listen", ".tag=7", by=listener) == []
    assert router.device.pending(listener) == []
    router.say("/ip/pool/add", "=name=a", "=ranges=10.0.0.1")
    router.say("/ip/pool/remove", "=.id=a")
    told = [(tag, answer.words) for tag, answer in router.device.pending(listener)]
    assert told[0][0] == "7"
    assert "=name=a" in told[0][1]
    assert told[1] == ("7", ("=.id=*1", "=.dead=true"))
    assert router.say("/cancel", "=tag=7", by=listener) == ["!done"]
    assert [answer.kind for _, answer in router.device.pending(listener)] == ["!trap", "!done"]
    router.say("/ip/pool/add", "=name=b", "=ranges=10.0.0.1")
    assert router.device.pending(listener) == []


def test_configuration_is_restored_from_flash() -> None:
    router = make()
    router.script("/interface bridge add name=lan\n/ip address add address=10.0.0.1/24 interface=lan")
    router.say("/ip/firewall/address-list/add", "=list=a", "=address=10.0.0.1", "=timeout=1h")
    flash = json.loads(json.dumps(router.device.snapshot()))
    other = make()
    revision = other.device.revision
    other.device.restore(flash)
    assert other.text() == router.text()
    assert other.device.revision > revision
    other.caller = other.session()
    assert other.count("/ip/firewall/address-list") == 0
    assert other.say("/interface/bridge/add", "=name=next") == ["!done =ret=*A"]


def test_snapshot_excludes_changes_under_safe_mode() -> None:
    router = make()
    before = router.device.snapshot()["configuration"]["tables"]
    router.say("/safe-mode/take")
    router.script("/ip pool add name=a ranges=10.0.0.1\n/interface ethernet disable ether1")
    assert router.device.snapshot()["configuration"]["tables"] == before
    router.say("/safe-mode/release")
    assert router.device.snapshot()["configuration"]["tables"] != before


def test_the_revision_grows_with_changes_only() -> None:
    router = make()
    before = router.device.revision
    router.say("/ip/address/print")
    assert router.device.revision == before
    router.say("/ip/address/disable", "=.id=*1")
    assert router.device.revision > before


def test_dynamic_entries_expire() -> None:
    router = make()
    router.say("/ip/firewall/address-list/add", "=list=a", "=address=10.0.0.1", "=timeout=30m")
    assert router.value("/ip/firewall/address-list", "dynamic") == "true"
    assert "address-list" not in router.text()
    assert router.device.due() == router.now + 1800
    router.now += 600
    assert router.value("/ip/firewall/address-list", "timeout") == "20m"
    router.now += 1200
    router.device.tick()
    assert router.count("/ip/firewall/address-list") == 0


def test_schedulers_run() -> None:
    router = make()
    event = '/ip pool add name="from the scheduler" ranges=10.0.0.1'
    router.say("/system/scheduler/add", "=name=job", "=interval=10m", f"=on-event={event}")
    assert router.device.due() == router.now + 600
    router.device.tick()
    assert router.count("/ip/pool") == 0
    for _ in range(2):
        router.now += 600
        router.device.tick()
        assert router.count("/ip/pool") == 1
    assert router.value("/system/scheduler", "run-count") == "2"
    assert router.value("/log", "message", "?topics=script,error") == "failure: pool with such name exists"


def test_a_scheduler_that_device_mode_blocks_never_runs() -> None:
    router = make(device_mode={"features": {"scheduler": False}})
    router.say("/system/scheduler/add", "=name=job", "=interval=1m", "=on-event=/ip pool add ranges=10.0.0.1")
    router.now += 3600
    router.device.tick()
    assert router.device.due() is None
    assert router.count("/ip/pool") == 0


def test_the_clock() -> None:
    router = make()
    router.now += 90
    assert router.value("/system/clock", "time") == "08:01:30"
    router.say("/system/clock/set", "=date=2026-06-01", "=time=12:00:00")
    assert router.value("/system/clock", "date") == "2026-06-01"
    assert router.count("/system/history") == 0
    router.device.reboot()
    router.caller = router.session()
    assert router.value("/system/clock", "date") == "2026-06-01"
    assert router.value("/system/resource", "uptime") == "0s"


def test_specs_survive_json() -> None:
    spec = RouterSpec(name="r", version="7.20", seed="/system identity\nset name=x\n", neighbours=("10.0.0.1",))
    again = RouterSpec.model_validate_json(spec.model_dump_json())
    assert again == spec
    assert Device(again, lambda: 0.0).export() == Device(spec, lambda: 0.0).export()


def test_spec_rejects_unknown_ports() -> None:
    with pytest.raises(ValueError, match="no such port on r: ether9"):
        RouterSpec(name="r", poe_ports=("ether9",))


def test_limits_of_the_emulation_are_listed() -> None:
    assert len(NOT_REHEARSED) == len(set(NOT_REHEARSED)) > 5


def test_facts_for_a_preflight() -> None:
    router = make(version="7.21.5", device_mode={"mode": "basic"})
    assert router.value("/system/resource", "version") == "7.21.5 (stable)"
    assert router.value("/system/resource", "board-name") == "RB5009UPr+S+"
    assert router.value("/system/device-mode", "mode") == "basic"
    assert router.value("/system/device-mode", "proxy") == "false"
    assert router.value("/system/package", "name") == "routeros"
    assert router.value("/system/routerboard", "model") == "RB5009UPr+S+"
    assert router.value("/certificate", "name") == "atlantis-api"
    assert router.value("/user/group", "policy", "?name=read") == (
        "local,telnet,ssh,reboot,read,test,winbox,password,web,sniff,sensitive,api,romon,rest-api,!ftp,!write,!policy"
    )


@pytest.mark.parametrize(
    ("version", "date"), [("6.49.18", "jan/01/2026"), ("7.9", "jan/01/2026"), ("7.10", "2026-01-01")]
)
def test_old_versions_use_their_date_format_and_run_schedulers(version: str, date: str) -> None:
    now = [0.0]
    device = Device(RouterSpec(name="router", version=version), lambda: now[0])
    caller = device.login("provision", "", via="api", address=device.spec.management.technician)
    at_noon = ["=start-time=12:00:00", f"=start-date={date}", "=interval=0"]
    for name, start in (("soon", ["=interval=10m"]), ("noon", at_noon)):
        added = device.run(
            caller, ["/system/scheduler/add", f"=name={name}", f"=on-event=/system identity set name={name}", *start]
        )
        assert added[-1].kind == "!done"
        assert not [answer for answer in added if answer.kind == "!trap"]
    assert f"=start-date={date}" in device.run(caller, ["/system/scheduler/print"])[0].words
    now[0] = 601.0
    device.tick()
    assert device.run(caller, ["/system/identity/print"])[0].words == ("=name=soon",)
    now[0] = 4 * 3600 + 1.0
    device.tick()
    (noon,) = [row.words for row in device.run(caller, ["/system/scheduler/print"]) if "=name=noon" in row.words]
    assert "=run-count=1" in noon


def test_routeros_6_has_no_routing_tables() -> None:
    device = Device(RouterSpec(name="router", version="6.49.18"), lambda: 0.0)
    caller = device.login("provision", "", via="api", address=device.spec.management.technician)
    rows = device.run(caller, ["/ip/route/print"])
    assert not [word for row in rows for word in row.words if word.startswith("=routing-table=")]
    assert len(rows) > 1


@pytest.mark.parametrize(
    ("version", "command", "other"),
    [
        ("7.19.6", "request-logout", "remove"),
        ("7.20", "remove", "request-logout"),
        ("7.21.5", "remove", "request-logout"),
    ],
)
def test_another_session_is_ended_by_the_command_of_its_version(version: str, command: str, other: str) -> None:
    device = Device(RouterSpec(name="router", version=version), lambda: 0.0)
    address = device.spec.management.technician
    caller, victim = (device.login("provision", "", via="api", address=address) for _ in range(2))
    named = f"=.id=*{victim.number:X}"
    assert device.run(caller, [f"/user/active/{other}", named])[0].words == ("=category=0", "=message=no such command")
    assert device.run(caller, [f"/user/active/{command}", named, "=zz=1"])[0].words == (
        "=message=unknown parameter zz",
    )
    assert device.closed_sessions == frozenset()
    assert device.run(caller, [f"/user/active/{command}", named])[-1].kind == "!done"
    assert device.closed_sessions == {victim.number}


def test_device_mode_before_7_17_has_its_old_name_and_fewer_features() -> None:
    found = {}
    for version in ("7.16", "7.17"):
        device = Device(RouterSpec(name="router", version=version), lambda: 0.0)
        caller = device.login("provision", "", via="api", address=device.spec.management.technician)
        words = device.run(caller, ["/system/device-mode/print"])[0].words
        found[version] = dict(word[1:].split("=") for word in words)
    assert (found["7.16"]["mode"], found["7.17"]["mode"]) == ("enterprise", "advanced")
    assert set(found["7.17"]) - set(found["7.16"]) == {"install-any-version", "partitions", "routerboard"}


def test_a_time_zone_does_not_set_the_clock() -> None:
    router = make(clock=datetime(2026, 1, 1, 8, 0, 0, 500_000, tzinfo=UTC))
    router.say("/system/scheduler/add", "=name=later", "=interval=20m", "=on-event=:put x")
    router.now += 0.7
    router.say("/system/clock/set", "=time-zone-name=Europe/Lisbon")
    assert router.value("/system/scheduler", "run-count") == "0"
    router.now += 0.4
    assert router.value("/system/clock", "time") == "08:00:01"


# What only clients of others ask of the router.


def test_installed_version_is_shown_before_an_update_check() -> None:
    assert make().say("/system/package/update/print") == ["!re =channel=stable =installed-version=7.18.2", "!done"]


def test_each_cpu_has_its_load() -> None:
    router = make()
    assert len(router.say("/system/resource/cpu/print")) == 5
    assert router.say("/system/resource/cpu/print", "=.proplist=cpu,load")[0] == "!re =cpu=cpu0 =load=1"


def test_interface_stats_include_counters() -> None:
    row = make().say("/interface/print", "=stats=", "?name=ether1")[0]
    assert "=rx-byte=0 =tx-byte=0 =rx-packet=0 =tx-packet=0" in row


def test_settings_are_read_by_value_name_only() -> None:
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


def test_loading_a_missing_backup_fails() -> None:
    router = make()
    try:
        said = router.say("/system/backup/load", "=name=nowhere", "=password=")
    except Trap as trap:
        said = [f"!trap =message={trap.message}"]
    assert "no such item" in said[0]


def test_interface_counters_are_shown_only_on_request() -> None:
    assert "rx-byte" not in make().say("/interface/print", "?name=ether1")[0]
