from __future__ import annotations

import pytest
from hypothesis import given
from rsc_strategies import values

from atlantis_netcfg.rsc import quote, unquote
from atlantis_netcfg.rsc._print import ValueTextError

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
def test_a_value_is_printed_as_the_device_prints_it_and_read_back(value: str, text: str) -> None:
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
def test_what_the_device_also_accepts_is_read(text: str, value: str) -> None:
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
def test_a_wrong_value_is_refused_in_words(text: str, complaint: str) -> None:
    with pytest.raises(ValueTextError) as caught:
        unquote(text)
    assert str(caught.value) == complaint


@given(values)
def test_every_value_survives(value: str) -> None:
    text = quote(value)
    assert unquote(text) == value
    assert text.isascii()
    assert text.isprintable()
