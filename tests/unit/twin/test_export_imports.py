"""Exports of other people's devices, each imported into a twin of its device: what is refused is listed by line."""

from __future__ import annotations

import re
from functools import cache
from pathlib import Path

import pytest
from export_imports import Cause, Imported, figures, imported, lines_of, row, spec_of

from atlantis_netcfg.emulator.routeros.boot import SYSTEM
from atlantis_netcfg.emulator.routeros.console.run import run_file
from atlantis_netcfg.emulator.routeros.device import Device

CHECKOUT = Path(__file__).parents[3]
FOLDERS = (CHECKOUT / "tests" / "data" / "exports", CHECKOUT.parent / "shared" / "data" / "routeros-exports")
"""Ours, and more of them beside the checkout where somebody has put them."""
FILES = sorted(path for folder in FOLDERS for path in folder.glob("*.rsc"))
LISTED = [
    line
    for folder in FOLDERS
    if (folder / "refused.tsv").exists()
    for line in (folder / "refused.tsv").read_text(encoding="utf-8").splitlines()
]
"""File, line, menu, cause (`export_imports.Cause`), words of the twin, and what the line says."""
_FIRST_NAME = re.compile(r"(?<= )(?=[a-z][a-z.-]*=)")
_UNKNOWN = ("expected end of command", "bad parameter", "bad command name", "not rehearsed", "syntax error")

named = pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)


def text_of(path: Path) -> str:
    return path.read_text(encoding="utf-8")


@cache
def result_of(path: Path) -> Imported:
    return imported(text_of(path))


@named
def test_what_is_refused_is_listed(path: Path) -> None:
    found = [row(path.name, refusal) for refusal in result_of(path).refusals]
    assert found == [line for line in LISTED if line.startswith(f"{path.name}\t")]


def test_of_a_hundred_lines_in_menus_of_the_templates_at_most_one_is_refused() -> None:
    total = figures(map(result_of, FILES))["all"]
    assert total["exports"] == len(FILES) > 1
    assert total["template_lines"] > 0
    assert total[f"template: {Cause.FALSE}"] <= total["template_lines"] / 100
    assert {line.partition("\t")[0] for line in LISTED} <= {path.name for path in FILES}


@named
def test_what_the_twin_exports_goes_in_again_and_comes_out_the_same(path: Path) -> None:
    first = result_of(path).device.export(show_sensitive=True)
    again = Device(spec_of(text_of(path)), lambda: 1000.0)
    for line in lines_of(first):
        if "atlantis: management" not in line.text:
            assert run_file(again.core, SYSTEM, f"{line.menu}\n{line.text}").error is None, line
    assert bare(again.export(show_sensitive=True)) == bare(first)


def bare(text: str) -> list[str]:
    """The lines without the header, which holds the time."""
    return [line for line in text.splitlines() if not line.startswith("#")]


@named
def test_a_misspelt_argument_is_refused_on_every_line(path: Path) -> None:
    device = Device(spec_of(text_of(path)), lambda: 1000.0)
    for line in lines_of(text_of(path)):
        misspelt, count = _FIRST_NAME.subn("x-", line.text.replace("[ find default", "[ find-default"), count=1)
        if count:
            error = run_file(device.core, SYSTEM, f"{line.menu}\n{misspelt}").error
            assert error is not None, misspelt
            assert error.startswith(_UNKNOWN), misspelt


@named
def test_its_source_and_licence_are_noted(path: Path) -> None:
    assert f"`{path.name}`" in path.with_name("README.md").read_text(encoding="utf-8")
