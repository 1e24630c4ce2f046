"""What is printed shows every character, and obeys none; JSON stays JSON."""

import io
import json
import os
import shlex
import subprocess
import sys
import unicodedata
from functools import partial
from types import SimpleNamespace
from typing import Any

import pytest
from impostor import HOSTILE, control_characters
from pilot_commands import Table
from terminal import terminal

from atlantis_netcfg.cli import main, media
from atlantis_netcfg.cli.base.output import progress
from atlantis_netcfg.cli.base.syntax import Arguments
from atlantis_netcfg.core import printable
from atlantis_netcfg.core.errors import DeviceError, ExitCode
from atlantis_netcfg.core.events import Event, Stage
from atlantis_netcfg.core.printable import Style, StyledText

EVERY = "".join(map(chr, range(0x3000))) + "\ud83e\udd16\ufeff\ufff9\U000e0041"


def test_control_characters_are_shown_escaped() -> None:
    told = printable.line(EVERY)
    assert told.isprintable()
    assert not [one for one in told if unicodedata.category(one) in {"Cc", "Cf", "Zl", "Zp", "Cs", "Cn"}]
    assert json.loads(f'"{printable.line(HOSTILE)}"') == HOSTILE
    assert printable.lines("a\nb\tc") == "a\nb\\u0009c"
    assert printable.line("\U000e0041") == "\\udb40\\udc41"


def test_printable_text_stays() -> None:
    for text in ("čaj 🤖", "", "São João, 25 °C…", "漢字"):
        assert printable.line(text) == printable.lines(text) == printable.visible(text) == text


@pytest.mark.parametrize(
    ("text", "width", "wrapped"),
    [
        ("  one two three", 0, "  one two three"),
        ("  one two three", 10, "  one two\n  three"),
        ("type `provision plan` now", 20, "type\n`provision plan` now"),
        ("a-very-long-word-indeed", 10, "a-very-long-word-indeed"),
        ("  ./provision check site=coastal vehicle=x", 30, "  ./provision check \\\n  site=coastal vehicle=x"),
        ('  "key": "one two three",', 10, '  "key": "one two three",'),
        ("short\none two three\n", 8, "short\none two\nthree\n"),
    ],
)
def test_long_line_is_wrapped_between_words(text: str, width: int, wrapped: str) -> None:
    assert printable.wrap_lines(text, width) == wrapped


@pytest.mark.parametrize("width", [20, 40, 80])
def test_wrapped_command_is_the_same_to_a_shell(width: int) -> None:
    command = "./provision vpn onboard partner=iqua device=sparus2 contact='Ana, +351 210 000 000' --no-push"
    lines = printable.fill_command(command, width)
    assert len(lines) > 1
    pasted = "\n          ".join(lines)
    shell = subprocess.run(["sh", "-c", f"printf '%s\\n' {pasted}"], capture_output=True, text=True, check=True)
    assert shell.stdout.splitlines() == shlex.split(command)


def test_printer_wraps_on_a_terminal_only() -> None:
    text = "word " * 30 + "\n"
    with terminal(80) as shown, os.fdopen(os.dup(shown.descriptor), "w") as stream:
        printable.Printer(stream).write(text)
    assert [line for line in shown.lines if line] == [("word " * 16).strip(), ("word " * 14).strip()]
    file = io.StringIO()
    printable.Printer(file).write(text)
    assert file.getvalue() == text


def test_a_row_with_a_long_path_keeps_the_path_whole_on_a_terminal() -> None:
    path = f"~/{'x' * 75}"
    with terminal(80) as shown, os.fdopen(os.dup(shown.descriptor), "w") as stream:
        printable.show([("report: ", StyledText(path, Style.QUIET)), "  kept in " + "many words " * 9], stream)
    lines = [line for line in shown.lines if line]
    kept = "  kept in many words many words many words many words many words many words many"
    assert lines == ["report:", path, kept, "  words many words many words"]


def test_nested_data_is_cleaned() -> None:
    told = {"a": ["\x1b", {"b": ("\u202e", 1, None)}], "c": True}
    assert printable.clean(told) == {"a": ["\\u001b", {"b": ["\\u202e", 1, None]}], "c": True}
    assert printable.clean({"\x1b\n": {"\u202e": 1}}) == {"\\u001b\\u000a": {"\\u202e": 1}}


@pytest.mark.parametrize("stream", ["stdout", "stderr"])
def test_all_output_is_filtered(
    stream: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """No command has to think of it, and `--json` is read as it was."""

    def act(_arguments: Arguments) -> ExitCode:
        print(HOSTILE, file=getattr(sys, stream))
        print(json.dumps({"said": HOSTILE}, ensure_ascii=False), file=getattr(sys, stream))
        return ExitCode.DONE

    assert main(["site=coastal"], table=Table(monkeypatch, act)) == ExitCode.DONE
    text = getattr(capsys.readouterr(), "out" if stream == "stdout" else "err")
    assert control_characters(text) == []
    assert json.loads(text.splitlines()[-1]) == {"said": HOSTILE}


def test_error_with_device_output_has_no_control_characters(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def act(_arguments: Arguments) -> ExitCode:
        raise DeviceError(f"refused: {HOSTILE}", hint=HOSTILE)

    assert main(["site=coastal"], table=Table(monkeypatch, act)) == ExitCode.FAILED
    text = capsys.readouterr().err
    assert control_characters(text) == []
    assert [line for line in text.splitlines() if not line.startswith(("error: ", "       "))] == []


def _noted(asked: list[str], question: str) -> str:
    asked.append(question)
    return "no"


def test_prompt_with_a_card_name_has_no_control_characters(monkeypatch: pytest.MonkeyPatch) -> None:
    """Python hands a question to the terminal itself, past every stream of ours."""
    asked: list[str] = []
    monkeypatch.setattr("builtins.input", partial(_noted, asked))
    monkeypatch.setattr("sys.stdin", Screen())
    card: Any = SimpleNamespace(disk=SimpleNamespace(serial=HOSTILE, proof=HOSTILE))
    assert media._ask_serial(card) == "no"
    assert "evil" in asked[0]
    assert control_characters(asked[0]) == []


class Screen(io.StringIO):
    def isatty(self) -> bool:
        return True


@pytest.mark.parametrize("out", [io.StringIO, Screen])
def test_progress_with_device_output_has_no_control_characters(out: type[io.StringIO]) -> None:
    """On a terminal rich draws, with escapes of its own: none of the device's is among them."""
    shown = out()
    with progress(quiet=False, out=printable.Printer(shown)) as notify:  # type: ignore[arg-type] # it is one by its methods
        notify(Event("router", Stage.FAILED, HOSTILE))
    text = shown.getvalue()
    assert "evil" in text
    assert not [
        one for one in ("\x1b]", "\x07", "\x1b[2J\\", "\u202e", "\x9b", "\u2066", "\tevil", "\x7f") if one in text
    ]
    if out is io.StringIO:
        assert control_characters(text) == []


def test_line_is_wrapped_between_words_without_loss() -> None:
    row = ("  coastal-router     ", StyledText("applied and verified by a rather long sentence", Style.GOOD), " (1 s)")
    assert printable.wrap_row(row, 0, 21) == [row]
    for width in range(30, 90):
        lines = [printable.plain(line) for line in printable.wrap_row(row, width, 21)]
        assert " ".join(" ".join(lines).split()) == " ".join(printable.plain(row).split())
        assert all(len(line) <= width and line == line.rstrip() for line in lines)
        assert all(line.startswith(" " * 21) for line in lines[1:])
    pieces = [piece for line in printable.wrap_row(row, 40, 21) if isinstance(line, tuple) for piece in line]
    assert {piece.style for piece in pieces if isinstance(piece, StyledText)} == {Style.GOOD}


def test_word_longer_than_the_line_stays_whole() -> None:
    (first, second) = printable.wrap_row("see ~/.local/state/atlantis/real/coastal/runs", 20, 2)
    assert [printable.plain(line) for line in (first, second)] == ["see", "  ~/.local/state/atlantis/real/coastal/runs"]


class ColourScreen(io.StringIO):
    def isatty(self) -> bool:
        return True


@pytest.mark.parametrize(
    ("environment", "coloured"),
    [
        ({"TERM": "xterm"}, True),
        ({"TERM": "xterm", "NO_COLOR": "1"}, False),
        ({"TERM": "xterm", "NO_COLOR": ""}, True),
        ({"TERM": "dumb"}, False),
        ({}, False),
    ],
)
def test_colours_only_on_terminals_that_support_them(
    environment: dict[str, str],
    coloured: bool,  # noqa: FBT001 - a value of the table
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.delenv("NO_COLOR", raising=False)
    monkeypatch.delenv("TERM", raising=False)
    for name, value in environment.items():
        monkeypatch.setenv(name, value)
    rows: list[printable.Row] = [(StyledText("[OK]", Style.GOOD), " done \x1b[31m"), StyledText("a\x1b[0m", Style.BAD)]
    for out, shown in ((ColourScreen(), coloured), (io.StringIO(), False)):
        printable.show(rows, out)
        start, end = ("\x1b[32m", "\x1b[0m") if shown else ("", "")
        bad = "\x1b[31m" if shown else ""
        assert out.getvalue() == f"{start}[OK]{end} done \\u001b[31m\n{bad}a\\u001b[0m{end}\n"


def test_ascii_stream_gets_the_nearest_letters() -> None:
    raw = io.BytesIO()
    with io.TextIOWrapper(raw, "ascii", printable.ASCII) as out:
        out.write("não é São João … « » — 漢")
        out.flush()
        assert raw.getvalue() == b'nao e Sao Joao ... " " - ?'
