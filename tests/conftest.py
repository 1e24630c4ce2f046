"""Rules for every test: unreviewed skips fail CI, nothing connects beyond loopback, state is kept in a test folder."""

from __future__ import annotations

import asyncio
import gc
import inspect
import ipaddress
import os
import re
import signal
import socket
from argparse import ArgumentTypeError
from collections import defaultdict
from contextlib import suppress
from enum import StrEnum
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
from hypothesis import is_hypothesis_test, settings

from atlantis_netcfg.core import paths

if TYPE_CHECKING:
    from collections.abc import Callable, Generator, Iterator, Mapping

    from atlantis_netcfg.inventory import Inventory

MARKERS = (
    "arm64: the processor of the gateways, emulated; `make test-arm64` runs it, once per release",
    "coroutine(run=): a test that is a coroutine, and what runs it in place of asyncio.run",
    "campaign: long tests that `make campaign` runs",
    "slow: takes more than a few seconds; `make test-full` runs it, and CI in one of its shards",
    "smoke(*cases): of a slow test, or of many cases, what `make test` runs too: one of each command and counterpart",
    "namespace: runs in a network namespace of its own and may connect beyond loopback there",
)
MACHINES = ("emulator/lab", "computers/gateway", "computers/bundle", "vpn/server")
"""Folders whose tests start real systemd hosts; a rehearsal in any other test goes without them."""
SYSTEM_PROGRAMS = ("/usr/local/sbin", "/usr/sbin", "/sbin")
COSTS = Path(__file__).with_name("costs.tsv")
"""CPU seconds of the test files that cost most, measured by `make costs`: file, in `make test`, in the rest."""
_UNLISTED_S = 0.2
"""What a file costs that is not listed there, about."""
ALLOWED_SKIPS = Path(__file__).with_name("allowed-skips.txt")


class Tier(StrEnum):
    """What runs when; each test is in exactly one."""

    TEST = "test"
    """`make test`: everything that is quick, and each command and real counterpart once."""
    REST = "rest"
    """What `make test-full` adds. CI runs one shard of it, chosen by the commit."""
    CAMPAIGN = "campaign"
    """`make campaign`."""
    ARM64 = "arm64"
    """`make test-arm64`."""

    @classmethod
    def of(cls, test: pytest.Item) -> Tier:
        """Read the tier off the marks of a test."""
        marks = {mark.name for mark in test.iter_markers()}
        for tier in (cls.ARM64, cls.CAMPAIGN):
            if tier in marks:
                return tier
        if not marks & {"slow", "smoke"}:
            return cls.TEST
        case = test.name.partition("[")[2].removesuffix("]")
        is_smoke = any(case in mark.args or not mark.args for mark in test.iter_markers("smoke"))
        return cls.TEST if is_smoke else cls.REST


def file_costs() -> dict[str, dict[Tier, float]]:
    """CPU seconds of each listed file, by tier; paths as they stand below the checkout."""
    rows = [line.split("\t") for line in COSTS.read_text().splitlines()[1:]] if COSTS.exists() else []
    return {path: {Tier.TEST: float(test), Tier.REST: float(rest)} for path, test, rest in rows}


def share_out(costs: Mapping[str, float], shards: int) -> list[set[str]]:
    """Share out files, the dearest first, each to the shard that has the least so far."""
    shares: list[tuple[float, set[str]]] = [(0.0, set()) for _ in range(shards)]
    for path in sorted(costs, key=lambda path: (-costs[path], path)):
        number = min(range(shards), key=lambda number: shares[number][0])
        cost, paths = shares[number]
        shares[number] = (cost + costs[path], paths | {path})
    return [paths for _, paths in shares]


@cache
def _rest_files(config: pytest.Config) -> tuple[set[str], set[str]]:
    """The files with a mark of the tier `rest` in their text, and those of the requested shard."""
    folders = [config.rootpath / folder for folder in config.getini("testpaths") or ["."]]
    paths = [path for folder in folders for path in folder.rglob("test_*.py")]
    marked = [path for path in paths if re.search(r"\bmark\.(slow|smoke)\b", path.read_text(encoding="utf-8"))]
    names = [path.relative_to(config.rootpath).as_posix() for path in marked]
    costs = file_costs()
    number, shards = config.getoption("--shard")
    rest = {name: max(_UNLISTED_S, costs.get(name, {}).get(Tier.REST, 0.0)) for name in names}
    return set(names), share_out(rest, shards)[number - 1]


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """Do not even import what a shard of the tier `rest` leaves out."""
    if config.getoption("--tier") != [Tier.REST] or collection_path.suffix != ".py":
        return None
    return collection_path.relative_to(config.rootpath).as_posix() not in _rest_files(config)[1] or None


def _shard(text: str) -> tuple[int, int]:
    if (parts := re.fullmatch(r"(\d+)/(\d+)", text)) and 1 <= int(parts[1]) <= int(parts[2]):
        return int(parts[1]), int(parts[2])
    raise ArgumentTypeError(f"`{text}` is no shard; write K/N, with K from 1 to N")


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--tier", action="append", type=Tier, choices=[*Tier], help="run the tests of this tier only")
    parser.addoption("--shard", type=_shard, default=(1, 1), help="of the tier `rest` run shard K of N only: K/N")
    parser.addoption("--costs", type=Path, help="write the CPU seconds of each test file to this file")
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
    if (path := config.getoption("--costs")) is not None:
        config.pluginmanager.register(Costs(path))
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
    """Keep the requested tiers; put the dearest files first, so that none of them begins last."""
    tiers = config.getoption("--tier")
    costs = file_costs()

    def cost(path: str, *of: Tier) -> float:
        listed = costs.get(path, {})
        return max(_UNLISTED_S, sum(listed.get(tier, 0.0) for tier in of))

    if tiers:
        tier_of = {test: Tier.of(test) for test in items}
        marked, shard = _rest_files(config)
        if stray := {_file(test) for test, tier in tier_of.items() if tier is Tier.REST} - marked:
            raise pytest.UsageError(f"`mark.slow` or `mark.smoke` has to stand in the file itself: {sorted(stray)}")
        kept = [
            test for test, tier in tier_of.items() if tier in tiers and (tier is not Tier.REST or _file(test) in shard)
        ]
        config.hook.pytest_deselected(items=[*(tier_of.keys() - set(kept))])
        items[:] = kept
    items.sort(key=lambda test: (-cost(_file(test), *(tiers or ())), _file(test)))


@pytest.hookimpl(tryfirst=True)
def pytest_pyfunc_call(pyfuncitem: pytest.Function) -> bool | None:
    """Run a test that is a coroutine."""
    test = pyfuncitem.obj
    if not inspect.iscoroutinefunction(test):
        return None
    mark = pyfuncitem.get_closest_marker("coroutine")
    run = mark.kwargs["run"] if mark else asyncio.run
    run(test(**{name: pyfuncitem.funcargs[name] for name in inspect.signature(test).parameters}))
    return True


def _file(test: pytest.Item) -> str:
    return test.nodeid.partition("::")[0]


def cpu_s() -> float:
    """CPU seconds of this process and of the programs that it has started, and of those they have waited for."""
    ticks = 0
    for path in Path("/proc").glob("[0-9]*/stat"):
        with suppress(OSError):
            fields = path.read_text().rpartition(")")[2].split()
            if int(fields[1]) == os.getpid():
                ticks += sum(map(int, fields[11:15]))
    return sum(os.times()[:4]) + ticks / os.sysconf("SC_CLK_TCK")


class Costs:
    """The CPU seconds of each test file."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.last = cpu_s()
        self.sums: defaultdict[str, defaultdict[str, float]] = defaultdict(lambda: defaultdict(float))

    @pytest.hookimpl(tryfirst=True)
    def pytest_runtest_logstart(self) -> None:
        self.last = cpu_s()

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_makereport(self, item: pytest.Item) -> Generator[None, pytest.TestReport, pytest.TestReport]:
        report = yield
        before, self.last = self.last, cpu_s()
        report.user_properties.append((f"cpu-{Tier.of(item)}", self.last - before))
        return report

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        for name, seconds in report.user_properties:
            if name.startswith("cpu-"):
                self.sums[report.nodeid.partition("::")[0]][name.removeprefix("cpu-")] += float(str(seconds))

    def pytest_sessionfinish(self, session: pytest.Session) -> None:
        if hasattr(session.config, "workerinput"):
            return
        dearest = {path: sums for path, sums in self.sums.items() if sum(sums.values()) > 1}
        lines = [f"{path}\t{sums[Tier.TEST]:.1f}\t{sums[Tier.REST]:.1f}" for path, sums in sorted(dearest.items())]
        self.path.write_text("\n".join(["file\ttest\trest", *lines, ""]))


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


@pytest.fixture(autouse=True, scope="session")
def weak_seals() -> Iterator[None]:
    """Seal with a passphrase at once; tests/unit/vpn/pki/test_pki_seal.py asks for the real strength."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("atlantis_netcfg.vpn.pki.age_file.WORK_FACTOR", 4)
        yield


@pytest.fixture(scope="session")
def declaration() -> Inventory:
    """Return the shipped inventory."""
    from atlantis_netcfg.inventory import load  # noqa: PLC0415 - a run of other tests does without

    return load(Path(__file__).parents[1] / "inventory")


@pytest.fixture
def portuguese() -> Generator[None, None, None]:
    from atlantis_netcfg.core import language  # noqa: PLC0415 - as above

    language.use(language.Language.PORTUGUESE)
    yield
    language.use(language.Language.ENGLISH)


@pytest.fixture(autouse=True)
def no_machines(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Rehearse without systemd hosts, unless the test is about them."""
    if "/".join(request.path.parts[-3:-1]) not in MACHINES:
        monkeypatch.setenv("ATLANTIS_NO_MACHINES", "tests")


@pytest.fixture(autouse=True)
def only_loopback(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Tests reach this machine only, unless they stand in a network namespace of their own."""
    if request.node.get_closest_marker("namespace") is None:
        monkeypatch.setattr(socket.socket, "connect", _guarded(socket.socket.connect))
        monkeypatch.setattr(socket.socket, "connect_ex", _guarded(socket.socket.connect_ex))


@pytest.fixture(autouse=True)
def no_unfinished_command() -> Iterator[None]:
    """A command that a test kills in this process leaves its id behind; the runs of later tests would have it."""
    yield
    os.environ.pop(paths.INVOCATION, None)
