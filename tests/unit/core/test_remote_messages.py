"""Results of programs on other computers: their messages keep their values, and forged ones do no harm."""

import pytest

from atlantis_netcfg.ansible_collections.atlantis.netcfg.plugins.module_utils.errors import ModuleError
from atlantis_netcfg.core import compiled_catalogue, language, messages, remote_messages
from atlantis_netcfg.core.messages import Message, arg, msg
from atlantis_netcfg.core.stored_messages import pack
from atlantis_netcfg.core.translation import Translator


def test_refused_module_is_shown_in_portuguese_with_its_values() -> None:
    portuguese = language.Language.PORTUGUESE
    translator = Translator(
        compiled_catalogue.load(language.catalogue_file(portuguese)), language._CONTRACTIONS[portuguese]
    )
    size = msg(f"{arg(1.25):.1f} {arg('GB')}")
    refused = ModuleError(
        f"the computer's disk is too full: {arg(size)} are needed at {arg('/var')}, {arg('0 bytes')} are free"
    )
    result = remote_messages.unpack(pack({"msg": refused.message}))
    assert result["msg"] == "the computer's disk is too full: 1.2 GB are needed at /var, 0 bytes are free"
    shown = translator.translate(result["msg"])
    assert "1,2 GB" in shown
    assert "/var" in shown
    assert "disk" not in shown


def test_a_message_that_a_program_was_given_keeps_its_values_in_what_it_returns() -> None:
    step, finding = msg(f"start {arg('radio')} if it is plugged in"), msg(f"{arg(3)} MB too many")
    assert isinstance(step, Message)
    assert isinstance(finding, Message)
    returned = pack({"changes": [msg(f"step {arg(str.__str__(step))}")], "findings": [str.__str__(finding)]})
    result = remote_messages.unpack(returned, [step.source, finding.source])
    assert result == {"changes": ["step start radio if it is plugged in"], "findings": ["3 MB too many"]}
    assert result["findings"][0].source == finding.source
    assert step.source in result["changes"][0].source


@pytest.mark.parametrize("texts", [None, 3, "text", [3], {"a": "b"}])
def test_texts_of_another_shape_are_ignored(texts: object) -> None:
    assert remote_messages.unpack({"msg": "it is full", "texts": texts}) == {"msg": "it is full"}


def test_a_text_that_would_multiply_or_nest_without_end_is_ignored() -> None:
    multiplied = msg(f"{arg('a')}").replace("a", "aaaaaaaaaa").replace("a", "aaaaaaaaaa")
    nested = msg(f"{arg('a')}")
    for _ in range(30):
        nested = msg(f"{arg(nested)}")
    torn = messages.MESSAGE * 5000
    assert isinstance(multiplied, Message)
    assert isinstance(nested, Message)
    assert remote_messages.checked_texts({"texts": [multiplied.source, nested.source, torn]}) == {}


def test_control_characters_are_escaped_between_marks() -> None:
    text = msg(f"{arg('a' + chr(27))} is full")
    assert isinstance(text, Message)
    (checked,) = remote_messages.checked_texts({"texts": [text.source]})["texts"]
    assert Message(checked) == "a\\u001b is full"
