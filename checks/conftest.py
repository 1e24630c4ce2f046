"""Checks of a real site, read from the inventory: `pytest checks/ --site coastal`.

Each check becomes one test a device, so that JUnit, `-k` and reports come from pytest. A site without anything to check
fails: nothing checked is not green.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from atlantis_netcfg.errors import NetcfgError
from atlantis_netcfg.operations.kinds import handled
from atlantis_netcfg.site import choose, load

if TYPE_CHECKING:
    from atlantis_netcfg.site import Host

INVENTORY = Path(__file__).resolve().parent.parent / "inventory"


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--site", required=True, help="the site to check, or `all`")
    parser.addoption("--inventory", type=Path, default=INVENTORY, help="folder of the declaration")


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    if "router" in metafunc.fixturenames:
        hosts = [host for host in _hosts(metafunc.config) if handled(host)]
        if not hosts:
            raise pytest.UsageError("this site has no router: nothing would be checked")
        metafunc.parametrize("router", hosts, ids=[host.name for host in hosts])


def _hosts(config: pytest.Config) -> tuple[Host, ...]:
    try:
        return choose(load(config.getoption("--inventory")), config.getoption("--site"))
    except NetcfgError as error:
        raise pytest.UsageError(f"{error}\n{error.hint or ''}") from error


@pytest.fixture
def inventory(request: pytest.FixtureRequest) -> Path:
    """The folder of the declaration, as given."""
    folder: Path = request.config.getoption("--inventory")
    return folder
