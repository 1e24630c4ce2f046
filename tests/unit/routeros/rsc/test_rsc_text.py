from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rsc_strategies import exports, statements, values

from atlantis_netcfg.routeros import rsc
from atlantis_netcfg.routeros.rsc import (
    Export,
    RscError,
    Statement,
    console_path,
    parse,
    print_export,
    print_statement,
    quote,
    unquote,
)
from atlantis_netcfg.routeros.rsc._print import ValueTextError

HERE = Path(__file__).parent
DEVICE_TEXTS = sorted(path for path in (HERE / "golden").glob("*.rsc") if ".in." not in path.name)
OTHER_TEXTS = sorted((HERE / "golden").glob("*.in.rsc"))
WRONG_TEXTS = sorted((HERE / "errors").glob("*.rsc"))


def read(path: Path) -> str:
    return path.read_text(encoding="utf-8")


def names(path: Path) -> str:
    return path.name.partition(".")[0]


@pytest.mark.parametrize("path", DEVICE_TEXTS, ids=names)
def test_text_in_device_form_is_printed_unchanged(path: Path) -> None:
    assert print_export(parse(read(path))) == read(path)


@pytest.mark.parametrize("path", OTHER_TEXTS, ids=names)
def test_other_forms_are_printed_in_device_form(path: Path) -> None:
    assert print_export(parse(read(path))) == read(path.with_name(f"{names(path)}.rsc"))


@pytest.mark.parametrize("path", [*DEVICE_TEXTS, *OTHER_TEXTS], ids=lambda path: path.name)
def test_bom_line_endings_and_final_newline_do_not_matter(path: Path) -> None:
    text = read(path)
    assert parse("\ufeff" + text.replace("\n", "\r\n")) == parse(text)
    assert parse(text.rstrip("\n")) == parse(text)


@pytest.mark.parametrize("path", WRONG_TEXTS, ids=names)
def test_every_mistake_is_explained_with_its_location(path: Path) -> None:
    with pytest.raises(RscError) as caught:
        parse(read(path), source=path.name)
    error = caught.value
    shown = f"{error}\n{error.hint}\n" if error.hint else f"{error}\n"
    assert shown == read(path.with_suffix(".txt"))
    assert f"line {error.line}, column {error.column}" in shown


def test_public_names_of_the_package() -> None:
    assert rsc.__all__ == [
        *("WIDTH", "Export", "RscError", "Statement", "console_path"),
        *("in_quotes", "parse", "print_export", "print_statement", "quote", "unquote"),
    ]


def test_sample_texts_of_every_kind_exist() -> None:
    assert len(DEVICE_TEXTS) >= 4
    assert len(OTHER_TEXTS) >= 2
    assert len(WRONG_TEXTS) >= 15


def test_statement_contains_the_content_of_its_line() -> None:
    text = "/ip service\n# why\nset [ find name=api-ssl ] !address certificate=a tls-version=only-1.2\nset 0 port=22\n"
    first, second = parse(text).statements
    assert first == Statement(
        menu="/ip/service",
        verb="set",
        values=(("address", None), ("certificate", "a"), ("tls-version", "only-1.2")),
        find=(("name", "api-ssl"),),
        comments=("why",),
    )
    assert (first.line, second.line, second.target, second.get("port"), second.get("name")) == (3, 4, "0", "22", None)


def test_elided_names_are_expanded_and_shortened_only_for_routeros_7() -> None:
    row = "add configuration=base configuration.country=Spain .mode=ap disabled=no security.ft=yes .ft-over-ds=yes\n"
    export = parse(f"# by RouterOS 7.18.2\n/interface wifi\n{row}")
    assert [name for name, _ in export.statements[0].values] == [
        *("configuration", "configuration.country", "configuration.mode", "disabled"),
        *("security.ft", "security.ft-over-ds"),
    ]
    assert print_export(export, width=None).endswith(row)
    old = Export(("by RouterOS 6.49.18",), export.statements, export.menus)
    assert " .mode=" not in print_export(old, width=None)


def test_flags_have_an_empty_value_and_no_equals_sign() -> None:
    (row,) = parse("/ip route\nadd blackhole comment=x dst-address=192.0.2.1/32").statements
    assert row.values == (("blackhole", ""), ("comment", "x"), ("dst-address", "192.0.2.1/32"))
    assert print_statement(row) == "add blackhole comment=x dst-address=192.0.2.1/32"


def test_menus_are_listed_once_in_order_also_empty_ones() -> None:
    text = "/ip dns\n/ip address add address=192.0.2.1/24\n/ip dns\nset servers=192.0.2.53\n/ip address\n/ip pool\n"
    export = parse(text)
    assert export.menus == ("/ip/dns", "/ip/address", "/ip/pool")
    assert [row.menu for row in export.statements] == ["/ip/address", "/ip/dns"]
    assert parse(print_export(export)) == export


def test_comments_stay_where_they_were() -> None:
    text = "# top\n\n# first\n/ip dns\n# second\nset servers=192.0.2.53\n# last\n"
    export = parse(text)
    assert (export.header, export.statements[0].comments, export.trailer) == (("top",), ("first", "second"), ("last",))
    assert list(export.remarks()) == ["top", "first", "second", "last"]


@pytest.mark.parametrize(
    ("menu", "path"), [("/ip/firewall/filter", "/ip firewall filter"), ("/user", "/user"), ("/", "/")]
)
def test_menus_are_written_as_on_the_console(menu: str, path: str) -> None:
    assert console_path(menu) == path


@pytest.mark.parametrize(
    ("menu", "text"),
    [("/ip/dns/static", "/ip dns static add name=a"), ("/user", "/user add name=a"), ("/", "/add name=a")],
)
def test_statement_can_be_printed_with_its_menu(menu: str, text: str) -> None:
    statement = Statement(menu, "add", (("name", "a"),))
    assert print_statement(statement, path=True) == text
    assert parse(text).statements == (statement,)


@given(exports())
@settings(deadline=None)
def test_printing_loses_nothing(export: Export) -> None:
    assert parse(print_export(export)) == export
    assert parse(print_export(export, width=None)) == export


@given(exports())
@settings(deadline=None)
def test_printing_is_stable(export: Export) -> None:
    text = print_export(export)
    assert print_export(parse(text)) == text


@given(statements(), st.integers(min_value=1, max_value=140))
@settings(deadline=None)
def test_wrapping_at_any_width_round_trips(statement: Statement, width: int) -> None:
    text = print_statement(statement, width=width, path=True)
    (back,) = parse(text).statements
    assert back == Statement(back.menu, back.verb, back.values, back.find, back.target, comments=())
    assert (back.menu, back.verb, back.values, back.find, back.target) == (
        statement.menu,
        statement.verb,
        statement.values,
        statement.find,
        statement.target,
    )


@given(statements(), st.integers(min_value=40, max_value=140))
@settings(deadline=None)
def test_wrapped_lines_fit_the_width_except_a_cut_backslash(statement: Statement, width: int) -> None:
    lines = print_statement(statement, width=width).split("\n")
    assert all(line.startswith("    ") and line[4:5] != " " for line in lines[1:])
    assert all(len(line) <= width + (line.endswith('" \\') and len(line) - width == 1) for line in lines)


def test_row_printed_on_one_line_is_never_wrapped() -> None:
    row = Statement("/system/script", "add", (("source", "a\nb " * 200),))
    assert "\n" not in print_statement(row)
    assert parse(print_statement(row, path=True)).statements == (row,)


PRINTED = [
    ("", '""'),
    ("yes", "yes"),
    ("!sat-allow", "!sat-allow"),
    ("a!#%*+,-./:<>@_~z", "a!#%*+,-./:<>@_~z"),
    ("wan A", '"wan A"'),
    ("it's", '"it\'s"'),
    ("a=b;c", '"a=b;c"'),
    ("[(^|)]{}&", '"[(^|)]{}&"'),
    ('say "no"', r'"say \"no\""'),
    ("C:\\temp", r'"C:\\temp"'),
    ("$x", r'"\$x"'),
    ("https://a/?b", r'"https://a/\?b"'),
    ("one\r\ntwo\tthree", r'"one\r\ntwo\tthree"'),
    ("\x00\x1b\x7f", r'"\00\1B\7F"'),
    ("Muñoz", r'"Mu\C3\B1oz"'),
    ("\udcd2\udcca", r'"\D2\CA"'),
    ("`", '"`"'),
]


@pytest.mark.parametrize(("value", "text"), PRINTED)
def test_value_is_quoted_as_the_device_does_and_read_back(value: str, text: str) -> None:
    assert quote(value) == text
    assert unquote(text) == value


@pytest.mark.parametrize(
    ("text", "value"),
    [
        (r'"\_a"', " a"),
        (r'"\a\b\f\v"', "\a\b\f\v"),
        (r'"\F0\9F\9A\A2"', "\N{SHIP}"),
        ('"Muñoz"', "Muñoz"),
        ('"no \\"end\\""', 'no "end"'),
    ],
)
def test_other_accepted_spellings_are_read(text: str, value: str) -> None:
    assert unquote(text) == value


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ('"open', "the text must end with the one quote that closes it"),
        ('"', "the text must end with the one quote that closes it"),
        ('"a"b"', "the text must end with the one quote that closes it"),
        (r'"ends\"', "the text must end with the one quote that closes it"),
        (r'"\q"', r"\q is not an escape that RouterOS knows"),
        (r'"\c3"', r"\c is not an escape that RouterOS knows"),
        ("a$b", "$ may only stand inside quotes"),
        ('a"b', '" may only stand inside quotes'),
        ("a\\b", "\\ may only stand inside quotes"),
        ("a b", "  may only stand inside quotes"),
        ("Muñoz", "ñ may only stand inside quotes"),
    ],
)
def test_invalid_value_is_refused_with_a_message(text: str, complaint: str) -> None:
    with pytest.raises(ValueTextError) as caught:
        unquote(text)
    assert str(caught.value) == complaint


@given(values)
@settings(deadline=None)
def test_every_value_round_trips(value: str) -> None:
    text = quote(value)
    assert unquote(text) == value
    assert text.isascii()
    assert text.isprintable()
