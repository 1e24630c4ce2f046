"""The mock robots of the shipped inventory, at an address for so many seconds: `robots_there.py ADDRESS SECONDS`.

Their names are of the example; addresses are of a network namespace.
"""

import sys
from collections.abc import Sequence
from pathlib import Path

from atlantis_netcfg.inventory import load
from atlantis_netcfg.operations.robots import MockPlace, computers_of, mock
from atlantis_netcfg.robots.mock import MockRobot


def tell(robots: Sequence[MockRobot]) -> None:
    sys.stdout.write(f"{len(robots)} robots\n")
    sys.stdout.flush()


if __name__ == "__main__":
    declaration = load(Path(__file__).parents[3] / "inventory")
    place = MockPlace(sys.argv[1], computers_of(declaration, ["coastal"]))
    mock(declaration, (), place, float(sys.argv[2]), tell)
