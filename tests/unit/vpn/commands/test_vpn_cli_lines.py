"""The VPN's commands with words that cannot be right: golden/lines.txt reads like a console in an empty folder.

No passphrase is there to be typed: whatever is refused here is refused before one is asked for.
"""

import shlex
from pathlib import Path

import pytest
from vpn_desk import founded, reading_once

from atlantis_netcfg.cli import main

GOLDEN = Path(__file__).with_name("golden") / "lines.txt"
CASES = [block.partition("\n")[::2] for block in GOLDEN.read_text(encoding="utf-8").strip().split("\n\n")]


@pytest.mark.parametrize(("line", "said"), CASES, ids=[line for line, _ in CASES])
def test_mistake_is_reported_and_changes_nothing(  # noqa: PLR0913, PLR0917 - a case, and fixtures
    line: str,
    said: str,
    tmp_path: Path,
    tmp_path_factory: pytest.TempPathFactory,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    base = founded(tmp_path_factory.getbasetemp())
    before = {path: path.read_bytes() for path in base.rglob("*") if path.is_file()}
    capsys.readouterr()
    reading_once(monkeypatch)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("ATLANTIS_STATE", str(tmp_path / "state"))
    typed = shlex.split(line.removeprefix("$ provision ").replace("FOUNDED", str(base / "vpn")))
    code = main(typed)
    printed = capsys.readouterr()
    told = printed.err.replace(str(base / "vpn"), "FOUNDED").replace(str(tmp_path), "HERE")
    assert f"{told.strip()}\nexit {code}" == said.strip()
    assert printed.out == ""
    assert [path for path in tmp_path.rglob("*") if path.is_file()] == []
    assert {path: path.read_bytes() for path in base.rglob("*") if path.is_file()} == before
