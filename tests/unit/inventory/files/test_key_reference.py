from pathlib import Path
from typing import TYPE_CHECKING

from atlantis_netcfg.inventory import _schema
from atlantis_netcfg.inventory.key_reference import text
from atlantis_netcfg.inventory.model import Partner, Pilot, Site, Vehicle

if TYPE_CHECKING:
    from pydantic import BaseModel

CHECKOUT = Path(__file__).parents[4]
PAGE = (CHECKOUT / "docs/inventory.md").read_text(encoding="utf-8")
ROWS = [[cell.strip() for cell in line.split(" | ")] for line in PAGE.splitlines() if line.startswith("| `")]


def test_page_matches_the_model() -> None:
    assert text(CHECKOUT / "inventory") == PAGE, "write it: python -m atlantis_netcfg.inventory.key_reference"


def test_every_row_has_a_type_a_default_a_meaning_and_an_example() -> None:
    rows = [row for row in ROWS if len(row) == 6]
    assert len(rows) > 250
    assert [row[0] for row in rows if not all((row[1], row[3], row[4], row[5].strip("`| ")))] == []


def test_every_key_of_every_file_has_a_row() -> None:
    named = {row[0].strip("|` ") for row in ROWS}
    models: list[type[BaseModel]] = [Pilot, Partner, Vehicle, Site, *_schema.DEVICES.values()]
    assert [key for model in models for key in model.model_fields if key not in named] == []


def test_units_are_derived_from_key_names() -> None:
    units = {row[0].strip("|` "): row[2] for row in ROWS if len(row) == 6}
    expected = {
        "rtt_ms": "ms",
        "up_kbps": "kbit/s",
        "cap_mb": "10⁶ bytes",
        "price_per_mb": "currency/10⁶ bytes",
        "floor_bytes_per_s": "bytes/s",
        "hold_down_s": "s",
        "tx_power_dbm": "dBm",
        "width_mhz": "MHz",
        "lease_minutes": "min",
        "latitude": "°",
        "radius_m": "m",
        "port": "",
    }
    assert {key: units[key] for key in expected} == expected


def test_bounds_match_the_model() -> None:
    row = next(row for row in ROWS if "hold_down_s" in row[0])
    assert row[1] == "whole number (20 or more, at most 600)"
    assert row[3] == "`20`"
