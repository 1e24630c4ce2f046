"""Templates are compiled once: a start takes what an earlier one has compiled, unless something has changed."""

import os
from pathlib import Path

import pytest
from jinja2 import Environment, FileSystemLoader

from atlantis_netcfg.routeros.render import get_template_cache


@pytest.fixture
def kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Where compiled templates are kept."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    return tmp_path / "cache" / "atlantis" / "templates"


@pytest.fixture
def template(tmp_path: Path) -> Path:
    """A template with one word."""
    path = tmp_path / "word.j2"
    path.write_text("{{ word | upper }}, {{ 'folded' | upper }}")
    return path


class Start(Environment):
    """The environment of one start, which counts what it compiles."""

    def __init__(self, folder: Path, *modules: str) -> None:
        super().__init__(loader=FileSystemLoader(folder), bytecode_cache=get_template_cache(*modules))
        self.made = 0

    def _compile(self, source: str, filename: str) -> object:  # type: ignore[override]  # a code object
        self.made += 1
        return super()._compile(source, filename)

    def render(self) -> tuple[str, int]:
        """The text, and how many templates were compiled for it."""
        return self.get_template("word.j2").render(word="done"), self.made


def test_the_second_start_compiles_nothing(kept: Path, template: Path) -> None:
    assert Start(template.parent, __file__).render() == ("DONE, FOLDED", 1)
    assert len(list(kept.iterdir())) == 1
    assert Start(template.parent, __file__).render() == ("DONE, FOLDED", 0)


@pytest.mark.usefixtures("kept")
def test_a_template_that_has_changed_is_compiled_again(template: Path) -> None:
    Start(template.parent, __file__).render()
    template.write_text("now {{ word }}")
    assert Start(template.parent, __file__).render() == ("now done", 1)
    assert Start(template.parent, __file__).render() == ("now done", 0)


@pytest.mark.usefixtures("kept")
def test_changed_filters_cause_a_recompile(template: Path, tmp_path: Path) -> None:
    filters = tmp_path / "filters.py"
    filters.write_text("as it was")
    Start(template.parent, str(filters)).render()
    filters.write_text("as it is")
    assert Start(template.parent, str(filters)).render() == ("DONE, FOLDED", 1)


@pytest.mark.parametrize("cut", [0, 3, 20, 40, 90, -1])
def test_damaged_cache_file_is_replaced(cut: int, kept: Path, template: Path) -> None:
    Start(template.parent, __file__).render()
    (file,) = kept.iterdir()
    whole = file.read_bytes()
    for damaged in (whole[:cut], whole[:cut] + bytes(len(whole) - len(whole[:cut]))):
        file.write_bytes(damaged)
        assert Start(template.parent, __file__).render()[0] == "DONE, FOLDED"
        assert file.read_bytes() == whole


def test_unusable_cache_folder_is_ignored(kept: Path, template: Path) -> None:
    start = Start(template.parent, __file__)
    kept.rmdir()
    assert start.render() == ("DONE, FOLDED", 1)
    kept.write_text("a file in its place")
    assert Start(template.parent, __file__).render() == ("DONE, FOLDED", 1)


def test_old_cache_files_are_removed_on_compile(kept: Path, template: Path) -> None:
    Start(template.parent, __file__).render()
    (first,) = kept.iterdir()
    os.utime(first, (0, 0))
    assert Start(template.parent, __file__).render() == ("DONE, FOLDED", 0)
    other = template.parent / "elsewhere"
    other.mkdir()
    template.rename(other / template.name)
    assert Start(other, __file__).render() == ("DONE, FOLDED", 1)
    (second,) = kept.iterdir()
    assert second != first
