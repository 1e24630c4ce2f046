"""Messages that know their values: English for programs, translated when they are shown."""

import copy
import json
import pickle
from collections.abc import Callable
from dataclasses import dataclass
from datetime import UTC, datetime
from enum import StrEnum

import pytest

from atlantis_netcfg.core import language
from atlantis_netcfg.core.errors import UsageError, fill_hint
from atlantis_netcfg.core.language import Language
from atlantis_netcfg.core.message_models import MessageModel
from atlantis_netcfg.core.messages import Message, alternatives, arg, conjunction, join, msg, shorten
from atlantis_netcfg.core.stored_messages import pack, unpack
from atlantis_netcfg.core.translation import Translator, number_values

CATALOGUE = {
    "{count} changes left": "faltam {count} alterações",
    "{count} changes": "{count} alterações",
    "no such device": "esse equipamento não existe",
    "not reached": "não alcançado",
    "{name}: {reason} was lost": "perdeu-se {reason} de {name}",
    "the link": "a ligação",
    "{text} and {part}": "{text} e {part}",
    "{text} or {part}": "{text} ou {part}",
    "wait {seconds} s": "aguarde {seconds} s",
    "type `{command}`": "escreva `{command}`",
    "run `provision plan site=…` first": "execute primeiro `provision plan site=…`",
    "then type: provision plan at={place} now": "depois escreva: provision plan at={place} now",
    "what {{}} is, in {name}": "o que é {{}}, em {name}",
    "{first} of {second}": "{second} de {first}",
    "rehearse the site: `provision site=… --rehearse`": "ensaie o local: `provision site=… --rehearse`",
    "add --rehearse": "acrescente --rehearse",
}


@pytest.fixture
def translator() -> Translator:
    catalogue = dict(number_values(msgid, translation) for msgid, translation in CATALOGUE.items())
    return Translator(catalogue, {"de o": "do", "de a": "da"})


class Reachability(StrEnum):
    NO = "not reached"


def loss(name: str, reason: object) -> str:
    return msg(f"{arg(name)}: {arg(reason)} was lost")


def marked(text: str) -> str:
    assert isinstance(text, Message)
    return text.source


def test_a_message_is_its_english_text() -> None:
    message = msg(f"{arg(3)} changes left")
    assert isinstance(message, Message)
    assert message == "3 changes left"
    assert hash(message) == hash("3 changes left")
    assert json.dumps({"msg": message}) == '{"msg": "3 changes left"}'
    assert msg(message) is message


@pytest.mark.parametrize("clone", [copy.copy, copy.deepcopy, lambda item: pickle.loads(pickle.dumps(item))])  # noqa: S301 - our own
def test_copies_keep_values_and_replacements(clone: Callable[[str], str]) -> None:
    times = msg(f"{arg(2)} times")
    message = msg(f"run {arg(times)} at site=…").replace("site=…", "site=scc")
    duplicate = clone(message)
    assert duplicate == message == "run 2 times at site=scc"
    assert marked(duplicate) == marked(message)
    assert marked(times) in marked(message)


def test_an_error_gives_its_message_back() -> None:
    message = msg(f"{arg(3)} changes left")
    assert str(UsageError(message)) is message
    assert marked(message) in marked(msg(f"{arg(UsageError(message))}!"))


def test_an_object_that_is_shown_as_a_message_keeps_the_values_of_that_message() -> None:
    class Problem:
        def __str__(self) -> str:
            return msg(f"{arg(3)} changes left")

    assert marked(str(Problem())) in marked(msg(f"{arg(Problem())}!"))


def test_an_error_makes_messages_of_its_text_and_hint() -> None:
    error = UsageError(f"{arg(3)} changes left", hint=f"look at {arg('cpe')}")
    assert (str(error), error.hint) == ("3 changes left", "look at cpe")
    assert marked(str(error)) == marked(msg(f"{arg(3)} changes left"))
    assert marked(error.hint or "") == marked(msg(f"look at {arg('cpe')}"))


@pytest.mark.parametrize(
    ("message", "expected"),
    [
        (msg(f"{arg(3)} changes left"), "faltam 3 alterações"),
        (loss("cpe", "the link"), "perdeu-se a ligação de cpe"),
        (loss("cpe", Reachability.NO), "perdeu-se não alcançado de cpe"),
        (loss("link", "the road"), "perdeu-se the road de link"),
        (msg(f"{arg('cpe')}: {arg(msg(f'{arg(2)} changes left'))}"), "cpe: faltam 2 alterações"),
        (msg(f"what {{}} is, in {arg('{x}')}"), "o que é {}, em {x}"),
        (msg(f"{arg('the link'):<12}|"), "a ligação   |"),
        (msg(f"{arg(msg('the link')):<12}|"), "a ligação   |"),
        (msg(f"{arg(msg('no such device')):<12}|"), "esse equipamento não existe|"),
        (msg(f"{arg('cpe'):<12}|"), "cpe         |"),
        (msg(f"{arg('cpe')!r}|"), "'cpe'|"),
        (msg(f"{arg('the link')} of {arg('cpe')}"), "cpe da ligação"),
        (msg(f"1. {arg(2)} changes left\n  -> the link\n"), "1. faltam 2 alterações\n  -> a ligação\n"),
        (join("; ", ["the link", "cpe", msg(f"{arg(4)} changes")]), "a ligação; cpe; 4 alterações"),
        (msg(f"{arg(3)} changes left") + ", no such device", "faltam 3 alterações, no such device"),
        ("link: " + msg(f"{arg(3)} changes left"), "link: faltam 3 alterações"),
        (conjunction(["the link", "cpe", 2.5]), "a ligação e cpe e 2,5"),
        (conjunction(["the link"]), "a ligação"),
        (conjunction([]), ""),
        (alternatives(["the link", "cpe"]), "a ligação ou cpe"),
        (join(" {} ", ["no such device", "x"]), "esse equipamento não existe {} x"),
        (msg("what {} is"), "what {} is"),
        ("no such device\n  not reached", "esse equipamento não existe\n  não alcançado"),
        ("nothing of the kind", "nothing of the kind"),
        ("3 changes left", "3 changes left"),
        ("{count} changes left", "{count} changes left"),
    ],
)  # fmt: skip
def test_message_is_translated(translator: Translator, message: str, expected: str) -> None:
    assert translator.translate(message) == expected


def test_numbers_have_a_decimal_comma(translator: Translator) -> None:
    message = msg(f"wait {arg(2.25):.1f} s")
    assert (message, translator.translate(message)) == ("wait 2.2 s", "aguarde 2,2 s")
    assert translator.translate(msg(f"{arg(12345):,} changes")) == "12\N{NO-BREAK SPACE}345 alterações"
    assert translator.translate(loss("7.19", "x")) == "perdeu-se x de 7.19"


def test_what_is_typed_is_the_same_in_both_languages(translator: Translator) -> None:
    assert translator.translate(msg(f"type `{arg('the link')}`")) == "escreva `the link`"
    assert translator.translate(msg(f"type `{arg(38.5)}`")) == "escreva `38.5`"
    command = msg(f"then type: provision plan at={arg(38.5)} now")
    assert translator.translate(command) == "depois escreva: provision plan at=38.5 now"


def test_a_placeholder_of_a_command_is_replaced_in_both_languages(translator: Translator) -> None:
    hint = fill_hint("run `provision plan site=…` first", site="scc")
    assert hint == "run `provision plan site=scc` first"
    assert translator.translate(hint) == "execute primeiro `provision plan site=scc`"
    outer = msg(f"{arg('cpe')}: {arg(hint)} was lost")
    assert outer == "cpe: run `provision plan site=scc` first was lost"
    assert translator.translate(outer) == "perdeu-se execute primeiro `provision plan site=scc` de cpe"


def test_a_whole_message_is_replaced_in_both_languages(translator: Translator) -> None:
    whole = "rehearse the site: `provision site=… --rehearse`"
    assert translator.translate(msg(whole).replace(whole, "add --rehearse")) == "acrescente --rehearse"
    part = msg(f"{arg('cpe')}: {arg(whole)} was lost").replace(whole, "add --rehearse")
    assert part == "cpe: add --rehearse was lost"
    assert translator.translate(part) == "perdeu-se acrescente --rehearse de cpe"


def test_a_replacement_may_contain_values(translator: Translator) -> None:
    hint = msg(f"type `{arg('provision plan')}` {arg('now')}").replace("plan` now", "plan site=scc`")
    assert hint == "type `provision plan site=scc`"
    assert translator.translate(msg(f"{arg(hint)}!")) == "type `provision plan site=scc`!"


def test_a_long_value_is_shortened_inside_its_marks(translator: Translator) -> None:
    text = shorten(loss("x" * 40, "the link"), 40)
    assert text == f"{'x' * 20} … x: the link was lost"
    assert translator.translate(text) == f"perdeu-se a ligação de {'x' * 20} … x"
    assert shorten(loss("cpe", "the link"), 40) == "cpe: the link was lost"


def test_a_text_is_shortened_across_values() -> None:
    text = shorten(loss("x" * 15, "y" * 40), 20)
    assert text == "xxxxxxxxxx … y was lost"
    assert not isinstance(text, Message)


def test_marks_in_a_value_are_removed() -> None:
    hostile = "a\ue002b\ue005c\ue004"
    message = msg(f"x {arg(hostile)} y {arg(1)}")
    assert message == "x abc y 1"
    assert marked(message) == marked(msg(f"x {arg('abc')} y {arg(1)}"))


@pytest.mark.parametrize("text", ["\ue005\ue003a\ue004b", "\ue000a", "a\ue005b", "\ue003\ue003x\ue005"])
def test_marks_without_a_counterpart_are_removed(translator: Translator, text: str) -> None:
    assert not set(msg(text)) & set("\ue000\ue003\ue004\ue005")
    assert not set(translator.translate(text)) & set("\ue000\ue003\ue004\ue005")


def test_values_stand_beside_the_texts_of_a_json_document(translator: Translator) -> None:
    time = datetime(2026, 11, 29, 16, 40, tzinfo=UTC)
    inner = msg(f"{arg(2.25):.1f} s since {arg(time):%Y-%m-%d %H:%M}")
    hint = fill_hint("run `provision plan site=…` first", site="scc")
    device = {"message": loss("cpe", inner), "hint": hint, "steps": (inner, "x", 3)}
    packed = json.loads(json.dumps(pack({"devices": {"cpe": device}, "count": 1})))
    assert packed["devices"]["cpe"] == {**device, "steps": [inner, "x", 3]}
    unpacked = unpack(packed)
    assert unpacked == {"devices": packed["devices"], "count": 1}
    read = unpacked["devices"]["cpe"]
    assert [type(read["message"]), type(read["hint"]), type(read["steps"][0])] == [Message, Message, Message]
    assert translator.translate(read["message"]) == "perdeu-se 2,2 s since 2026-11-29 16:40 de cpe"
    assert translator.translate(read["hint"]) == "execute primeiro `provision plan site=scc`"


def test_a_document_without_values_is_packed_unchanged() -> None:
    document = {"text": msg("no such device"), "rows": [1, None]}
    assert pack(document) == document
    assert unpack(document) == document


@dataclass(frozen=True, slots=True)
class Part:
    text: str
    state: Reachability = Reachability.NO


class Page(MessageModel):
    parts: tuple[Part, ...]
    notes: dict[str, str]
    title: str | None = None


def test_a_model_keeps_the_values_of_its_messages() -> None:
    left = msg(f"{arg(3)} changes left")
    page = Page(parts=(Part(left),), notes={"x": left}, title=left)
    stored = Page.from_json(page.to_json())
    for each in (page, stored):
        assert [marked(text) for text in (each.parts[0].text, each.notes["x"], each.title or "")] == [marked(left)] * 3
    assert stored == page
    assert stored.parts[0].state is Reachability.NO
    assert Page.from_json(page.model_dump_json()) == page


@pytest.mark.parametrize("text", ["[]", "3", "", '{"texts": 3}', '{"texts": [3]}'])
def test_another_document_is_no_model(text: str) -> None:
    with pytest.raises(ValueError, match=r"."):
        Page.from_json(text)


@pytest.mark.usefixtures("portuguese")
def test_a_message_is_looked_up_in_the_catalogue_of_the_language() -> None:
    message = msg(f"{arg('cpe')} has {arg('10.0.0.1')}")
    assert language.translate(message) == "cpe tem 10.0.0.1"
    assert language.translate(f"{arg('cpe')}: {arg(message)}") == "cpe: cpe tem 10.0.0.1"


def test_an_f_string_with_values_is_shown_without_marks_in_english() -> None:
    assert language.current() is Language.ENGLISH
    assert language.translate(f"{arg('cpe')} has {arg('10.0.0.1')}") == "cpe has 10.0.0.1"
