"""The Portuguese catalogue: complete, true to the values of each message, and in European forms."""

import importlib.util
import re
import sys
from pathlib import Path
from string import Formatter
from types import ModuleType

import pytest

from atlantis_netcfg.cli.base.commands import COMMANDS, load
from atlantis_netcfg.cli.help import of_command, overview
from atlantis_netcfg.core import language
from atlantis_netcfg.core.compiled_catalogue import read
from atlantis_netcfg.core.language import Language, catalogue_file

ROOT = Path(__file__).parents[3]
GLOSSARY = ROOT / "docs" / "pt" / "glossario.md"


def extraction() -> ModuleType:
    spec = importlib.util.spec_from_file_location("messages", ROOT / "tools" / "messages.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["messages"] = module
    spec.loader.exec_module(module)
    return module


MESSAGES = extraction()
TRANSLATIONS = read(catalogue_file(Language.PORTUGUESE))


def names(text: str) -> list[str]:
    return sorted(name for _, name, _, _ in Formatter().parse(text) if name is not None)


def test_every_message_of_the_source_has_a_translation() -> None:
    in_source: dict[str, list[str]] = MESSAGES.messages()
    missing = [f"{files[0]}: {msgid}" for msgid, files in in_source.items() if msgid not in TRANSLATIONS]
    assert missing == [], "run tools/messages.py, then translate what has an empty msgstr"
    assert len(in_source) > 3000


@pytest.mark.parametrize("name", COMMANDS)
def test_every_text_of_help_has_a_translation(name: str) -> None:
    command = load(name, COMMANDS).command
    helps = [*(word.help for word in command.words), *(flag.help for flag in command.flags)]
    texts = [command.summary, *command.details.split("\n"), *helps]
    assert [text for text in texts if text and text not in TRANSLATIONS] == []


def test_the_tool_reads_the_same_translations_as_the_program() -> None:
    written = MESSAGES.read(catalogue_file(Language.PORTUGUESE))
    assert {msgid: written.get(msgid) for msgid in TRANSLATIONS} == TRANSLATIONS


def test_entries_with_the_same_text_have_the_same_translation() -> None:
    assert MESSAGES.conflicts(TRANSLATIONS) == []
    same = {"{count} of {total}": "{count} de {total}", "{first} of {second}": "{second} em {first}"}
    assert MESSAGES.conflicts(same) == ["{first} of {second}"]
    assert MESSAGES.conflicts({**same, "{first} of {second}": "{first} de {second}"}) == []


def test_translations_have_the_same_placeholders() -> None:
    assert {msgid: names(text) for msgid, text in TRANSLATIONS.items() if names(msgid) != names(text)} == {}


def test_a_command_in_a_message_is_the_same_in_both_languages() -> None:
    commands = re.compile(r"`(provision [^`]*)`")
    differing = {
        msgid for msgid, text in TRANSLATIONS.items() if set(commands.findall(msgid)) != set(commands.findall(text))
    }
    assert differing == set()


def brazilian() -> dict[str, str]:
    """Wrong form -> the right one, by the glossary."""
    rows = re.findall(r"^\| [^|]+ \| ([^|]+) \| ([^|]+) \|$", GLOSSARY.read_text(), re.MULTILINE)
    return {form.strip(): right for right, wrong in rows for form in wrong.split(",") if form.strip(" -")}


def test_the_glossary_is_read() -> None:
    assert brazilian()["senha"] == "palavra-passe"
    assert len(brazilian()) > 50


def test_no_translation_has_a_brazilian_form() -> None:
    forms = {form: re.compile(rf"(?<![\w-]){re.escape(form)}(?![\w-])", re.IGNORECASE) for form in brazilian()}
    forms.pop("Errado aqui", None)
    found = []
    for msgid, text in TRANSLATIONS.items():
        bare = re.sub(r"`[^`]*`|\{\w*\}", "", text)
        found += [f"{form}: {text}" for form, pattern in forms.items() if pattern.search(bare) and text != msgid]
    assert found == []


@pytest.mark.usefixtures("portuguese")
@pytest.mark.parametrize("name", ["", *COMMANDS])
def test_help_is_no_wider_than_in_english(name: str) -> None:
    def page() -> list[str]:
        return (of_command(load(name, COMMANDS).command, COMMANDS) if name else overview(COMMANDS)).splitlines()

    portuguese = page()
    language.use(Language.ENGLISH)
    assert max(map(len, portuguese)) <= max(80, *map(len, page()))


def test_command_names_are_not_translated() -> None:
    translated = {name for name in COMMANDS if TRANSLATIONS.get(name, name) != name}
    assert translated == {"check", "plan"}, "labels of the last lines of a run, too"


@pytest.mark.parametrize(
    ("source", "found"),
    [
        ('raise Gone(f"{host.name} is gone: {error}", hint="look there")', ["{name} is gone: {error}", "look there"]),
        ('print(f"{len(changes)} changes left")', ["{changes} changes left"]),
        ('x = f"{a} change{\'\' if a == 1 else \'s\'} left"', ["{a} change left", "{a} changes left"]),
        ('x = f"{name} and {name} differ"', ["{name} and {name2} differ"]),
        ('x = "one line here\\n  another line here"', ["one line here", "another line here"]),
        ('"""A docstring of two words."""', []),
        ('x = data["a key here"]', []),
        ('x = re.compile("a pattern here")', []),
        ('x = y == "what is compared"', []),
        ('x = "/ip address print where disabled"', []),
        ('print("done")', ["done"]),
        ('CommandSpec("go", "go there", flags=(Flag("all", "go everywhere"),))', ["go there", "go everywhere"]),
        ('x = "done"', []),
    ],
)  # fmt: skip
def test_messages_are_extracted_from_source(source: str, found: list[str]) -> None:
    assert list(MESSAGES.of_source(source)) == found


def test_text_blocks_of_an_enrolment_package_are_extracted() -> None:
    source = (
        'The VPN of {{ page.pilot }}\n{{ "=" * (11 + page.pilot | length) }}\n\n'
        "Type what\nstands here.{% if page.dds %} And this.{% endif %}\n\n"
        "    sudo something\n\n- one thing\n  more\n- two things\n"
    )
    assert list(MESSAGES.of_handout(source)) == [
        *("The VPN of {pilot}", "Type what stands here. And this.", "Type what stands here."),
        *("one thing more", "two things"),
    ]
