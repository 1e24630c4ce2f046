"""Compiled catalogues: what the .po has, never outdated, and no start fails over one."""

import gettext
import sys
from pathlib import Path

import pytest

from atlantis_netcfg.core import language
from atlantis_netcfg.core.compiled_catalogue import CompiledCatalogue, compile_catalogue, load, read
from atlantis_netcfg.core.language import Language
from atlantis_netcfg.core.translation import number_values

PO = (
    'msgid ""\nmsgstr ""\n"Language: pt_PT\\n"\n\nmsgid "{a} of {b}"\nmsgstr "{b} em {a}"\n\nmsgid "no"\nmsgstr "não"\n'
)
ENTRIES = {"{0} of {1}": "{1} em {0}", "no": "não"}


@pytest.fixture
def source(tmp_path: Path) -> Path:
    path = tmp_path / "provision.po"
    path.write_text(PO)
    return path


@pytest.fixture
def compiled(source: Path) -> Path:
    load(source)
    return source.with_suffix(".mo")


def test_every_message_of_the_source_is_in_the_compiled_catalogue() -> None:
    translations = read(language.catalogue_file(Language.PORTUGUESE))
    catalogue = load(language.catalogue_file(Language.PORTUGUESE))
    assert dict(catalogue) == dict(number_values(msgid, text) for msgid, text in translations.items())
    assert len(catalogue) > 3000


def test_gettext_reads_the_compiled_catalogue(compiled: Path) -> None:
    with compiled.open("rb") as file:
        catalogue = gettext.GNUTranslations(file)
    assert {text: catalogue.gettext(text) for text in ENTRIES} == ENTRIES
    assert catalogue.info()["content-type"] == "text/plain; charset=UTF-8"


def test_unknown_texts_are_missing(source: Path) -> None:
    catalogue = load(source)
    assert [text for text in ("", "a", "zz", "{0}", "no\0", "\udce9") if text in catalogue] == []


def test_compiled_catalogue_is_used_while_its_source_is_unchanged(source: Path, compiled: Path) -> None:
    first = compiled.stat()
    assert dict(load(source)) == ENTRIES
    assert compiled.stat() == first
    assert first.st_mode & 0o777 == 0o644


@pytest.mark.parametrize("text", [PO.replace("não", "sim"), PO + '\nmsgid "more"\nmsgstr "mais"\n'])
def test_changed_source_is_compiled_again(source: Path, compiled: Path, text: str) -> None:
    before = compiled.read_bytes()
    source.write_text(text)
    assert dict(load(source)) == dict(number_values(*item) for item in read(source).items())
    assert compiled.read_bytes() != before
    assert dict(load(source)) != ENTRIES


def test_installed_package_needs_no_source(source: Path, compiled: Path) -> None:
    source.unlink()
    assert compiled.is_file()
    assert dict(load(source)) == ENTRIES


def test_incomplete_file_is_written_again(source: Path, compiled: Path) -> None:
    whole = compiled.read_bytes()
    for length in range(len(whole)):
        compiled.write_bytes(whole[:length])
        assert dict(load(source)) == ENTRIES
        assert compiled.read_bytes() == whole


def test_no_damage_stops_a_start(source: Path, compiled: Path) -> None:
    whole = compiled.read_bytes()
    for place in range(len(whole)):
        compiled.write_bytes(whole[:place] + b"\xff" + whole[place + 1 :])
        catalogue = load(source)
        assert isinstance(catalogue.get("no", "no"), str)


def test_without_any_file_messages_stay_in_english(source: Path, compiled: Path) -> None:
    source.unlink()
    compiled.write_bytes(b"no catalogue")
    assert dict(load(source)) == {}


def test_unwritable_file_is_no_error(source: Path) -> None:
    source.with_suffix(".mo").mkdir()
    assert dict(load(source)) == ENTRIES


def test_same_translations_give_the_same_bytes(source: Path) -> None:
    translations = read(source)
    backwards = dict(reversed(translations.items()))
    assert compile_catalogue(translations, "x") == compile_catalogue(backwards, "x")
    assert CompiledCatalogue(compile_catalogue({}, "x")).metadata == "x"


@pytest.mark.parametrize(
    ("msgid", "translation", "expected"),
    [
        ("{a} of {b}", "{b} em {a} de {b}", ("{0} of {1}", "{1} em {0} de {1}")),
        ("what {{}} is, in {name}", "{{}}, em {name}", ("what {{}} is, in {0}", "{{}}, em {0}")),
        ("no", "não", ("no", "não")),
    ],
)
def test_values_are_numbered_in_the_order_of_the_text(msgid: str, translation: str, expected: tuple[str, str]) -> None:
    assert number_values(msgid, translation) == expected


def test_catalogue_is_parsed_in_few_calls() -> None:
    """Calls, those of C too; with eight a message a command in Portuguese took four times as long to begin."""
    steps = 0

    def count(_frame: object, event: str, _function: object) -> None:
        nonlocal steps
        steps += event in {"call", "c_call"}

    path = language.catalogue_file(Language.PORTUGUESE)
    sys.setprofile(count)
    messages = read(path)
    sys.setprofile(None)
    assert steps < 6 * len(messages)


def test_gettext_file_is_parsed(tmp_path: Path) -> None:
    file = tmp_path / "provision.po"
    file.write_text(
        'msgid ""\nmsgstr ""\n"Language: pt_PT\\n"\n\n'
        '#: a.py\n#, python-brace-format\nmsgid "a \\"{b}\\""\nmsgstr "um \\"{b}\\""\n\n'
        'msgid ""\n"of two "\n"lines"\nmsgstr ""\n"de duas "\n"linhas\\\\n"\n\n'
        'msgid "no translation"\nmsgstr ""\n\n'
        '#, fuzzy\nmsgid "a guess"\nmsgstr "um palpite"\n\n'
        '#~ msgid "gone"\n#~ msgstr "foi-se"\n'
    )
    assert read(file) == {'a "{b}"': 'um "{b}"', "of two lines": "de duas linhas\\n"}
