"""Hundreds of sites: loading and validating them takes work in proportion, whatever the machine."""

from __future__ import annotations

import cProfile
import pstats
from pathlib import Path

from atlantis_netcfg.declaration import load
from atlantis_netcfg.render import router
from bench.many import many, name

INVENTORY = Path(__file__).parents[3] / "inventory"


def work(folder: Path, number: int) -> int:
    """How many calls loading takes; every ship is in it and can be rendered."""
    place = many(INVENTORY, folder / f"of-{number}", number)
    with cProfile.Profile() as profile:
        declaration = load(place)
    ships = [declaration.hosts[f"{name(each)}-router"] for each in range(number)]
    assert len({router(declaration, ship) for ship in ships[:3]}) == min(number, 3)
    return int(pstats.Stats(profile).total_calls)  # type: ignore[attr-defined]


def test_the_work_grows_with_the_sites_and_not_with_their_square(tmp_path: Path) -> None:
    few, some, more = (work(tmp_path, number) for number in (10, 40, 80))
    assert more - some < 2.0 * 40 / 30 * (some - few)
