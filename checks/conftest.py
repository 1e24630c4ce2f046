"""Checks of a real site, read from the inventory: `pytest checks/ --site coastal`.

Each check becomes one test a device, so that JUnit, `-k` and reports come from pytest. A site without anything to check
fails: nothing checked is not green.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from atlantis_netcfg.errors import NetcfgError
from atlantis_netcfg.operations.computers import is_gateway
from atlantis_netcfg.operations.kinds import handled
from atlantis_netcfg.site import choose, load
from checks.gateway_promises import Promises, promises
from checks.gateway_reached import Answers, NotReached, ask

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping

    from atlantis_netcfg.site import Declaration, Host

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
DECLARATION: pytest.StashKey[Declaration] = pytest.StashKey()
PROMISES: pytest.StashKey[list[Promises]] = pytest.StashKey()


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--site", required=True, help="the site to check, or `all`")
    parser.addoption("--inventory", type=Path, default=INVENTORY, help="folder of the declaration")


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    hosts = _hosts(metafunc.config)
    if not any(handled(host) or is_gateway(host) for host in hosts):
        raise pytest.UsageError("this site has neither a router nor a gateway: nothing would be checked")
    if "router" in metafunc.fixturenames:
        routers = [host for host in hosts if handled(host)]
        _repeat(metafunc, "router", {host.name: host for host in routers}, "router")
    if "promised" in metafunc.fixturenames:
        _parametrize(metafunc, _promises(metafunc.config, hosts))


def _parametrize(metafunc: pytest.Metafunc, promised: list[Promises]) -> None:
    """One test a gateway, or one for each of its items."""
    kind = next((kind for kind in ITEMS if kind in metafunc.fixturenames), None)
    if kind is None:
        _repeat(metafunc, "promised", {one.host.name: one for one in promised}, "gateway")
    else:
        rows = {f"{one.host.name}:{item}": (one, item) for one in promised for item in ITEMS[kind](one)}
        _repeat(metafunc, f"promised,{kind}", rows, f"gateway with a {kind}")


def _repeat(metafunc: pytest.Metafunc, names: str, rows: Mapping[str, object], what: str) -> None:
    """One test a row; without any, one that says why nothing is checked."""
    none = [None] * len(names.split(","))
    why = pytest.mark.skip(reason=f"this site has no {what}")
    metafunc.parametrize(names, list(rows.values()) or [pytest.param(*none, marks=why)], ids=list(rows) or ["none"])


def _declaration(config: pytest.Config) -> Declaration:
    """Loaded once."""
    if DECLARATION not in config.stash:
        config.stash[DECLARATION] = load(config.getoption("--inventory"))
    return config.stash[DECLARATION]


def _hosts(config: pytest.Config) -> tuple[Host, ...]:
    try:
        return choose(_declaration(config), config.getoption("--site"))
    except NetcfgError as error:
        raise pytest.UsageError(f"{error}\n{error.hint or ''}") from error


def _promises(config: pytest.Config, hosts: tuple[Host, ...]) -> list[Promises]:
    """Worked out once; the same objects for every check."""
    if PROMISES not in config.stash:
        declaration = _declaration(config)
        config.stash[PROMISES] = [promises(declaration, host) for host in hosts if is_gateway(host)]
    return config.stash[PROMISES]


@pytest.fixture
def inventory(request: pytest.FixtureRequest) -> Path:
    """The folder of the declaration, as given."""
    folder: Path = request.config.getoption("--inventory")
    return folder


@pytest.fixture(scope="session")
def asked() -> dict[str, Answers | str]:
    """What each gateway has answered, or why it has not: none is asked twice."""
    return {}


@pytest.fixture
def answers(promised: Promises, asked: dict[str, Answers | str], request: pytest.FixtureRequest) -> Answers:
    """The answers of the gateway of this test. Without them nothing is known of it: an error, not a failure."""
    name = promised.host.name
    if name not in asked:
        try:
            asked[name] = ask(_declaration(request.config), promised, request.config.getoption("ssh_config"))
        except NotReached as why:
            asked[name] = str(why)
    found = asked[name]
    if isinstance(found, str):
        pytest.fail(found, pytrace=False)
    return found
