"""How a message that is already made is found in the catalogue, and what is never lost or changed in it."""

import time

import pytest

from atlantis_netcfg.core import language
from atlantis_netcfg.core.catalogue import _MOST_TRIED, Catalogue
from atlantis_netcfg.core.language import Language

MESSAGES = {
    "nothing was changed": "nada foi alterado",
    "no such device": "esse equipamento não existe",
    "not reached": "não alcançado",
    "`provision report runs` lists what is there": "`provision report runs` lista o que há",
    "{number} change": "{number} alteração",
    "{number} changes": "{number} alterações",
    "{number} changes of {rows} rows": "{number} alterações em {rows} linhas",
    "{name}: {reason} was lost": "{name}: perdeu-se {reason}",
    "stopped by {how}; {kept}": "interrompido por {how}; {kept}",
    "{device} answers on {port} of {site}": "em {site}, {device} responde na porta {port}",
    "of {box}": "de {box}",
    "type `{command}` to go on": "para continuar, escreva `{command}`",
    "to bring them there, type:  provision site={site}": "para as levar até lá, escreva:  provision site={site}",
    "it goes on with `provision recover resume site={site}`": "prossegue com `provision recover resume site={site}`",
    "what {{}} is": "o que é {{}}",
    "the link": "a ligação",
    "{name}: the device has refused it: {answer}": "{name}: o equipamento recusou: {answer}",
    "done": "concluído",
}


@pytest.fixture
def catalogue() -> Catalogue:
    return Catalogue(MESSAGES)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("nothing was changed", "nada foi alterado"),
        ("  nothing was changed ", "  nada foi alterado "),
        ("done", "concluído"),
        ("what {} is", "o que é {}"),
        ("1 change", "1 alteração"),
        ("3 changes", "3 alterações"),
        ("3 changes of 12 rows", "3 alterações em 12 linhas"),
        ("nothing was changed\n  3 changes\n\n", "nada foi alterado\n  3 alterações\n\n"),
        ("nothing was changed; 3 changes", "nada foi alterado; 3 alterações"),
        ("nothing was changed (3 changes)", "nada foi alterado (3 alterações)"),
        ("nothing was changed, 3 changes", "nada foi alterado, 3 alterações"),
        ("coastal-cpe: nothing was changed", "coastal-cpe: nada foi alterado"),
        ("coastal-cpe: the link was lost", "coastal-cpe: perdeu-se a ligação"),
        ("cpe answers on 8729 of coastal", "em coastal, cpe responde na porta 8729"),
    ],
)
def test_message_is_translated(catalogue: Catalogue, text: str, expected: str) -> None:
    assert catalogue.translate(text) == expected


def test_a_value_that_is_a_message_is_translated(catalogue: Catalogue) -> None:
    text = "stopped by Ctrl-C; nothing was changed"
    assert catalogue.translate(text) == "interrompido por Ctrl-C; nada foi alterado"


def test_nested_messages_are_translated(catalogue: Catalogue) -> None:
    text = "stopped by SIGTERM; coastal-cpe: the link was lost"
    assert catalogue.translate(text) == "interrompido por SIGTERM; coastal-cpe: perdeu-se a ligação"


@pytest.mark.parametrize("name", ["done", "link", "{number}", "ç", "a`b", "\\1", "ether1"])
def test_name_in_a_message_is_never_translated(catalogue: Catalogue, name: str) -> None:
    assert catalogue.translate(f"stopped by {name}; not reached") == f"interrompido por {name}; não alcançado"


def test_text_in_backquotes_is_never_translated(catalogue: Catalogue) -> None:
    text = "type `nothing was changed` to go on"
    assert catalogue.translate(text) == "para continuar, escreva `nothing was changed`"


@pytest.mark.parametrize(
    "text",
    [
        "",
        "\n",
        "an unknown text",
        "unknown: text; and more, of it (really)",
        "failure: already have device with such name",
        "what {} was",
        "all of the rest",
        "of what nobody knows",
        "2024-01-01 12:00:00, +++ of 3",
    ],
)
def test_unknown_text_is_unchanged(catalogue: Catalogue, text: str) -> None:
    assert catalogue.translate(text) == text


def test_device_text_is_not_translated(catalogue: Catalogue) -> None:
    text = "coastal-cpe: the device has refused it: failure: no such item (4)"
    assert catalogue.translate(text) == "coastal-cpe: o equipamento recusou: failure: no such item (4)"


def test_message_with_mostly_unknown_text_is_not_translated(catalogue: Catalogue) -> None:
    text = "cpe: some of what a device says was lost"
    assert catalogue.translate(text) == text


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (
            "`provision report runs inventory=/srv/pilot` lists what is there",
            "`provision report runs inventory=/srv/pilot` lista o que há",
        ),
        (
            "to bring them there, type:  provision site=scc inventory='/a b' --rehearse",
            "para as levar até lá, escreva:  provision site=scc inventory='/a b' --rehearse",
        ),
        ("it goes on with `provision recover resume site=scc`", "prossegue com `provision recover resume site=scc`"),
        (
            "it goes on with `provision recover resume site=scc inventory=x --rehearse`",
            "prossegue com `provision recover resume site=scc inventory=x --rehearse`",
        ),
    ],
)
def test_command_in_a_hint_may_contain_values(catalogue: Catalogue, text: str, expected: str) -> None:
    assert catalogue.translate(text) == expected


def test_preposition_and_article_are_contracted() -> None:
    messages = {"the gateway": "o gateway", "the port of {who} is switched off": "a porta de {who} está desligada"}
    catalogue = Catalogue(messages, {"de o": "do"})
    assert catalogue.translate("the port of the gateway is switched off") == "a porta do gateway está desligada"
    assert catalogue.translate("the port of o is switched off") == "a porta de o está desligada"


def test_table_columns_stay_aligned(catalogue: Catalogue) -> None:
    text = "  cpe      not reached       10.0.0.1\n  router   another text      10.0.0.2"
    expected = "  cpe      não alcançado     10.0.0.1\n  router   another text      10.0.0.2"
    assert catalogue.translate(text) == expected


def test_most_specific_message_wins() -> None:
    either = {"{a} was lost": "perdeu-se {a}", "the link to {a} was lost": "perdeu-se a ligação a {a}"}
    for messages in (either, dict(reversed(either.items()))):
        assert Catalogue(messages).translate("the link to cpe was lost") == "perdeu-se a ligação a cpe"


def test_a_thousand_lines_take_less_than_two_seconds() -> None:
    messages = {f"{{name}} has {word} in {{place}}": f"{{place}}: {word} {{name}}" for word in map(str, range(3000))}
    catalogue = Catalogue(messages)
    started = time.process_time()
    lines = [catalogue.translate(f"cpe{number} has {number} in site{number}") for number in range(1000)]
    assert lines[7] == "site7: 7 cpe7"
    assert time.process_time() - started < 2


def test_english_is_not_translated() -> None:
    assert language.current() is Language.ENGLISH
    assert language.translate("nothing was changed") == "nothing was changed"


@pytest.mark.usefixtures("portuguese")
def test_text_missing_from_catalogue_stays_in_english() -> None:
    assert language.translate("  quite unknown words here") == "  quite unknown words here"


def test_translation_of_a_line_with_many_separators_is_bounded() -> None:
    """The parts of such a line are as many as its pairs of joints: a checklist of 49 items took minutes."""
    found = Catalogue(
        {"not checked": "não verificado", "{name} answers": "{name} responde", "no reply": "sem resposta"}
    )
    line = "not checked at: " + ", ".join(f"robot {number}: link {number}; no reply" for number in range(300))
    assert found.translate(line).count("link") == 300
    assert found._tried <= _MOST_TRIED + 1000
    assert found.translate("robot1 answers") == "robot1 responde"


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("type `provision links site=coastal`", "type `./provision links site=coastal`"),
        ("go on:  provision recover resume site=coastal", "go on:  ./provision recover resume site=coastal"),
        ("  provision inventory init douro", "  ./provision inventory init douro"),
        ("provision itself failed: provision the site first", "provision itself failed: provision the site first"),
    ],
)
def test_commands_are_shown_as_they_are_typed_here(text: str, shown: str, monkeypatch: pytest.MonkeyPatch) -> None:
    assert language.translate(text) == text
    monkeypatch.setattr(language, "_PROGRAM", "./provision")
    assert language.translate(text) == shown
