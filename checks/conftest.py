"""Checks of a real site, read from the inventory: `pytest checks/ --site coastal`.

Each check becomes one test a device, and each item of the pre-test checklist one test, so that JUnit, `-k` and reports
come from pytest. A site without anything to check fails: nothing checked is not green. Narrowed to vehicles or
endpoints, or rehearsed, it is the checklist alone.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from atlantis_netcfg.checklist import Scope
from atlantis_netcfg.core.errors import NetcfgError
from atlantis_netcfg.core.events import Verdict
from atlantis_netcfg.core.printable import lines
from atlantis_netcfg.inventory import choose, load
from atlantis_netcfg.inventory.model import ServerComputer
from atlantis_netcfg.operations.common.kinds import is_supported
from atlantis_netcfg.operations.common.request import refuse_examples
from checks.checklist_asked import Asking, How, answer_lines, waits
from checks.gateway_promises import Promises, promises
from checks.gateway_reached import Answers, NotReached, ask

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping

    from atlantis_netcfg.checklist import PlanEntry
    from atlantis_netcfg.checklist.report import Item
    from atlantis_netcfg.inventory import Host, Inventory

INVENTORY = Path(__file__).resolve().parent.parent / "inventory"
ITEMS: Mapping[str, Callable[[Promises], Iterable[str]]] = {
    "path": lambda promised: promised.files,
    "link": lambda promised: promised.links,
    "folder": lambda promised: promised.folders,
    "absent": lambda promised: promised.absent,
    "package": lambda promised: promised.packages,
    "unit": lambda promised: promised.units,
    "reader": lambda promised: promised.readers,
}
"""What a check of a gateway is repeated for."""
DECLARATION: pytest.StashKey[Inventory] = pytest.StashKey()
ASKING: pytest.StashKey[Asking] = pytest.StashKey()
PROMISES: pytest.StashKey[list[Promises]] = pytest.StashKey()


def pytest_addoption(parser: pytest.Parser, pluginmanager: pytest.PytestPluginManager) -> None:
    parser.addoption("--site", required=True, help="the site to check, or `all`")
    parser.addoption("--inventory", type=Path, default=INVENTORY, help="folder of the declaration")
    group = parser.getgroup("checklist", "pre-test checklist")
    group.addoption("--vehicle", action="append", default=[], help="only these vehicles, as `sparus,zarco`")
    group.addoption("--endpoint", action="append", default=[], help="only these columns of Table 3, as `wifi,gps`")
    group.addoption("--rehearse", action="store_true", help="ask emulated vehicles and devices of the site")
    group.addoption("--via", help="the bearer over which you work, where it is not the declared one")
    group.addoption("--accept-cost", action="store_true", help="pay for what goes over a link paid by the byte")
    if not pluginmanager.hasplugin("timeout"):  # a fresh checkout has no pytest-timeout, and its settings are strict
        parser.addini("timeout", "ignored without pytest-timeout")


def pytest_configure(config: pytest.Config) -> None:
    config.addinivalue_line("markers", "timeout(seconds): how long a test may take, where pytest-timeout is installed")


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    if "entry" in metafunc.fixturenames:
        asking = _asking(metafunc.config)
        entries = {asking.name(entry): entry for entry in asking.entries()}
        metafunc.parametrize("entry", list(entries.values()), ids=list(entries))
        return
    hosts = _hosts(metafunc.config)
    if not any(is_supported(host) or isinstance(host.device, ServerComputer) for host in hosts):
        raise pytest.UsageError(
            "this site has neither a router nor a gateway nor a control centre: nothing would be checked"
        )
    if "router" in metafunc.fixturenames:
        routers = [host for host in hosts if is_supported(host)]
        _repeat(metafunc, "router", {host.name: host for host in routers}, "router")
    if "promised" in metafunc.fixturenames:
        _parametrize(metafunc, _promises(metafunc.config, hosts))


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """Leave out the suites of gateways and routers where the checklist alone is asked for: they know no vehicles."""
    alone = bool(config.getoption("vehicle") or config.getoption("endpoint") or config.getoption("rehearse"))
    return True if alone and collection_path.name in {"test_gateways.py", "test_routers.py"} else None


def _parametrize(metafunc: pytest.Metafunc, promised: list[Promises]) -> None:
    """One test a gateway, or one for each of its items."""
    kind = next((kind for kind in ITEMS if kind in metafunc.fixturenames), None)
    if kind is None:
        _repeat(metafunc, "promised", {entry.host.name: entry for entry in promised}, "gateway")
    else:
        rows = {
            f"{promises.host.name}:{item}": (promises, item) for promises in promised for item in ITEMS[kind](promises)
        }
        _repeat(metafunc, f"promised,{kind}", rows, f"gateway with a {kind}")


def _repeat(metafunc: pytest.Metafunc, names: str, rows: Mapping[str, object], what: str) -> None:
    """One test a row; without any, one that says why nothing is checked."""
    none = [None] * len(names.split(","))
    why = pytest.mark.skip(reason=f"this site has no {what}")
    metafunc.parametrize(names, list(rows.values()) or [pytest.param(*none, marks=why)], ids=list(rows) or ["none"])


def _declaration(config: pytest.Config) -> Inventory:
    """Loaded once."""
    if DECLARATION not in config.stash:
        config.stash[DECLARATION] = load(config.getoption("--inventory"))
    return config.stash[DECLARATION]


def _asking(config: pytest.Config) -> Asking:
    """The checklist, worked out once."""
    if ASKING not in config.stash:
        how = How(
            config.getoption("--inventory"),
            config.getoption("rehearse"),
            config.getoption("accept_cost"),
            config.getoption("via"),
            config.getoption("ssh_config"),
        )
        scope = Scope(_words(config, "vehicle"), _words(config, "endpoint"))
        try:
            config.stash[ASKING] = Asking.of(_declaration(config), how, config.getoption("--site"), scope)
            if how.ssh_config is None:
                refuse_examples(_declaration(config), is_rehearsal=how.rehearse)
        except NetcfgError as error:
            raise pytest.UsageError(f"{error}\n{error.hint or ''}") from error
    return config.stash[ASKING]


def _words(config: pytest.Config, name: str) -> tuple[str, ...]:
    return tuple(word for typed in config.getoption(name) for word in typed.split(",") if word)


def _hosts(config: pytest.Config) -> tuple[Host, ...]:
    try:
        return choose(_declaration(config), config.getoption("--site"))
    except NetcfgError as error:
        raise pytest.UsageError(f"{error}\n{error.hint or ''}") from error


def _promises(config: pytest.Config, hosts: tuple[Host, ...]) -> list[Promises]:
    """Worked out once; the same objects for every check."""
    if PROMISES not in config.stash:
        declaration = _declaration(config)
        config.stash[PROMISES] = [
            promises(declaration, host) for host in hosts if isinstance(host.device, ServerComputer)
        ]
    return config.stash[PROMISES]


def pytest_collection_finish(session: pytest.Session) -> None:
    """What is selected is what is asked."""
    if ASKING in session.config.stash:
        asking = session.config.stash[ASKING]
        entries = [item.callspec.params.get("entry") for item in session.items if hasattr(item, "callspec")]
        asking.selected |= {asking.name(entry) for entry in entries if entry is not None}


@pytest.fixture
def found(entry: PlanEntry, request: pytest.FixtureRequest) -> Item:
    """What is known of an item. What could not be asked is an error, what nobody has answered is skipped."""
    try:
        item = _asking(request.config).item(entry)
    except NetcfgError as error:
        pytest.fail(f"{error}\n{error.hint or ''}", pytrace=False)
    request.node.user_properties += answer_lines(item)
    if item.verdict is Verdict.ERROR and item.override is None:
        pytest.fail(item.message, pytrace=False)
    if item.open or item.counts is Verdict.SKIP:
        pytest.skip(waits(item))
    return item


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Warnings of the checklist, which passes with them."""
    reports = terminalreporter.getreports("passed")
    warned = [result for result in (dict(report.user_properties) for report in reports) if "warning" in result]
    if warned:
        terminalreporter.section("warnings of the checklist")
        terminalreporter.write("".join(f"{values['item']}: {values['warning']}\n" for values in warned))


def pytest_sessionfinish(session: pytest.Session, exitstatus: int) -> None:
    """A run in which nothing was proved is not green."""
    reporter = session.config.pluginmanager.get_plugin("terminalreporter")
    if exitstatus == pytest.ExitCode.OK and reporter is not None and not reporter.getreports("passed"):
        session.exitstatus = pytest.ExitCode.NO_TESTS_COLLECTED


@pytest.fixture
def inventory(request: pytest.FixtureRequest) -> Path:
    """The folder of the declaration, as given."""
    folder: Path = request.config.getoption("--inventory")
    return folder


@pytest.fixture(scope="session")
def answers_by_gateway() -> dict[str, Answers | str]:
    """What each gateway has answered, or why it has not: none is asked twice."""
    return {}


@pytest.fixture
def answers(
    promised: Promises, answers_by_gateway: dict[str, Answers | str], request: pytest.FixtureRequest
) -> Answers:
    """The answers of the gateway of this test. Without them nothing is known of it: an error, not a failure."""
    name = promised.host.name
    if name not in answers_by_gateway:
        try:
            answers_by_gateway[name] = ask(
                _declaration(request.config), promised, request.config.getoption("ssh_config")
            )
        except NotReached as why:
            answers_by_gateway[name] = str(why)
    found = answers_by_gateway[name]
    if isinstance(found, str):
        pytest.fail(lines(found), pytrace=False)
    return found
