"""What is read of a device, and what is said of one that does not answer as a RouterOS device does."""

import asyncio
from collections.abc import Mapping

import pytest
from scripted import Scripted

from atlantis_netcfg.core.errors import DeviceError
from atlantis_netcfg.core.secret import Secret
from atlantis_netcfg.routeros._types import Observation
from atlantis_netcfg.routeros.api import Command, CommandError, Endpoint, Reply, Trap
from atlantis_netcfg.routeros.apply._work import find_leftovers
from atlantis_netcfg.routeros.observe import LATER, MenuMissing, complete_observation, observe

ENDPOINT = Endpoint("192.0.2.1", 8729, "provision", Secret("x"), None)
ANSWERS: Mapping[str, Reply] = {
    "/system/resource/print": Reply(({"version": "7.18.2 (stable)", "board-name": "RB5009"},)),
    "/safe-mode/print": Reply(({"enabled": "false", "current": "false"},)),
    "/system/device-mode/print": Reply(({"mode": "home", "scheduler": "false"},)),
    "/user/active/print": Reply(
        (
            {"name": "provision", "address": "10.0.0.8", "via": "winbox"},
            {"name": "provision", "address": "10.0.0.2", "via": "api"},
            {"name": "provision", "address": "10.0.0.3", "via": "api"},
            {"name": "other", "address": "10.0.0.9", "via": "api"},
        )
    ),
    "/system/history/print": Reply(ret="7"),
    "/system/scheduler/print": Reply(),
    "/system/identity/print": Reply(({"name": "quay"},)),
    "/user/print": Reply(({"name": "provision", "group": "ours"},)),
    "/user/group/print": Reply(({"name": "ours", "policy": "read,write,!sensitive,api"},)),
    "/certificate/print": Reply(({".id": "*1", "name": "api"},)),
    "/ip/pool/print": Reply(({".id": "*1", "name": "lan"},)),
}
GONE = Reply(trap=Trap("no such command prefix", 0))


def read(changes: Mapping[str, Reply], *needed: str, looked_at: tuple[str, ...] = ()) -> Observation:
    answers = {**ANSWERS, **changes}
    return asyncio.run(observe(Scripted(lambda command: answers[command.path]), ENDPOINT, needed, looked_at))


def test_facts_of_device_and_session_are_read() -> None:
    facts = read({}, "/ip/pool", looked_at=LATER).facts
    assert (str(facts.version), facts.board, facts.identity) == ("7.18.2", "RB5009", "quay")
    assert facts.policies == frozenset({"read", "write", "api"})
    assert facts.session_address == "10.0.0.3"
    assert (facts.has_safe_mode, facts.safe_mode_owner, facts.history) == (True, None, 7)
    assert facts.device_mode["mode"] == "home"


def test_armed_job_is_reported_as_a_leftover() -> None:
    row = {".id": "*3", "name": "atlantis-pair", "comment": "run 20261121T093000Z of provision"}
    seen = find_leftovers(read({"/system/scheduler/print": Reply((row,))}, "/ip/pool"))
    assert [(job.name, job.owner) for job in seen.jobs] == [("atlantis-pair", "run 20261121T093000Z of provision")]
    assert not find_leftovers(read({}, "/ip/pool"))


def test_user_policies_are_read_later_and_only_once() -> None:
    sent: list[str] = []

    def answer(command: Command) -> Reply:
        sent.append(command.path)
        return ANSWERS[command.path]

    async def act() -> tuple[Observation, Observation]:
        session = Scripted(answer)
        first = await observe(session, ENDPOINT, ["/ip/pool", "/certificate"])
        sent.clear()
        whole, beside = await complete_observation(session, ENDPOINT, first)
        assert not beside
        return first, whole

    first, later = asyncio.run(act())
    assert first.facts.policies is None
    assert later.facts.policies == frozenset({"read", "write", "api"})
    assert sent == ["/user/print", "/user/group/print", "/system/device-mode/print"]
    assert (first.facts.device_mode, later.facts.device_mode["mode"]) == ({}, "home")
    assert later.rows.keys() == {*first.rows, *LATER}


def test_safe_mode_owner_is_read() -> None:
    row = {"enabled": "true", "user": "admin", "current": "false"}
    assert read({"/safe-mode/print": Reply(({**row, "owner": "ssh:admin"},))}).facts.safe_mode_owner == "ssh:admin"
    assert read({"/safe-mode/print": Reply((row,))}).facts.safe_mode_owner == "admin"
    older = read({"/safe-mode/print": GONE, "/system/device-mode/print": GONE, "/system/history/print": GONE}).facts
    assert (older.has_safe_mode, older.safe_mode_owner, older.device_mode, older.history) == (False, None, {}, 0)


def test_no_menu_is_requested_twice_or_without_need() -> None:
    sent: list[Command] = []

    def answer(command: Command) -> Reply:
        sent.append(command)
        return ANSWERS[command.path]

    asyncio.run(observe(Scripted(answer), ENDPOINT, ["/ip/pool", "/user"], ["/ip/pool", "/user/group"]))
    paths = [command.path for command in sent]
    assert len(paths) == len(set(paths))
    assert paths[-5:] == [
        *("/safe-mode/print", "/user/active/print", "/system/history/print"),
        *("/system/scheduler/print", "/system/device-mode/print"),
    ]
    pool = next(command for command in sent if command.path == "/ip/pool/print")
    assert dict(pool.arguments)[".proplist"].startswith(".id,name,")


def test_menus_that_the_device_lacks_are_named() -> None:
    with pytest.raises(MenuMissing, match=r"RouterOS 7\.18\.2\) does not have /ip pool, /ip route") as failure:
        read({"/ip/pool/print": GONE, "/ip/route/print": GONE}, "/ip/pool", "/ip/route")
    assert failure.value.hint is not None
    assert "upgrade RouterOS" in failure.value.hint


def test_read_only_menus_may_be_missing_or_forbidden() -> None:
    secret = Reply(trap=Trap("not enough permissions (9)"))
    found = read({"/ip/pool/print": GONE, "/user/print": secret}, looked_at=("/ip/pool", *LATER))
    assert "/ip/pool" not in found.rows
    assert found.facts.policies == frozenset()
    with pytest.raises(CommandError, match="not enough permissions"):
        read({"/ip/pool/print": secret}, "/ip/pool")


@pytest.mark.parametrize("rows", [(), ({},), ({"version": "OpenWrt 23"},)])
def test_unknown_device_kind_is_refused(rows: tuple[Mapping[str, str], ...]) -> None:
    with pytest.raises(DeviceError, match="unknown RouterOS version"):
        read({"/system/resource/print": Reply(rows)})


def test_settings_with_two_rows_are_refused_and_with_none_are_empty() -> None:
    two = {"/routing/settings/print": Reply(({"policy-rules": "main"}, {"policy-rules": "user"}))}
    with pytest.raises(DeviceError, match="/routing settings: settings are a single row, but the device returned 2"):
        read(two, looked_at=("/routing/settings",))
    assert read({"/routing/settings/print": Reply()}, looked_at=("/routing/settings",)).rows["/routing/settings"] == ()
