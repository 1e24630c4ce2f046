"""Whole exports: printing what was read loses nothing, going by a reader that is not ours, and is stable."""

from functools import cache
from pathlib import Path

import pytest
from export_tokens import told
from hypothesis import given, settings
from hypothesis import strategies as st
from row_subtests import for_each_row
from rsc_strategies import exports

from atlantis_netcfg.emulator.routeros import Device, RouterSpec
from atlantis_netcfg.routeros.rsc import Export, RscError, parse, print_export

HERE = Path(__file__).parent
ROOT = HERE.parents[3]
BESIDE = ROOT.parent / "shared" / "data"
FOLDERS = (HERE / "golden", ROOT / "tests" / "data" / "exports", BESIDE / "routeros-exports", BESIDE / "public-exports")
"""Ours, and where exports of other people's devices are put; `.in.rsc` are texts that no device prints like that."""
VERSIONS = ("6.49.18", "7.12.2", "7.16", "7.18.2", "7.21.5")
FORMS = ("compact", "verbose", "terse")

SEED = """
/interface bridge
add comment="a b \\"c\\" \\$d \\\\ \\?" name=bridge1
/interface bridge port
add bridge=bridge1 comment="Mu\\C3\\B1oz \\E2\\80\\94 na\\C3\\AFve" interface=ether2
/ip address
add address=192.0.2.1/24 interface=bridge1
/ip firewall filter
add action=accept chain=input comment="one, two, three, four, five, six, seven, eight, nine, ten, eleven, twelve, \\
    thirteen" connection-state=established,related dst-port=22,80,443,8000-8100 protocol=tcp src-address=!192.0.2.9
add action=drop chain=input log-prefix="x=y; [z]"
/ip firewall address-list
add address=198.51.100.0/24 list="a list"
/ip dns static
add address=192.0.2.7 comment="line one\\r\\nline two\\nline three, whose tail makes it long enough to be wrapped" \\
    name=host.example.org ttl=5m
"""


@cache
def twin_exports() -> dict[str, str]:
    """What twins of several versions print of one configuration, in every form."""
    found = {}
    for version in VERSIONS:
        device = Device(RouterSpec(name="router", version=version, seed=SEED), lambda: 0.0)
        for form in FORMS:
            found[f"twin-{version}-{form}"] = device.export(verbose=form == "verbose", terse=form == "terse")
    return found


@cache
def texts() -> dict[str, str]:
    """Every text that an export of a device may look like, by a name for people."""
    files = [path for folder in FOLDERS if folder.is_dir() for path in sorted(folder.rglob("*.rsc"))]
    files = [path for path in files if ".in." not in path.name]
    read = {path.name: path.read_bytes().decode("utf-8", "surrogateescape") for path in files}
    return {**read, **twin_exports()}


@for_each_row("name", texts())
def test_printing_an_export_loses_nothing(name: str) -> None:
    text = texts()[name]
    before, after = told(text), told(print_export(parse(text)))
    assert after.rows == before.rows
    assert after.menus == before.menus
    assert after.comments == before.comments
    assert before.rows


@for_each_row("name", texts())
def test_export_round_trips(name: str) -> None:
    export = parse(texts()[name])
    printed = print_export(export)
    assert parse(printed) == export
    assert print_export(parse(printed)) == printed
    assert parse(print_export(export, width=None)) == export


@pytest.mark.parametrize("name", [name for name in texts() if name.endswith(("-compact", "-verbose"))])
def test_emulator_wraps_lines_as_the_printer_does(name: str) -> None:
    assert print_export(parse(texts()[name])) == texts()[name]
    assert max(map(len, texts()[name].splitlines())) <= 80


def test_sample_exports_cover_every_trait() -> None:
    everything = "".join(texts().values())
    traits = (
        *("set [ find default-name=", "set telnet", "\\C3\\B1", "\\r\\n", " !", " \\\n    "),
        *(" by RouterOS 6.", " .mode="),
    )
    assert [trait for trait in traits if trait not in everything] == []
    assert len(texts()) >= 15 + 3


@given(exports())
def test_independent_reader_agrees_with_the_printed_text(export: Export) -> None:
    """The second reader agrees on anything that can be printed, whatever stands in the values."""
    found = told(print_export(export))
    assert [menu for menu, _ in found.rows] == [row.menu for row in export.statements]
    for (_, words), row in zip(found.rows, export.statements, strict=True):
        given_values = [value for value in (*dict(row.find or ()).values(), *dict(row.values).values()) if value]
        said = {value for _, value in words}
        assert {value.encode("utf-8", "surrogateescape") for value in given_values} <= said


@given(data=st.data())
@settings(max_examples=4 * settings().max_examples)
def test_damaged_text_is_parsed_or_refused_with_a_message(data: st.DataObject) -> None:
    """Never another error than ours; and what is read in spite of the damage is again stable."""
    name = data.draw(st.sampled_from(sorted(texts())))
    text = texts()[name][:4000]
    for _ in range(data.draw(st.integers(1, 3))):
        place = data.draw(st.integers(0, len(text)))
        cut_off = data.draw(st.integers(0, 3))
        put_in = data.draw(
            st.one_of(st.text(max_size=3), st.sampled_from(['"', "\\", "\n", "[", "]", "=", "/", "#", "!"]))
        )
        text = text[:place] + put_in + text[place + cut_off :]
    outcome = read_or_refused(text)
    if isinstance(outcome, RscError):
        assert str(outcome).startswith(f"damaged, line {outcome.line}, column {outcome.column}: ")
        assert 1 <= outcome.line <= text.count("\n") + 2
        return
    printed = print_export(outcome)
    assert parse(printed) == outcome
    assert print_export(parse(printed)) == printed


def read_or_refused(text: str) -> Export | RscError:
    try:
        return parse(text, "damaged")
    except RscError as error:
        return error
