"""The manual page is made from the same table as `--help`, and `man`, groff and mandoc have nothing against it."""

import os
import re
import shutil
import subprocess

import pytest
from waiting import HANG_S

from atlantis_netcfg.cli import main
from atlantis_netcfg.cli.base.commands import COMMANDS, DEFAULT, load
from atlantis_netcfg.cli.base.syntax import FRAME
from atlantis_netcfg.cli.help import MEANING

ACCEPTED = ('missing date, using "": TH',)
"""What mandoc may say: a page that is made when it is asked for has no date of its own."""


@pytest.fixture
def page(capsys: pytest.CaptureFixture[str]) -> str:
    assert main(["help", "man"]) == 0
    return capsys.readouterr().out


def run(program: str, *words: str, page: str) -> subprocess.CompletedProcess[str]:
    if shutil.which(program) is None:
        pytest.skip(f"{program} is not installed")
    environment = {**os.environ, "MANWIDTH": "80", "MAN_KEEP_FORMATTING": "", "LC_ALL": "C.UTF-8", "MANPAGER": "cat"}
    return subprocess.run(
        [program, *words], input=page, env=environment, capture_output=True, text=True, check=False, timeout=HANG_S
    )


def test_man_page_is_complete_in_eighty_columns(page: str) -> None:
    shown = run("man", "--warnings", "-l", "-", page=page)
    assert (shown.returncode, shown.stderr) == (0, "")
    assert [line for line in shown.stdout.splitlines() if len(line) > 80] == []
    text = " ".join(shown.stdout.split())
    for name in COMMANDS:
        command = load(name, COMMANDS).command
        shown_as = "site=NAME" if name == DEFAULT else name
        assert f" provision {shown_as} {command.summary} " in text
        for word in command.words:
            assert f" {word.usage} {word.help}" in text
        for flag in (*command.flags, *FRAME):
            assert f" {flag.usage} {flag.help}" in text
        assert " ".join(command.details.split()) in text
    for code, meaning in MEANING.items():
        assert f" {int(code)} {meaning}" in text


def test_groff_gives_no_warnings(page: str) -> None:
    done = run("groff", "-ww", "-man", "-Tutf8", page=page)
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout


def test_mandoc_gives_no_warnings(page: str) -> None:
    done = run("mandoc", "-Tlint", page=page)
    assert [line for line in done.stdout.splitlines() if not line.endswith(ACCEPTED)] == []
    assert "unknown macro" in run("mandoc", "-Tlint", page=f"{page}\n.XX\n").stdout


def test_text_copied_from_the_page_can_be_typed(page: str) -> None:
    """A plain `-` in roff becomes a hyphen, and `--plan` copied from such a page is no flag."""
    assert re.findall(r"(?<!\\)-", page) == []
    assert page.isascii()
