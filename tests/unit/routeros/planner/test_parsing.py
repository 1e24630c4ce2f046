"""What a device's parser is asked of a plan, and what its answers mean: any text survives, and no silence is a yes."""

from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from atlantis_netcfg.emulator.routeros.console._parse import Each, Parse, Parser, Put, TextPart
from atlantis_netcfg.emulator.routeros.device import Device
from atlantis_netcfg.emulator.routeros.schema import offered_values
from atlantis_netcfg.emulator.routeros.spec import RouterSpec, User
from atlantis_netcfg.routeros._types import Action, Layer, Verb
from atlantis_netcfg.routeros.api import Reply, Trap
from atlantis_netcfg.routeros.commands import ENUMERATIONS, ROOM, Examination, script
from atlantis_netcfg.routeros.menus import MENUS
from atlantis_netcfg.routeros.rsc import unquote

CORE = Device(RouterSpec(name="router"), lambda: 1000.0)._core
LINES = st.text(st.characters(exclude_categories=["Cs"]), min_size=1) | st.text(
    "\\\"$'{}[]();=/:abc 0\n\r\t#", min_size=1
)
OTHERS = st.lists(LINES, min_size=1, max_size=4)


@given(OTHERS)
def test_every_line_reaches_the_parser_unchanged(lines: list[str]) -> None:
    """Through the text of the array, the inner script, and the text that is parsed; and nothing else is in them."""
    (loop,) = Parser(CORE, TextPart(script(lines))).statements()
    assert isinstance(loop, Each)
    assert len(loop.texts) == len(lines)
    for line, text in zip(lines, loop.texts, strict=True):
        (inner,) = text
        assert isinstance(inner, str)
        (put,) = Parser(CORE, TextPart(f':put [:parse "{inner}"]')).statements()
        assert isinstance(put, Put)
        assert isinstance(put.what, Parse)
        assert put.what.text == (line,)
        assert unquote(f'"{inner}"') == line


@settings(max_examples=50)
@given(LINES)
def test_a_line_is_never_executed(line: str) -> None:
    """Whatever stands in it: the device has one identity before and after, and says one thing of the line."""
    device = Device(RouterSpec(name="router", users=(User(name="provision"),)), lambda: 1000.0)
    caller = device.login("provision", "", via="api-ssl", address="10.64.101.10")
    before = device.export(header=False, show_sensitive=True)
    text = script([line, '/system/identity/set name="x"', "/system/identity/set atlantis=no"])
    (reply,) = device.run(caller, ["/execute", f"=script={text}", "=as-string="])
    said = reply.words[0].removeprefix("=ret=").split("\n")
    assert said[-1].startswith("2 ")
    assert not any(each.startswith("1 ") for each in said)
    assert device.export(header=False, show_sensitive=True) == before


def action(number: int = 1, **changes: Any) -> Action:  # noqa: ANN401 - fields of Action
    standard: dict[str, Any] = {
        "layer": Layer.FOUNDATION,
        "menu": "/ip/pool",
        "verb": Verb.ADD,
        "subject": f"pool {number}",
        "values": (("name", f"p{number}"), ("ranges", "10.0.0.1-10.0.0.9")),
        "line": 7 + number,
    }
    return Action(number, **{**standard, **changes})


ONE, TWO = action(1), action(2)
CONTROL = "2 (evl bad parameter atlantis (line 1 column 30) /system/identity/set)"
SAYS = "site.rsc, line 8: the device's own parser does not take this (add pool 1 in /ip pool): "
REFUSALS = {
    "0 (evl bad parameter ranges (line 1 column 18) /ip/pool/add)\n": "bad parameter ranges",
    "0 (<%% bad command name pool (line 1 column 5) pool;add;name=p1)\n": "bad command name pool",
    "0 expected end of command (line 1 column 22)\n": "expected end of command at `ranges`",
    "0 syntax error (line 1 column 30)\n": "syntax error at `ranges`",
    "0 expected input value (line 1 column 400)\n": "expected input value",
}
NOTHING_PROVED = {
    "nothing came back": "",
    "the control was taken": "\n",
    "only the control's number": "2 \n",
    "another text": "2 all is well",
    "a job": "*31",
    "the loop broke off": "0 (evl bad parameter ranges (line 1 column 18) /ip/pool/add)\nfailure: no memory",
    "a verdict that is not known": f"0 nonsense (line 1)\n{CONTROL}",
    "an accepted command comes back": f"0 (evl /ip/pool/addname=p1)\n{CONTROL}",
    "more numbers than commands": f"{CONTROL}\n3 syntax error (line 1 column 1)",
}


def judged(*replies: Reply) -> Examination:
    examination = Examination()
    assert len(examination.questions([ONE, TWO], {})) == 1
    examination.read_answers(replies)
    return examination


@pytest.mark.parametrize("answer", REFUSALS)
@pytest.mark.parametrize("newline", ["\n", "\r\n"])
def test_refusal_is_reported_with_the_line_of_the_text(answer: str, newline: str) -> None:
    examination = judged(Reply(ret=(answer + CONTROL).replace("\n", newline)))
    assert list(examination.objections([ONE, TWO], "site.rsc")) == [SAYS + REFUSALS[answer]]
    assert examination.doubt([ONE, TWO]) == ""


def test_accepted_commands_raise_no_objection_or_doubt() -> None:
    examination = judged(Reply(ret=CONTROL))
    assert list(examination.objections([ONE, TWO], "site.rsc")) == []
    assert examination.doubt([ONE, TWO]) == ""
    assert examination.questions([ONE, TWO], {}) == (), "nothing is asked twice"


@pytest.mark.parametrize("case", NOTHING_PROVED)
def test_reply_that_proves_nothing_is_inconclusive(case: str) -> None:
    examination = judged(Reply(ret=NOTHING_PROVED[case]))
    assert "INCONCLUSIVE" in examination.doubt([ONE, TWO])
    assert "with an unknown message" in examination.doubt([ONE, TWO])
    assert examination.questions([ONE, TWO], {}) == (), "a device that does not answer is not asked for ever"


@pytest.mark.parametrize("words", ["no such command", "unknown parameter as-string", "not enough permissions (9)"])
def test_device_without_scripts_is_inconclusive(words: str) -> None:
    doubt = judged(Reply(trap=Trap(words))).doubt([ONE, TWO])
    assert doubt.startswith("INCONCLUSIVE whether this device takes every command of the plan: ")
    assert words in doubt


def test_refusal_contains_no_secret() -> None:
    secret = action(1, menu="/user", values=(("name", "x"), ("password", "hunter2")), secrets=frozenset({"password"}))
    examination = Examination()
    (asked,) = examination.questions([secret], {})
    assert "hunter2" not in str(asked.words())
    examination.read_answers(
        [Reply(ret="0 (<%% bad command name user (line 1 column 2) user;add;password=hunter2)\n1 " + CONTROL[2:])]
    )
    (words,) = examination.objections([secret], "site.rsc")
    assert "hunter2" not in words


def test_thousands_of_row_ids_are_parsed_as_one_row() -> None:
    many = action(1, verb=Verb.REMOVE, values=(), ids=tuple(f"*{number:X}" for number in range(3000)))
    (asked,) = Examination().questions([many], {})
    assert sum(map(len, asked.words())) < 400


@pytest.mark.parametrize("number", [1, 25, 26, 300, 2000])
def test_all_requests_fit_into_the_batch(number: int) -> None:
    actions = [action(each) for each in range(number)]
    asked = Examination().questions(actions, {})
    assert len(asked) <= ROOM
    scripts = sum(len(f"/ip/pool/add name=p{each} ranges=10.0.0.1-10.0.0.9") + 15 for each in range(number))
    assert sum(len(word) for command in asked for word in command.words()) <= 1.3 * scripts + 300 * len(asked)
    assert all(len(word.encode()) < 64 * 1024 for command in asked for word in command.words())


RULE = action(1, menu="/ip/firewall/filter", values=(("action", "acept"), ("chain", "input")), subject="input acept ")


def test_enumerated_values_are_checked_against_the_console() -> None:
    examination = Examination()
    _, some = examination.questions([RULE], {})
    assert some.words()[0] == "/console/inspect"
    assert some.queries == ("?completion=acept",)
    examination.read_answers([Reply(ret="1 " + CONTROL[2:]), Reply()])
    (whole,) = examination.questions([RULE], {})
    assert whole.queries == ()
    examination.read_answers([Reply(rows=({"completion": "accept"}, {"completion": "drop"}))])
    assert examination.questions([RULE], {}) == ()
    (words,) = examination.objections([RULE], "site.rsc")
    assert words.endswith("`action` is one of accept, drop, not acept")
    assert examination.doubt([RULE]) == ""


LONG = tuple({"completion": f"word{number}"} for number in range(31))


@pytest.mark.parametrize("whole", [Reply(), Reply(rows=LONG), Reply(trap=Trap("no such command"))])
def test_possibly_incomplete_value_list_refuses_nothing_but_is_reported(whole: Reply) -> None:
    examination = Examination()
    examination.questions([RULE], {})
    examination.read_answers([Reply(ret="1 " + CONTROL[2:]), Reply()])
    examination.questions([RULE], {})
    examination.read_answers([whole])
    assert examination.questions([RULE], {}) == ()
    assert list(examination.objections([RULE], "site.rsc")) == []
    assert "it does not tell which words `action` of /ip firewall filter takes" in examination.doubt([RULE])


def test_a_value_that_the_menu_has_already_is_not_looked_up() -> None:
    rows = {"/ip/firewall/filter": ({".id": "*1", "action": "acept"},)}
    assert len(Examination().questions([RULE], rows)) == 1


@pytest.mark.parametrize(("menu", "name"), sorted(ENUMERATIONS))
def test_enumerations_are_arguments_with_console_values(menu: str, name: str) -> None:
    assert name in MENUS[menu].by_name
    assert 1 < len(offered_values(menu, name)) <= 30
