"""`print` of every menu that a version has: it answers, twice the same, and never with a fault of ours."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest
from shell_bench import PASSWORD, TECHNICIAN, Bench

if TYPE_CHECKING:
    from collections.abc import Iterator

    from atlantis_netcfg.emulator.routeros.schema import Schema

FORMS = ("print", "print detail", "print terse", "print count-only", "print where comment=x", ":put [print as-value]")


def menus(schema: Schema, menu: str = "/") -> Iterator[str]:
    for name in sorted(schema.submenus(menu)):
        below = f"{menu.rstrip('/')}/{name}"
        if schema.has_command(below, "print"):
            yield below
        yield from menus(schema, below)


@pytest.mark.parametrize("version", ["6.49.10", "7.16", "7.21.5"])
def test_every_menu(version: str) -> None:
    bench = Bench(version=version)
    caller = bench.device.login("admin", PASSWORD, via="ssh", address=TECHNICIAN)
    before, found = bench.text(), list(menus(bench.device.core.schema))
    assert len(found) > 100
    for menu in found:
        place = menu.replace("/", " ").strip()
        for form in FORMS:
            line = f"/{place} {form}" if not form.startswith(":") else f":put [/{place} print as-value]"
            first = bench.device.type(caller, line, width=80)
            assert bench.device.type(caller, line, width=80) == first
    assert bench.text() == before
