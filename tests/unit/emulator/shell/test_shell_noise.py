"""Whatever is typed, however it is cut: the console answers in its own words and shows the same."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st
from shell_bench import PASSWORD, TECHNICIAN, Bench

from atlantis_netcfg.emulator.routeros.schema import Schema

WORDS = (
    *("/ip address", "print", " ", "where", "name", "=", "~", '"', "[", "]", "find", "\\", "$x", ":put"),
    *("detail", "terse", "as-value", "count-only", "/interface", "/system/resource", "..", "/"),
    *("set 0 comment=a", "remove", "export", "/file", "proplist=name", "!", "or", "(", ";", "{", "}", ":do"),
    *("on-error=", "\r", "\n", "\t", "\x03", "\x15", "\x18", "d", "y", "\x1b[A", "\x1b[D", "\x1b[3~"),
    *("\x1b[24;80R", "é"),
)
TYPED = st.lists(st.sampled_from(WORDS), max_size=25).map("".join)
LOGINS = st.sampled_from(["admin+cet80w", "admin+ct30w5h", "admin", "fresh+cet40w", "guest+ct200w"])


def shown(login: str, text: str, *, cut: bool) -> tuple[str, str]:
    bench = Bench()
    terminal = bench.terminal(login)
    return terminal.shown() + terminal.type(text, cut=cut), bench.text()


@settings(max_examples=60)
@given(login=LOGINS, text=TYPED)
def test_output_is_the_same_whole_or_byte_by_byte(login: str, text: str) -> None:
    assert shown(login, text, cut=False) == shown(login, text, cut=True)


@settings(max_examples=60)
@given(data=st.binary(max_size=60))
def test_any_bytes(data: bytes) -> None:
    text = data.decode(errors="surrogateescape")
    assert shown("admin+ct80w", text, cut=False) == shown("admin+ct80w", text, cut=True)


# `print` of every menu that a version has: it answers, twice the same, and never with a fault of ours.


FORMS = ("print", "print detail", "print terse", "print count-only", "print where comment=x", ":put [print as-value]")


def menus(schema: Schema, menu: str = "/") -> Iterator[str]:
    for name in sorted(schema.submenus(menu)):
        below = f"{menu.rstrip('/')}/{name}"
        if schema.has_command(below, "print"):
            yield below
        yield from menus(schema, below)


@pytest.mark.parametrize("version", ["6.49.10", "7.16", "7.21.5"])
def test_every_menu_prints_the_same_twice_and_changes_nothing(version: str) -> None:
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


# What a terminal sends and what it is shown, as cases of data; each is replayed whole and byte by byte.


CASES: dict[str, dict[str, Any]] = {
    f"{file.stem}: {name}": case
    for file in sorted((Path(__file__).parent / "cases").glob("*.yml"))
    for name, case in yaml.safe_load(file.read_text(encoding="utf-8")).items()
}


def played(case: dict[str, Any], *, cut: bool) -> list[str]:
    """What is shown at first, and after each thing typed."""
    bench = Bench(**case.get("spec", {}))
    terminal = bench.terminal(case.get("login", "admin+cet80w"), sized=case.get("sized", True))
    return [terminal.shown(), *(terminal.type(step["type"], cut=cut) for step in case["steps"])]


@pytest.mark.parametrize("cut", [False, True], ids=["whole", "byte by byte"])
@pytest.mark.parametrize("name", CASES)
def test_case(name: str, cut: bool) -> None:  # noqa: FBT001 (a parameter of the test)
    case = CASES[name]
    greeting, *shown = played(case, cut=cut)
    if "greeting" in case:
        assert greeting == case["greeting"]
    assert shown == [step["shown"] for step in case["steps"]]
