"""Thousands of names at the command line: refused before a passphrase is asked, or good; no file is left."""

import csv
import os
import subprocess
import sys
from pathlib import Path

import pytest
import yaml
from hostile_names import Hostile, hostile_names
from vpn_desk import Desk, declared, seated

from atlantis_netcfg.vpn.names import LONGEST

NO_PUSH = "--no-push"
ASKS = "and there is no terminal to type it"
"""A good name goes as far as to the passphrase, which nobody types here."""
OTHERS = ["onboard", "partner=iqua", "device=auv1", "kind=robot", NO_PUSH]
TEMPLATES = {
    "device": ["onboard", "partner=iqua", "device={}", "kind=laptop", NO_PUSH],
    "host": ["onboard", "device={}", NO_PUSH],
    "partner": ["onboard", "partner={}", "device=laptop1", "kind=laptop", NO_PUSH],
    "name": ["show", "name={}"],
}
EVERY = {"device": 1, "host": 4, "partner": 4, "name": 4}
"""At the other words every twentieth name is tried."""
WORDS = (*TEMPLATES, "vehicle", "address", "recipient", "kind", "link", "days")
JINJA = ("{{", "{%", "{#")
SAMPLE = ("--help", "../../etc/passwd", "a\nb", "\udcff", "a" * 100_000)
START = "import sys; from atlantis_netcfg.cli import main; sys.exit(main())"


@pytest.fixture
def desk(
    tmp_path: Path,
    tmp_path_factory: pytest.TempPathFactory,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> Desk:
    monkeypatch.chdir(tmp_path)
    return seated(tmp_path_factory.getbasetemp(), tmp_path, capsys, monkeypatch)


def line(word: str, text: str) -> list[str]:
    if word in TEMPLATES:
        return [part.format(text) if part.endswith("{}") else part for part in TEMPLATES[word]]
    return [*(part for part in OTHERS if not part.startswith(f"{word}=")), f"{word}={text}"]


def good(word: str, one: Hostile) -> bool:
    """Whether the name leads on to the passphrase, at this word."""
    if word == "device":
        return one.legitimate and len(f"iqua-{one.text}") <= LONGEST and f"iqua-{one.text}" not in declared().hosts
    return {
        "partner": one.text in declared().partners,
        "vehicle": one.text.casefold() in {"sparus", "sparus2", "girona", "girona500", "mares"},
        "link": one.text in {"fibre", "4g", "satellite"},
        "kind": one.text in {"robot", "laptop", "router"},
    }.get(word, False)


@pytest.mark.smoke("device", "name", "address")
@pytest.mark.parametrize("word", WORDS)
def test_every_hostile_name_is_refused_or_accepted_correctly(word: str, desk: Desk) -> None:
    before = desk.files()
    for one in hostile_names()[:: EVERY.get(word, 20)]:
        code, out, err = desk.type(*line(word, one.text))
        assert (code, out) == (3, ""), one
        if word != "days" or not one.text.isdecimal():
            assert (ASKS in err) == good(word, one), (one, err[:300])
        assert err.replace("\n", "").isprintable(), one
    assert desk.files() == before
    assert {path.name for path in desk.folder.parent.iterdir()} == {"desk"}


def test_hostile_positional_argument_is_a_usage_error(desk: Desk) -> None:
    before = desk.files()
    for one in hostile_names()[::10]:
        if one.text not in {"--help", "-h", "--json"}:
            code, _, err = desk.type(*OTHERS, one.text)
            assert code == 3, one
            assert err.replace("\n", "").isprintable(), one
    assert desk.files() == before


@pytest.mark.parametrize("suffix", ["yml", "csv"])
def test_every_invalid_name_in_a_file_is_refused_with_its_line(suffix: str, desk: Desk, tmp_path: Path) -> None:
    """NUL can only come this way: no argument of a program holds one."""
    bad = [one.text for one in hostile_names() if not one.legitimate and can_be_written(one.text)]
    assert len(bad) > 2000
    file, before = tmp_path / f"batch.{suffix}", desk.files()
    write(file, bad)
    code, out, err = desk.type("onboard", f"batch={file}", NO_PUSH)
    assert (code, out) == (3, "")
    assert err.replace("\n", "").isprintable()
    assert err.count(f"error: {file}:") == len(bad)
    assert desk.files() == before


def can_be_written(text: str) -> bool:
    """As UTF-8, and without what the file itself is refused for."""
    return 0 < len(text) < 5000 and "\udcff" not in text and not any(mark in text for mark in JINJA)


def write(file: Path, devices: list[str]) -> None:
    rows = [{"partner": "iqua", "device": text, "kind": "laptop"} for text in devices]
    if file.suffix == ".yml":
        file.write_text(yaml.safe_dump(rows, width=10_000), encoding="utf-8")
        return
    with file.open("w", encoding="utf-8", newline="") as opened:
        lines = csv.DictWriter(opened, list(rows[0]))
        lines.writeheader()
        lines.writerows(rows)


@pytest.mark.parametrize("text", JINJA)
def test_jinja_expression_in_a_file_is_refused(text: str, desk: Desk, tmp_path: Path) -> None:
    write(tmp_path / "batch.yml", ["auv1", f"{text} 7*7 "])
    code, _, err = desk.type("onboard", f"batch={tmp_path / 'batch.yml'}", NO_PUSH)
    assert (code, "batch.yml:4: this is a Jinja expression" in err) == (3, True), err


@pytest.mark.smoke("'--help'")
@pytest.mark.parametrize("text", SAMPLE, ids=lambda text: ascii(text)[:20])
def test_separate_process_gives_the_same_error(text: str, desk: Desk) -> None:
    before = desk.files()
    done = subprocess.run(
        [sys.executable, "-c", START, "vpn", *line("device", text), f"authority={desk.authority}"],
        stdin=subprocess.DEVNULL,
        capture_output=True,
        env={**os.environ, "PYTHONPATH": str(Path(__file__).parents[4])},
        check=False,
    )
    assert (done.returncode, done.stdout) == (3, b""), done
    assert done.stderr.startswith(b"error: device `")
    assert desk.files() == before
