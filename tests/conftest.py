"""Rules for every test: unreviewed skips fail CI, nothing connects beyond loopback, state is kept in a test folder."""

from __future__ import annotations

import gc
import ipaddress
import itertools
import os
import signal
import socket
from enum import IntEnum
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
from hypothesis import is_hypothesis_test, settings

if TYPE_CHECKING:
    from collections.abc import Callable, Generator

MARKERS = (
    "arm64: the processor of the gateways, emulated; `make test-arm64` runs it, once per release",
    "campaign: long tests that `make campaign` runs",
    "slow: takes more than a few seconds; CI runs it as well",
    "namespace: runs in a network namespace of its own and may connect beyond loopback there",
)
MACHINES = ("machine", "gateway", "bundle", "vpn_machine")
"""Folders whose tests start real systemd hosts; a rehearsal in any other test goes without them."""
SYSTEM_PROGRAMS = ("/usr/local/sbin", "/usr/sbin", "/sbin")
_USUAL_S = 120
"""What a test may take; those that may take longer are the longest."""
_SLOW_S = 300
"""A slow test may first wait until another worker has built the computer that both start: minutes on two busy cores."""
ALLOWED_SKIPS = Path(__file__).with_name("allowed-skips.txt")


class Length(IntEnum):
    """How long the longest test of a file takes, by its marks."""

    SHORT = 0
    SLOW = 1
    LONG = 2


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--fault-seeds", default="0:40", help="seeds of the campaign of faults: FIRST:END or a,b,c")
    parser.addoption(
        "--fault-records", type=Path, help="file to which the campaign of faults adds a line for each seed"
    )


def pytest_configure(config: pytest.Config) -> None:
    # A shell makes what it starts in the background ignore Ctrl-C, and what the tests interrupt would inherit that.
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    # Debian's ordinary users do not find what stands beside the programs of everybody: debugfs, sfdisk, openvpn, iw.
    os.environ["PATH"] = os.pathsep.join(dict.fromkeys([*os.environ["PATH"].split(os.pathsep), *SYSTEM_PROGRAMS]))
    for marker in MARKERS:
        config.addinivalue_line("markers", marker)
    # How long an example takes is a matter of what else the machine does: no property of ours is about that.
    settings.register_profile("house", settings.default, deadline=None, max_examples=25)
    settings.register_profile("full", settings.default, deadline=None)
    settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "house"))


def pytest_itemcollected(item: pytest.Item) -> None:
    """With HYPOTHESIS_PROFILE=full, as `make campaign` has it, the tests of properties are part of the campaign."""
    if settings.get_current_profile_name() == "full" and is_hypothesis_test(getattr(item, "obj", None)):
        item.add_marker("campaign")


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Generator[None, object, object]:
    """Look for no garbage among thousands of tests: they live until the end, and so does what they import."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.freeze()
        gc.enable()


@pytest.hookimpl(trylast=True)
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    _deal(config, items)
    for test in items:
        if test.get_closest_marker("slow") is not None and test.get_closest_marker("timeout") is None:
            test.add_marker(pytest.mark.timeout(_SLOW_S))


def _deal(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Deal the files to the workers so that nobody waits for a long test that began last.

    A worker takes its share from the front, and one that has nothing left takes from the end of another's share
    (`--dist worksteal`): the short tests stand there. One worker begins with the longest tests, and builds the computer
    that many of them start; the others come to theirs when it is built.
    """
    workers: int = getattr(config, "workerinput", {}).get("workercount", 1)
    if workers == 1:
        return
    kinds: dict[Length, list[list[pytest.Item]]] = {length: [] for length in Length}
    for _, file in itertools.groupby(items, key=lambda item: item.path):
        tests = [*file]
        kinds[max(map(_length, tests))].append(tests)
    short = [test for file in kinds[Length.SHORT] for test in file]
    dealt: list[pytest.Item] = []
    for number in range(workers):
        order = (Length.LONG, Length.SLOW) if number == 0 else (Length.SLOW, Length.LONG)
        share = [test for length in order for file in kinds[length][number::workers] for test in file]
        missing = max(0, len(items) * (number + 1) // workers - len(dealt) - len(share))
        dealt += [*share, *short[:missing]]
        del short[:missing]
    items[:] = [*dealt, *short]


def _length(test: pytest.Item) -> Length:
    if (timeout := test.get_closest_marker("timeout")) is not None and timeout.args[0] > _USUAL_S:
        return Length.LONG
    return Length.SHORT if test.get_closest_marker("slow") is None else Length.SLOW


def allowed_skips() -> frozenset[str]:
    """The reviewed reasons, word for word; lines that begin with `#` say why each is accepted."""
    lines = ALLOWED_SKIPS.read_text(encoding="utf-8").splitlines() if ALLOWED_SKIPS.exists() else []
    return frozenset(line.strip() for line in lines if line.strip() and not line.startswith("#"))


def _fail_unreviewed_skip(report: pytest.TestReport | pytest.CollectReport) -> None:
    """Turn a skip into a failure where it happens, so that workers of xdist report it like any other."""
    if os.environ.get("CI") != "true" or not report.skipped or hasattr(report, "wasxfail"):
        return
    said = report.longrepr[2] if isinstance(report.longrepr, tuple) else str(report.longrepr)
    reason = said.removeprefix("Skipped: ")
    if reason not in allowed_skips():
        report.outcome = "failed"
        report.longrepr = f"skipped in CI, and its reason is not on the list tests/{ALLOWED_SKIPS.name}: {reason}"


@pytest.hookimpl(wrapper=True, tryfirst=True)
def pytest_runtest_makereport() -> Generator[None, pytest.TestReport, pytest.TestReport]:
    report = yield
    _fail_unreviewed_skip(report)
    return report


@pytest.hookimpl(wrapper=True, tryfirst=True)
def pytest_make_collect_report() -> Generator[None, pytest.CollectReport, pytest.CollectReport]:
    report = yield
    _fail_unreviewed_skip(report)
    return report


def _beyond_loopback(sock: socket.socket, address: Any) -> bool:  # noqa: ANN401 - as socket.connect has it
    if sock.family not in (socket.AF_INET, socket.AF_INET6):
        return False
    host = str(address[0])
    try:
        return not ipaddress.ip_address(host.partition("%")[0]).is_loopback
    except ValueError:
        return host not in ("localhost", "")


def _guarded(connect: Callable[[socket.socket, Any], Any]) -> Callable[[socket.socket, Any], Any]:
    def guarded(sock: socket.socket, address: Any) -> Any:  # noqa: ANN401 - as socket.connect has it
        if _beyond_loopback(sock, address):
            pytest.fail(f"a test connects beyond loopback: {address}")
        return connect(sock, address)

    return guarded


@pytest.fixture(scope="session")
def state_of_tests(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("state")


@pytest.fixture(autouse=True)
def own_state(state_of_tests: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing that a test runs keeps state in the home of whoever runs the tests."""
    monkeypatch.setenv("ATLANTIS_STATE", str(state_of_tests))


@pytest.fixture(autouse=True)
def no_machines(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Rehearse without systemd hosts, unless the test is about them."""
    if request.path.parent.name not in MACHINES:
        monkeypatch.setenv("ATLANTIS_NO_MACHINES", "tests")


@pytest.fixture(autouse=True)
def only_loopback(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Tests reach this machine only, unless they stand in a network namespace of their own."""
    if request.node.get_closest_marker("namespace") is None:
        monkeypatch.setattr(socket.socket, "connect", _guarded(socket.socket.connect))
        monkeypatch.setattr(socket.socket, "connect_ex", _guarded(socket.socket.connect_ex))
