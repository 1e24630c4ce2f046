"""What is advised about a satellite, and about devices that were not met or have changed, is typed as it stands."""

from collections.abc import Callable
from datetime import date
from types import SimpleNamespace
from typing import Any

import paramiko
import pytest
from hints_said import advised, said
from proving_router import Fake
from test_hints_of_vpn import Laptop, laptop, real
from test_proving import ADDED, SATELLITE, bearer, prove, proving

from atlantis_netcfg.checklist.probes.base import AllowListTestResult
from atlantis_netcfg.checklist.probes.satellite import AllowListProbe
from atlantis_netcfg.cli.base import output
from atlantis_netcfg.core.errors import TRUST, ExitCode, NetcfgError
from atlantis_netcfg.core.events import Verdict
from atlantis_netcfg.core.secret import Secret
from atlantis_netcfg.inventory.model import AllowedTarget
from atlantis_netcfg.links import LinkFinding
from atlantis_netcfg.links.satellite import Attempt, ExpectedOutcome, ProbeOutcome, SatelliteProbe
from atlantis_netcfg.operations.allow_list_test.plan import read
from atlantis_netcfg.operations.common.terminals import judge_terminal
from atlantis_netcfg.operations.upgrade import _configuration
from atlantis_netcfg.routeros.api import Endpoint
from atlantis_netcfg.routeros.api._tls import check_pin
from atlantis_netcfg.routeros.console.ssh import PinnedKey
from atlantis_netcfg.runs import Store

__all__ = ["laptop"]
PROVE = ("measure", "satellite", "site=coastal", "--try-all")
ADOPT = ("device", "adopt", "site=coastal", "device=coastal-router")


class NothingBehindIt(NetcfgError):
    """No device stands behind an address here."""

    exit = ExitCode.NOTHING


@pytest.fixture
def reached(laptop: Laptop) -> list[str]:
    """The devices that a command would have asked or changed, and how."""
    seen: list[str] = []

    def proof(opened: Any) -> None:  # noqa: ANN401 - a session
        seen.append(f"{opened.hosts[0].name} {opened.arguments.flag('try-all')} {opened.arguments.optional('backup')}")
        raise NothingBehindIt("it would be tried")

    def measured(opened: Any, _limits: object) -> None:  # noqa: ANN401 - a session
        seen.append(f"{opened.hosts[0].name} {opened.arguments.optional('link')}")
        raise NothingBehindIt("it would be measured")

    def used(opened: Any, wanted: Any) -> None:  # noqa: ANN401 - a session and its request
        seen.append(f"{opened.hosts[0].name} {wanted.for_s} {wanted.allow_unproved}")
        raise NothingBehindIt("it would be put in use")

    def adoption(arguments: Any, _declaration: object, host: Any, *_: object) -> None:  # noqa: ANN401 - of the command
        seen.append(f"{host.name} {arguments.flag('replaced')}")
        raise NothingBehindIt("it would be looked for")

    def trust(*_: object) -> None:
        seen.append("trust")
        raise NothingBehindIt("it would be shown")

    laptop.monkeypatch.setattr("atlantis_netcfg.cli.adopt._trust_device", trust)
    laptop.monkeypatch.setattr("sys.stdin.isatty", lambda: True, raising=False)
    laptop.monkeypatch.setattr("atlantis_netcfg.cli.links._prove", proof)
    laptop.monkeypatch.setattr("atlantis_netcfg.cli.qualify._measure", measured)
    laptop.monkeypatch.setattr("atlantis_netcfg.cli.use._begin", used)
    laptop.monkeypatch.setattr("atlantis_netcfg.cli.adopt._adoption", adoption)
    return seen


def of_an_error(typed: tuple[str, ...], act: Callable[[], object]) -> str:
    """The hint of an error as the last door tells it, after what was typed."""
    with pytest.raises(NetcfgError) as told:
        act()
    return output.as_typed(str(told.value.hint), typed)


def evidence(at: Laptop, **changes: Any) -> str:  # noqa: ANN401 - fields of the evidence
    """A terminal at which somebody has looked so."""
    declaration = real()
    host = declaration.hosts["coastal-sat"]
    device: Any = host.device
    seen = {"firmware": "1", "allow_list": True, "by": "A", "seen_on": "2026-11-01", "sim_address": None}
    found = SimpleNamespace(**{**seen, "backup_file": None, "backup_sha256": None, **changes})
    looked = judge_terminal(
        declaration,
        SimpleNamespace(
            name=host.name, site=host.site, device=device.model_construct(**{**dict(device), "evidence": found})
        ),  # type: ignore[arg-type] # a host
        Store(at.folder),
        today=date(2026, 11, 2),
    )
    return "\n".join(one.hint for one in looked.findings if one.hint)


def leak(_at: Laptop) -> str:
    attempt = Attempt("weather", ADDED, ExpectedOutcome.REFUSED, SatelliteProbe.ICMP, ProbeOutcome.ANSWERED)
    return str(proving()._judge(attempt, link_seen=True).hint)


def not_tried(_at: Laptop) -> str:
    tried = LinkFinding(Verdict.PASS, "reached", "weather was reached")
    untried = LinkFinding(Verdict.INCONCLUSIVE, "not-tried", "the VPN could not be tried")
    judged = AllowListProbe("satellite", "coastal").judge(
        {"prove": AllowListTestResult(None, findings=(tried, untried))}
    )
    return "\n".join(one.hint for one in judged.findings if one.hint)


def idle(_at: Laptop) -> str:
    """Of the VPN, while another link carries the traffic."""
    return "\n".join(finding.hint or "" for attempt, finding in prove(Fake()).results if attempt.name == "VPN server")


def other_udp(_at: Laptop) -> str:
    """Of a target that nobody asks but the site itself."""
    words = {"name": "weather", "address": ADDED, "port": 5000, "transport": "udp"}
    link = bearer().model_copy(update={"allow": (AllowedTarget.model_validate(words),)})
    found = prove(Fake(), proving(try_all=True, link=link))
    return "\n".join(finding.hint or "" for attempt, finding in found.results if attempt.name == "weather")


def asked_by_rows(_at: Laptop) -> str:
    hints = [finding.hint or "" for attempt, finding in prove(Fake()).results if attempt.target.endswith(" udp 123")]
    return hints[0]


def rows_that_stay(_at: Laptop) -> str:
    router = Fake(beyond={ADDED: 0}, stuck=True)
    return of_an_error(PROVE, lambda: prove(router, proving(open_filter=True)))


def another_port(_at: Laptop) -> str:
    reply: Any = SimpleNamespace(check=lambda: SimpleNamespace(rows=()))
    return of_an_error(PROVE, lambda: read(SATELLITE.port, [reply] * 4))


def never_met(_at: Laptop) -> str:
    client: Any = None
    key = paramiko.ECDSAKey.generate()
    return of_an_error(ADOPT, lambda: PinnedKey(None).missing_host_key(client, "192.0.2.1", key))


def another_box(_at: Laptop) -> str:
    endpoint = Endpoint("192.0.2.1", 8729, "provision", Secret("x"), "00" * 32)
    return of_an_error(ADOPT, lambda: check_pin(endpoint, "11" * 32))


def upgraded(_at: Laptop) -> str:
    planned: Any = SimpleNamespace(exit=ExitCode.CHANGES, planned_count=3, name="coastal-router")
    return _configuration(planned, "coastal")


SITUATIONS: dict[str, tuple[Callable[[Laptop], str], str, int, list[str]]] = {
    "no allow-list": (
        lambda at: evidence(at, allow_list=False),
        (
            "enter the inventory's destinations on the terminal's page; `provision measure satellite site=…` lists "
            "and tests them"
        ),
        7,
        ["coastal-router False None"],
    ),
    "a backup that is not here": (
        lambda at: evidence(at, backup_file="x.bin", backup_sha256="00" * 32),
        "put {} into inventory/evidence/, or pass its path: `provision measure satellite site=… backup=FILE`",
        7,
        ["coastal-router False FILE"],
    ),
    "a leak": (
        leak,
        "`provision site=…` restores the filter; `provision report drift site=…` first shows what has changed",
        0,
        [],
    ),
    "the far end of measurements": (
        lambda _at: prove(Fake()).left_out,
        "provision measure link site={} link={}",
        7,
        ["coastal-router satellite"],
    ),
    "the VPN over an idle satellite": (
        idle,
        "`provision measure satellite site=… --try-all` tests it",
        7,
        ["coastal-router True None"],
    ),
    "another UDP target over an idle satellite": (
        other_udp,
        (
            "`provision links use site=… link={} for=10m --unproved` makes it the active link; then run the same "
            "command again"
        ),
        7,
        ["coastal-router 600 True"],
    ),
    "the time over an idle satellite": (
        asked_by_rows,
        "`provision measure satellite site=… --try-all` tests it",
        7,
        ["coastal-router True None"],
    ),
    "not tried": (not_tried, "`provision measure satellite site={} --try-all`", 7, ["coastal-router True None"]),
    "rows that stay": (
        rows_that_stay,
        "remove the rows with comment `{}`, or run the site, which also removes them: `provision site=…`",
        0,
        [],
    ),
    "another port": (
        another_port,
        "does the inventory have the right port for the satellite's cable? `provision report drift site=…` compares it",
        0,
        [],
    ),
    "never met": (never_met, TRUST, 7, ["trust"]),
    "another box": (
        another_box,
        (
            "{}; only if they are equal and it was renewed on purpose: `provision device trust site=…` asks you to "
            "agree to "
            "it; a device that stands in for another one is met by `provision device adopt site=… device=… --replaced`"
        ),
        7,
        ["trust", "coastal-router True"],
    ),
    "upgraded": (
        upgraded,
        "{} changes to match the inventory: review with `provision plan site={} device={}`",
        0,
        [],
    ),
}


@pytest.mark.parametrize("name", SITUATIONS)
def test_advised_commands_can_be_typed(name: str, laptop: Laptop, reached: list[str]) -> None:
    brings, hint, code, devices = SITUATIONS[name]
    commands = advised(said(brings(laptop), hint))
    assert commands
    for words in commands:
        laptop.type(*words, code=code)
    assert reached == devices
    assert devices or all("coastal-router" in names for names, _ in laptop.plays)
    assert devices or laptop.plays
