"""Actions as scripts, turns of them, and what is read from a script's output."""

import asyncio
from collections.abc import Callable, Sequence

import pytest
from scripted import Scripted

from atlantis_netcfg.routeros._types import Action, Layer, Verb
from atlantis_netcfg.routeros.api import WINDOW, Command, Reply, Trap
from atlantis_netcfg.routeros.apply._scripts import LIMIT, action_at, output, scripts
from atlantis_netcfg.routeros.apply._writer import ScriptWriter, SentenceWriter, Writer, WriteResult

POOL, FILTER, LEASE = "/ip/pool", "/ip/firewall/filter", "/ip/dhcp-server/lease"


def add(number: int, menu: str = POOL, **values: str) -> Action:
    return Action(number, Layer.POLICY, menu, Verb.ADD, f"row {number}", values=tuple(values.items()))


def leases(count: int) -> list[Action]:
    return [add(number, LEASE, address=f"10.0.{number // 256}.{number % 256}") for number in range(1, count + 1)]


def send(writer: Writer, actions: Sequence[Action], answer: Callable[[Command], Reply]) -> WriteResult:
    return asyncio.run(writer.send(Scripted(answer), actions))


def test_a_script_names_a_menu_once_and_acknowledges_every_line() -> None:
    actions = [add(1, name="a"), add(2, name="b"), add(3, FILTER, chain="input"), add(4, name="c")]
    ((text, inside),) = scripts(actions)
    assert inside == tuple(actions)
    assert text == (
        '/ip/pool\nadd name=a\n:put "ok 1"\nadd name=b\n:put "ok 2"\n'
        '/ip/firewall/filter\nadd chain=input\n:put "ok 3"\n/ip/pool\nadd name=c\n:put "ok 4"\n'
    )


def test_scripts_keep_within_the_limit_and_to_the_order() -> None:
    actions = leases(3000)
    cut = list(scripts(actions))
    assert len(cut) > 1
    assert [action for _, inside in cut for action in inside] == actions
    assert all(len(text.encode()) <= LIMIT and text.startswith(LEASE) for text, _ in cut)


def test_script_line_maps_back_to_its_action() -> None:
    actions = [add(1, name="a"), add(2, name="b"), add(3, FILTER, chain="input")]
    ((text, _),) = scripts(actions)
    for number, line in enumerate(text.splitlines(), start=1):
        found = action_at(actions, number)
        assert found is not None
        if line.startswith("add"):
            assert dict(found.values).items() <= dict([line.split(" ")[1].split("=")]).items()
    assert action_at(actions, 99) is None


@pytest.mark.parametrize(
    ("text", "acknowledged", "words"),
    [
        ("", (), ""),
        ("ok 1\r\nok 2\r\n", (1, 2), ""),
        ("ok 1\nfailure: already have such entry", (1,), "failure: already have such entry"),
        ("  ok 7  \n\nbad command name x (line 3 column 1)\n", (7,), "bad command name x (line 3 column 1)"),
        ("ok 1 or not\nok\nok x", (), "ok 1 or not ok ok x"),
    ],
)
def test_output_splits_into_acknowledgements_and_messages(text: str, acknowledged: tuple[int, ...], words: str) -> None:
    said = output(text)
    assert (said.acknowledged_numbers, said.words) == (acknowledged, words)


@pytest.mark.parametrize(
    ("reply", "acknowledged", "refused"),
    [
        (Reply(ret="ok 1\nok 2"), (1, 2), None),
        (Reply(ret="ok 1\nno such item"), (1,), "the device refused to add row 2 in /ip pool: no such item"),
        (Reply(ret="ok 1"), (1,), "the device refused to add row 2 in /ip pool: it stopped without a message"),
        (Reply(ret="syntax error (line 4 column 5)"), (), "the device refused to add row 2 in /ip pool: syntax error"),
        (Reply(trap=Trap("no such item")), (), "the device says: no such item"),
        (
            Reply(trap=Trap("bad command name x (line 2 column 1)")),
            (),
            "the device refused to add row 1 in /ip pool: bad",
        ),
        (Reply(ret="ok 1\nok 2\nok 2"), (1, 2), "the device says: it stopped without a message"),
        (Reply(ret="ok 2\nok 1"), (2, 1), "the device says: "),
        (Reply(), (), "the device refused to add row 1 in /ip pool: it stopped without a message"),
    ],
)
def test_script_reply_gives_acknowledged_actions_and_refusal(
    reply: Reply, acknowledged: tuple[int, ...], refused: str | None
) -> None:
    written = send(ScriptWriter(), [add(1, name="a"), add(2, name="b")], lambda _: reply)
    assert written.acknowledged_numbers == acknowledged
    assert (written.refusal is None) == (refused is None)
    assert refused is None or (written.refusal or "").startswith(refused)


def test_only_independent_rows_are_sent_in_parallel_scripts() -> None:
    assert len(list(ScriptWriter().turns(leases(3000)))) == 1
    dependent = [add(number, name=f"pool {number}", ranges="x" * 60) for number in range(1, 2001)]
    assert len(list(ScriptWriter().turns(dependent))) == len(list(scripts(dependent))) > 1


def test_refused_script_does_not_affect_the_parallel_ones() -> None:
    actions = leases(3000)
    (_, first), (_, second) = scripts(actions)
    said = iter(["no such item", "\n".join(f"ok {action.number}" for action in second)])
    written = send(ScriptWriter(), actions, lambda _: Reply(ret=next(said)))
    assert written.refusal == "the device refused to add row 1 in /ip dhcp-server lease: no such item"
    assert written.acknowledged_numbers == tuple(action.number for action in second)
    assert len(first) + len(second) == 3000


def test_only_order_independent_sentences_share_a_turn() -> None:
    free, ordered = leases(WINDOW + 3), [add(number, FILTER, chain="input") for number in (91, 92)]
    turns = SentenceWriter().turns([*free, *ordered, add(93, name="x")])
    numbers = [[action.number for action in turn] for turn in turns]
    assert [len(turn) for turn in numbers] == [WINDOW - 1, 4, 1, 1, 1]
    assert numbers[2:] == [[91], [92], [93]]


def test_a_refused_sentence_is_named() -> None:
    def answer(command: Command) -> Reply:
        refused = ("address", "10.0.0.2") in command.arguments
        return Reply(trap=Trap("failure: already have such entry")) if refused else Reply(ret="*1")

    written = send(SentenceWriter(), leases(3), answer)
    assert written.acknowledged_numbers == (1, 3)
    assert (
        written.refusal == "the device refused to add row 2 in /ip dhcp-server lease: failure: already have such entry"
    )
