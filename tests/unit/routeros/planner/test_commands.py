import pytest
from hypothesis import given
from hypothesis import strategies as st

from atlantis_netcfg.routeros._types import Action, Layer, Verb
from atlantis_netcfg.routeros.commands import console, sentence
from atlantis_netcfg.routeros.rsc import parse


def action(menu: str, verb: Verb, **kwargs: object) -> Action:
    return Action(number=1, layer=Layer.POLICY, menu=menu, verb=verb, subject="x", **kwargs)  # type: ignore[arg-type]


FILTER = "/ip/firewall/filter"

CASES = [
    (
        action(FILTER, Verb.ADD, values=(("chain", "input"), ("comment", "a b")), before="*A3"),
        '/ip/firewall/filter/add chain=input comment="a b" place-before=*A3',
        ("/ip/firewall/filter/add", (("chain", "input"), ("comment", "a b"), ("place-before", "*A3"))),
    ),
    (
        action(FILTER, Verb.ADD, values=(("chain", "input"),)),
        "/ip/firewall/filter/add chain=input",
        ("/ip/firewall/filter/add", (("chain", "input"),)),
    ),
    (
        action("/ip/address", Verb.SET, ids=("*5",), values=(("comment", ""), ("disabled", "yes"))),
        '/ip/address/set *5 comment="" disabled=yes',
        ("/ip/address/set", ((".id", "*5"), ("comment", ""), ("disabled", "yes"))),
    ),
    (
        action("/ip/address", Verb.SET, ids=("*5",), values=(("comment", "true"), ("disabled", "false"))),
        "/ip/address/set *5 comment=true disabled=no",
        ("/ip/address/set", ((".id", "*5"), ("comment", "true"), ("disabled", "no"))),
    ),
    (
        action("/ip/dns", Verb.SET, values=(("servers", "1.1.1.1,9.9.9.9"),)),
        "/ip/dns/set servers=1.1.1.1,9.9.9.9",
        ("/ip/dns/set", (("servers", "1.1.1.1,9.9.9.9"),)),
    ),
    (
        action("/ip/pool", Verb.REMOVE, ids=("*1", "*2")),
        "/ip/pool/remove *1,*2",
        ("/ip/pool/remove", ((".id", "*1,*2"),)),
    ),
    (
        action(FILTER, Verb.MOVE, ids=("*7",), before="*3"),
        "/ip/firewall/filter/move *7 destination=*3",
        ("/ip/firewall/filter/move", (("numbers", "*7"), ("destination", "*3"))),
    ),
    (
        action("/ip/dhcp-server/network", Verb.SET, ids=("*1",), values=(("!next-server", ""), ("domain", "x"))),
        "/ip/dhcp-server/network/set *1 !next-server domain=x",
        ("/ip/dhcp-server/network/set", ((".id", "*1"), ("!next-server", ""), ("domain", "x"))),
    ),
    (
        action("/routing/table", Verb.ADD, values=(("name", "via-4g"), ("fib", ""))),
        "/routing/table/add name=via-4g fib",
        ("/routing/table/add", (("name", "via-4g"), ("fib", ""))),
    ),
    (
        action("/ip/route", Verb.SET, ids=("*1",), values=(("blackhole", "no"),)),
        "/ip/route/set *1 !blackhole",
        ("/ip/route/set", ((".id", "*1"), ("!blackhole", ""))),
    ),
    (
        action("/system/note", Verb.SET, values=(("note", 'a "$x" \\ ? \r\n é'),)),
        '/system/note/set note="a \\"\\$x\\" \\\\ \\? \\r\\n \\C3\\A9"',
        ("/system/note/set", (("note", 'a "$x" \\ ? \r\n é'),)),
    ),
]


@pytest.mark.parametrize(("given_action", "line", "words"), CASES)
def test_action_is_rendered_for_console_and_api(
    given_action: Action, line: str, words: tuple[str, tuple[tuple[str, str], ...]]
) -> None:
    assert console(given_action) == line
    assert sentence(given_action) == words


@given(st.text(alphabet=st.characters(codec="utf-8", exclude_characters="\0")))
def test_any_text_survives_on_one_console_line(text: str) -> None:
    line = console(action("/system/note", Verb.SET, values=(("note", text),)))
    assert "\n" not in line
    (statement,) = parse(line).statements
    assert statement.values == (("note", text),)
