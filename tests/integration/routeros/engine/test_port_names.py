"""Ports with other names than declared: the site ends on the right sockets, or nothing changes and it is said why."""

import re
from collections.abc import Mapping
from pathlib import Path

import pytest
from engine_bench import TEXT, Bench, on
from test_cut_points import GAP_S, clean, cut, faults

from atlantis_netcfg.emulator.routeros import Execute, FaultKind, LinkFault
from atlantis_netcfg.routeros import DeviceResult, JobMode, Status
from atlantis_netcfg.routeros.drift import DriftKind

pytestmark = pytest.mark.slow

USED = ("ether1", "ether3", "ether4", "ether5", "ether8")
NAMED = "# atlantis:undeclared /interface ethernet disabled=yes\n/interface ethernet\n" + "".join(
    f'set [ find default-name={port} ] comment="atlantis: used" disabled=no name={port}\n' for port in USED
)
SITE = TEXT.replace('costs \\"$\\"; & more', "costs")
DECLARED = NAMED + SITE
"""ether1: a bearer; ether3: a bearer that a rule names; ether4 and ether5: the LAN's bridge; ether8: management."""


def called(names: Mapping[str, str]) -> str:
    """What a person types who gives sockets these names."""
    first = "".join(f"set [ find default-name={port} ] name=x-{port}\n" for port in names)
    then = "".join(f"set [ find default-name={port} ] name={name}\n" for port, name in names.items())
    return f"/interface ethernet\n{first}{then}"


RENAMED = {
    "LAN": {"ether4": "robots"},
    "bearer": {"ether1": "wifi"},
    "bearer in a rule": {"ether3": "starlink"},
    "management": {"ether8": "laptop"},
    "all": {"ether1": "wifi", "ether3": "starlink", "ether4": "robots", "ether8": "laptop"},
    "unused has its name": {"ether3": "starlink", "ether7": "ether3"},
    "LAN and bearer": {"ether4": "ether1", "ether1": "ether4"},
    "two bearers": {"ether1": "ether3", "ether3": "ether1"},
    "two of the LAN": {"ether4": "ether5", "ether5": "ether4"},
    "management and LAN": {"ether8": "ether4", "ether4": "ether8"},
    "management and bearer": {"ether8": "ether1", "ether1": "ether8"},
    "circle": {"ether8": "ether4", "ether4": "ether1", "ether1": "ether8"},
}
SWAPPED_BEFORE = ("LAN and bearer", "two bearers", "two of the LAN")
LOCKS_OUT = ("management and LAN", "management and bearer", "circle")


def body(text: str) -> str:
    """The text without directives, and without the address that an adopted router has already."""
    return "".join(line + "\n" for line in text.splitlines() if not line.startswith("#") and "10.64.101.1/" not in line)


AFTER_ALL = {name: body(DECLARED) + called(names) for name, names in RENAMED.items()}
"""Somebody renamed ports of a router that was as declared: everything stays on its socket."""
BY_NAME = {name: called(RENAMED[name]) + body(SITE) for name in (*SWAPPED_BEFORE, *LOCKS_OUT)}
"""The names were wrong before, and the site was set up by them: it is on the wrong sockets."""


def as_declared() -> str:
    return clean(DECLARED, Execute.OUTPUT).after


async def twice(bench: Bench) -> tuple[DeviceResult, str, DeviceResult]:
    first = await bench.converge()
    return first, bench.export(), await bench.converge()


@pytest.mark.smoke("LAN")
@pytest.mark.parametrize("name", RENAMED)
def test_renamed_port_gets_its_name_back_and_nothing_else_changes(tmp_path: Path, name: str) -> None:
    first, export, second = on(Bench(tmp_path, text=DECLARED, spec={"seed": AFTER_ALL[name]}), twice)
    assert first.status is Status.CHANGED, first.message
    assert all("/interface ethernet" in line or "default-name" in line for line in first.diff.splitlines()), first.diff
    assert export == as_declared()
    assert second.status is Status.UNCHANGED


@pytest.mark.parametrize("name", SWAPPED_BEFORE)
def test_site_with_swapped_ports_is_corrected(tmp_path: Path, name: str) -> None:
    first, export, second = on(Bench(tmp_path, text=DECLARED, spec={"seed": BY_NAME[name]}), twice)
    assert first.status is Status.CHANGED, first.message
    assert sorted(export.splitlines()) == sorted(as_declared().splitlines())
    assert second.status is Status.UNCHANGED


@pytest.mark.smoke("management and LAN")
@pytest.mark.parametrize("name", LOCKS_OUT)
def test_swapped_management_port_is_refused_with_a_working_hint(tmp_path: Path, name: str) -> None:
    """The cable of management is in the socket that has its name; declared so, everything stays where it is plugged."""
    names = RENAMED[name]
    socket = {name: port for port, name in names.items()}
    plugged = socket["ether8"]

    async def act(bench: Bench) -> tuple[list[DeviceResult], list[str]]:
        exports = [bench.export()]
        results = [await bench.converge(JobMode.PLAN), await bench.converge()]
        exports.append(bench.export())
        bench.text = NAMED + re.sub(
            r"interface=(ether\d)", lambda word: f"interface={socket.get(word[1], word[1])}", SITE
        )
        results += [await bench.converge(), await bench.converge()]
        return results, exports

    spec = {"seed": BY_NAME[name], "management": {"port": plugged}}
    (planned, refused, declared, again), exports = on(Bench(tmp_path, text=DECLARED, spec=spec), act)
    for result in (planned, refused):
        assert (result.status, result.exit) == (Status.REFUSED, 4)
        assert f"10.64.101.1, which your session uses, would move from {plugged} to ether8" in result.message
        assert "run this from another port, or correct the ports in the inventory" in result.message
        assert f"{plugged} is the port that is now called ether8" in result.message
    assert exports[0] == exports[1]
    assert declared.status is Status.CHANGED, declared.message
    assert "/ip address" not in declared.diff
    assert again.status is Status.UNCHANGED


CUT = {
    "swap after": AFTER_ALL["management and LAN"],
    "circle after": AFTER_ALL["circle"],
    "swap before": BY_NAME["LAN and bearer"],
}


@pytest.mark.smoke("swap after-/execute-3-before-drop")
@pytest.mark.parametrize("kind", [FaultKind.DROP, FaultKind.POWER])
@pytest.mark.parametrize("when", ["before", "after"])
@pytest.mark.parametrize(("path", "nth"), [("/execute", 3), ("/login", 2), ("/safe-mode/release", 1)])
@pytest.mark.parametrize("seed", CUT)
def test_interrupted_renaming_leaves_all_names_old_or_new(  # noqa: PLR0913, PLR0917 - where it is cut, and how
    tmp_path: Path, seed: str, path: str, nth: int, when: str, kind: FaultKind
) -> None:
    fault = LinkFault.model_validate({"do": kind, "match": path, "sentence": nth, "when": when})
    assert cut(tmp_path, fault, DECLARED, seed=CUT[seed]).status is not Status.LEFT_AS_FOUND


@pytest.mark.smoke("circle after-1-7.16")
@pytest.mark.parametrize("version", ["7.18.2", "7.16"])
@pytest.mark.parametrize("nth", [1, 2, 3, 4])
@pytest.mark.parametrize("seed", ["circle after", "swap before"])
def test_interrupted_renaming_without_scripts_is_rolled_back(tmp_path: Path, seed: str, nth: int, version: str) -> None:
    """The session that holds safe mode dies, or the job of a router without it takes back what was done."""
    fault = LinkFault(do=FaultKind.DROP, match="/interface/ethernet/set", sentence=nth, when="after")
    result = cut(tmp_path, fault, DECLARED, Execute.NONE, CUT[seed], version)
    assert result.status is Status.ROLLED_BACK


@pytest.mark.smoke
def test_dead_man_job_returns_every_row_to_its_port(tmp_path: Path) -> None:
    """By then names are as declared; the job gives them back first, and finds rows by those."""
    fault = LinkFault(do=FaultKind.DROP, match="/interface/list/member/add", sentence=1, when="after")
    result = cut(tmp_path, fault, DECLARED, Execute.NONE, CUT["swap before"], "7.16")
    assert result.status is Status.ROLLED_BACK


EVERYWHERE = [
    ("circle after", Execute.NONE, "7.18.2"),
    ("swap before", Execute.OUTPUT, "7.18.2"),
    ("swap after", Execute.NONE, "7.16"),
]


@pytest.mark.campaign
@pytest.mark.parametrize(("kind", "when"), list(faults()))
@pytest.mark.parametrize(("seed", "execute", "version"), EVERYWHERE)
def test_renaming_cut_at_every_sentence(  # noqa: PLR0913, PLR0917 - every way to cut
    tmp_path: Path, seed: str, execute: Execute, version: str, kind: FaultKind, when: str
) -> None:
    for sentence in range(1, clean(DECLARED, execute, CUT[seed], version).sentences + 1):
        fault = {"do": kind, "when": when, "sentence": sentence, "seconds": GAP_S}
        cut(tmp_path / str(sentence), LinkFault.model_validate(fault), DECLARED, execute, CUT[seed], version)


@pytest.mark.campaign
@pytest.mark.parametrize("execute", [Execute.OUTPUT, Execute.NONE])
@pytest.mark.parametrize("seed", [*AFTER_ALL.values(), *(BY_NAME[name] for name in SWAPPED_BEFORE)])
def test_every_permutation_of_names_cut_at_every_sentence(tmp_path: Path, seed: str, execute: Execute) -> None:
    for sentence in range(1, clean(DECLARED, execute, seed).sentences + 1):
        cut(tmp_path / str(sentence), LinkFault(do=FaultKind.DROP, sentence=sentence), DECLARED, execute, seed)


def test_undeclared_names_and_ports_are_drift_and_get_repaired(tmp_path: Path) -> None:
    async def act(bench: Bench) -> list[DeviceResult]:
        drifted = await bench.converge(JobMode.DRIFT)
        await bench.converge()
        return [drifted, await bench.converge(JobMode.DRIFT)]

    ports = tuple(f"ether{number}" for number in range(1, 9))
    spec = {
        "ports": (*ports, "sfp-sfpplus1"),
        "seed": AFTER_ALL["management and LAN"] + "set [ find default-name=sfp-sfpplus1 ] disabled=no\n",
    }
    drifted, then = on(Bench(tmp_path, text=DECLARED, spec=spec), act)
    assert drifted.comparison is not None
    found = {
        one.subject: [(each.name, each.desired_value, each.actual_value) for each in one.fields]
        for one in drifted.comparison.differences
    }
    assert {one.kind for one in drifted.comparison.differences} == {DriftKind.CHANGED}
    assert found == {
        **{port: [("disabled", "yes", "no")] for port in ("ether2", "ether6", "ether7", "sfp-sfpplus1")},
        "ether4": [("name", "ether4", "ether8")],
        "ether8": [("name", "ether8", "ether4")],
    }
    assert (then.status, then.message) == (Status.UNCHANGED, "as in the inventory")


def test_name_in_use_elsewhere_is_refused_with_a_command_that_frees_it(tmp_path: Path) -> None:
    bridge = "/interface bridge\nadd name=ether3\n"
    seed = body(DECLARED) + called({"ether3": "starlink"}) + bridge

    async def act(bench: Bench) -> list[DeviceResult]:
        refused = await bench.converge()
        command = refused.message.rpartition("`")[0].rpartition("`")[2]
        path, _, rest = command.partition(" set ")
        found = re.fullmatch(r"\[find name=(\S+)\] name=(\S+)", rest)
        assert found is not None
        words = [f"{path.replace(' ', '/')}/set", f"=.id={found[1]}", f"=name={found[2]}"]
        await bench.router.console(words)
        return [refused, await bench.converge(), await bench.converge()]

    refused, first, second = on(Bench(tmp_path, text=DECLARED, spec={"seed": seed}), act)
    assert (refused.status, refused.exit) == (Status.REFUSED, 4)
    assert first.status is Status.CHANGED, first.message
    assert second.status is Status.UNCHANGED


RADIO = (
    '/interface bridge\nadd comment="atlantis: cable and radio" name=bridge\n'
    "# atlantis:entire /interface bridge port\n/interface bridge port\n"
    'add bridge=bridge comment="atlantis: cable" interface=ether1\n'
    'add bridge=bridge comment="atlantis: radio" interface={radio}\n'
)


@pytest.mark.parametrize(
    ("menu", "radio", "package"), [("wireless", "wlan1", "wireless"), ("wifi", "wifi1", "wifi-qcom")]
)
def test_swapped_names_of_cable_and_radio_are_restored(tmp_path: Path, menu: str, radio: str, package: str) -> None:
    rows = RADIO.format(radio=radio)
    text = (
        "/interface ethernet\nset [ find default-name=ether1 ] name=ether1\n"
        f"/interface {menu}\nset [ find default-name={radio} ] disabled=yes name={radio}\n{rows}"
    )
    swap = (
        "/interface ethernet\nset [ find default-name=ether1 ] name=x\n"
        f"/interface {menu}\nset [ find default-name={radio} ] name=ether1\n"
        f"/interface ethernet\nset [ find default-name=ether1 ] name={radio}\n"
    )
    spec = {"seed": body(rows) + swap, "packages": ("routeros", package), "radios": ({"name": radio},)}
    first, export, second = on(Bench(tmp_path, text=text, spec=spec), twice)
    assert (first.status, first.planned_count) == (Status.CHANGED, 3), first.message
    assert "interface=ether1" in export
    assert f"interface={radio}" in export
    assert "-atlantis" not in export
    assert second.status is Status.UNCHANGED
