"""What the device's own parser would refuse is refused before anything is sent, at no round trip of its own."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest
from engine_bench import PASSWORD, TEXT, Bench, leases, on

from atlantis_netcfg.core.errors import ExitCode
from atlantis_netcfg.emulator.routeros import User
from atlantis_netcfg.routeros import DeviceResult, JobMode, Status, desired
from atlantis_netcfg.routeros.apply._state import SAVING
from atlantis_netcfg.routeros.commands import Examination
from atlantis_netcfg.routeros.menus import MENUS, Field

VERSIONS = ("7.16", "7.18.2", "7.21.5", "7.24")
NAMED_FROM = ("7.23", "7.24")
"""Versions whose parser names the argument."""
NEWER = {
    "7.16": ("/ip/dhcp-server", "address-lists"),
    "7.18.2": ("/ip/dhcp-server", "use-reconfigure"),
    "7.21.5": ("/ip/dhcp-client", "name"),
    "7.24": ("/ip/dhcp-server", "of-tomorrow"),
}
"""An argument that the version does not have yet; after 7.24 nobody knows one."""
ROWS = {
    "/ip/dhcp-server": 'add comment="atlantis: lan" interface=ether4 name=newer {}=x',
    "/ip/dhcp-client": 'add comment="atlantis: uplink" interface=ether6 {}=x',
}
_LOOKS = (
    *("/print", "/login", "/cancel", "/console/inspect", "/safe-mode/take"),
    *("/safe-mode/release", "/safe-mode/unroll"),
)
_PARSES = "=script=:foreach n,s in={"
_SAVING = {command.words()[1] for command in SAVING}
"""An export, and a word that a script prints."""


def with_argument(monkeypatch: pytest.MonkeyPatch, menu: str, name: str) -> None:
    """Let our own table know an argument, whatever versions have it: as if the table were wrong."""
    known = MENUS[menu]
    wrong = replace(known, fields=(*(each for each in known.fields if each.name != name), Field(name)))
    for part in ("fields", "by_name", "alphabetical"):
        monkeypatch.setitem(known.__dict__, part, getattr(wrong, part))


def sent(bench: Bench) -> Iterator[tuple[str, ...]]:
    """Sentences that could have changed something."""
    for connection in bench.router.connections():
        for sentence in connection.sentences:
            harmless = sentence[0] == "/execute" and (sentence[1].startswith(_PARSES) or sentence[1] in _SAVING)
            if not harmless and not sentence[0].endswith(_LOOKS):
                yield sentence


async def refused(bench: Bench, text: str) -> DeviceResult:
    """Plan and apply: both are refused with exit code 4 and in the same words, and nothing was sent."""
    before = bench.export()
    wanted = desired.read(text, source="site.rsc")
    planned = await bench.converge(JobMode.PLAN, desired_state=wanted, ssh=bench.ssh)
    result = await bench.converge(desired_state=wanted, ssh=bench.ssh)
    assert (planned.status, planned.exit) == (result.status, result.exit) == (Status.REFUSED, ExitCode.FAILED)
    assert planned.message == result.message
    assert not any("INCONCLUSIVE" in note for note in result.notes)
    assert list(sent(bench)) == []
    assert bench.export() == before
    return result


def line_of(text: str, part: str) -> int:
    return next(number for number, line in enumerate(text.splitlines(), start=1) if part in line)


@pytest.mark.smoke("7.18.2")
@pytest.mark.parametrize("version", VERSIONS)
def test_misspelt_argument_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, version: str) -> None:
    with_argument(monkeypatch, "/ip/pool", "rangse")
    text = TEXT.replace("ranges=10.64.1.100-10.64.1.199", "ranges=10.64.1.100-10.64.1.199 rangse=x")
    result = on(Bench(tmp_path, spec={"version": version}), lambda bench: refused(bench, text))
    words = "bad parameter rangse" if version in NAMED_FROM else "expected end of command at `rangse`"
    place = (
        f"site.rsc, line {line_of(text, 'rangse')}: the device's own parser does not take this (add lan in /ip pool)"
    )
    assert f"{place}: {words}" in result.message


@pytest.mark.smoke("7.18.2")
@pytest.mark.parametrize("version", VERSIONS)
def test_argument_newer_than_the_device_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, version: str
) -> None:
    menu, name = NEWER[version]
    with_argument(monkeypatch, menu, name)
    row = ROWS[menu].format(name)
    text = f"{TEXT}{MENUS[menu].title}\n{row}\n"
    result = on(Bench(tmp_path, spec={"version": version}), lambda bench: refused(bench, text))
    assert f"site.rsc, line {line_of(text, row)}: " in result.message
    assert name in result.message


@pytest.mark.smoke("7.18.2")
@pytest.mark.parametrize("version", VERSIONS)
def test_menu_of_a_missing_package_is_refused(tmp_path: Path, version: str) -> None:
    """The reading has found that out already."""
    text = f"{TEXT}/interface wireless security-profiles\nadd comment=atlantis name=link mode=dynamic-keys\n"
    result = on(Bench(tmp_path, spec={"version": version}), lambda bench: refused(bench, text))
    assert f"this device (RouterOS {version}) does not have /interface wireless security-profiles" in result.message


@pytest.mark.smoke("7.18.2")
@pytest.mark.parametrize("version", VERSIONS)
def test_value_outside_a_closed_list_is_refused(tmp_path: Path, version: str) -> None:
    text = TEXT.replace(
        'action=drop chain=input comment="atlantis: rest"', 'action=dorp chain=input comment="atlantis: rest"'
    )
    result = on(Bench(tmp_path, spec={"version": version}), lambda bench: refused(bench, text))
    assert f"site.rsc, line {line_of(text, 'dorp')}: " in result.message
    assert "`action` is one of accept, add-dst-to-address-list" in result.message
    assert result.message.endswith(", not dorp")


def test_all_errors_are_reported_together(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with_argument(monkeypatch, "/ip/pool", "rangse")
    text = TEXT.replace("name=lan ranges=", "name=lan rangse=x ranges=").replace(
        "action=masquerade", "action=maskerade"
    )
    result = on(Bench(tmp_path), lambda bench: refused(bench, text))
    assert "`rangse`" in result.message
    assert "not maskerade" in result.message


@pytest.mark.smoke("many-apply")
@pytest.mark.parametrize("mode", [JobMode.PLAN, JobMode.APPLY])
@pytest.mark.parametrize("more", [0, 150], ids=["few", "many"])
def test_parsing_a_valid_plan_costs_no_extra_round_trip(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, mode: JobMode, more: int
) -> None:
    with_it = on(
        Bench(tmp_path / "with"), lambda bench: bench.converge(mode, desired_state=desired.read(TEXT + leases(more)))
    )
    monkeypatch.setattr(Examination, "questions", lambda *_: ())
    without = on(
        Bench(tmp_path / "without"), lambda bench: bench.converge(mode, desired_state=desired.read(TEXT + leases(more)))
    )
    assert with_it.status is without.status is (Status.PLANNED if mode is JobMode.PLAN else Status.CHANGED)
    assert with_it.round_trips == without.round_trips
    assert not any("INCONCLUSIVE" in note for note in with_it.notes)
    assert with_it.sent_bytes > without.sent_bytes


def test_unchanged_configuration_is_not_parsed(tmp_path: Path) -> None:
    async def act(bench: Bench) -> tuple[DeviceResult, list[str]]:
        await bench.converge()
        result = await bench.converge()
        return result, [sentence[0] for sentence in bench.router.connections()[-1].sentences]

    result, said = on(Bench(tmp_path), act)
    assert result.status is Status.UNCHANGED
    assert not {"/execute", "/console/inspect"} & set(said)


def test_drift_does_not_use_the_parser(tmp_path: Path) -> None:
    async def act(bench: Bench) -> tuple[DeviceResult, list[str]]:
        result = await bench.converge(JobMode.DRIFT)
        return result, [sentence[0] for each in bench.router.connections() for sentence in each.sentences]

    result, said = on(Bench(tmp_path), act)
    assert result.status is Status.DRIFTED
    assert "/execute" not in said


def test_device_without_scripts_is_inconclusive_and_run_continues(tmp_path: Path) -> None:
    async def act(bench: Bench) -> tuple[DeviceResult, DeviceResult]:
        return await bench.converge(JobMode.PLAN), await bench.converge()

    planned, changed = on(Bench(tmp_path, spec={"execute": "none"}), act)
    assert (planned.status, changed.status) == (Status.PLANNED, Status.CHANGED)
    for result in (planned, changed):
        (note,) = [note for note in result.notes if "INCONCLUSIVE" in note]
        assert "the device does not run a script that only parses (no such command)" in note


def test_read_only_user_makes_parsing_inconclusive(tmp_path: Path) -> None:
    users = (User(name="provision", password=PASSWORD, group="read"),)
    planned = on(Bench(tmp_path, spec={"users": users}), lambda bench: bench.converge(JobMode.PLAN))
    assert planned.status is Status.REFUSED
    assert "our user lacks the permissions" in planned.message
    assert any("INCONCLUSIVE" in note and "not enough permissions" in note for note in planned.notes)


def test_a_parser_that_takes_everything_is_inconclusive(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Whose parser does not look at names says nothing by its silence."""
    monkeypatch.setattr("atlantis_netcfg.emulator.routeros.console.run._code", lambda *_: "(evl /ip/pool/add)")
    result = on(Bench(tmp_path), lambda bench: bench.converge())
    assert result.status is Status.CHANGED
    assert any("INCONCLUSIVE" in note and "with an unknown message" in note for note in result.notes)
