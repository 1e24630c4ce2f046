"""The program on the server that notes when each member was last seen."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

PROGRAM = Path(__file__).parents[3] / "templates" / "openvpn" / "vpn_seen.py"
NAMES = "Common Name\tReal Address\tVirtual Address\tVirtual IPv6 Address\tBytes Received"


def status(time: int, *names: str, end: str = "END\n") -> str:
    rows = "".join(
        f"CLIENT_LIST\t{name}\t192.0.2.7:5{number}\t10.80.16.{number}\t\t1\n" for number, name in enumerate(names)
    )
    return f"TITLE\tOpenVPN\nTIME\t2026-11-22 07:00:00\t{time}\nHEADER\tCLIENT_LIST\t{NAMES}\n{rows}{end}"


def noted(folder: Path, text: str | None) -> dict[str, dict[str, object]]:
    if text is not None:
        (folder / "status").write_text(text)
    place = folder / "seen.json"
    subprocess.run([sys.executable, "-I", str(PROGRAM), str(folder / "status"), str(place)], check=True)
    return json.loads(place.read_text())["seen"] if place.exists() else {}


def test_who_is_listed_is_noted_and_kept(tmp_path: Path) -> None:
    first = noted(tmp_path, status(100, "inesc-a", "inesc-b", "UNDEF"))
    assert first.keys() == {"inesc-a", "inesc-b"}
    assert first["inesc-b"] == {"last": 100, "real": "192.0.2.7:51", "address": "10.80.16.1"}
    later = noted(tmp_path, status(200, "inesc-b"))
    assert (later["inesc-a"]["last"], later["inesc-b"]["last"]) == (100, 200)


@pytest.mark.parametrize("text", [None, "", "TITLE\tOpenVPN\n", status(100, "inesc-a", end="")])
def test_half_a_status_is_no_news(tmp_path: Path, text: str | None) -> None:
    assert noted(tmp_path, text) == {}


@pytest.mark.parametrize("text", ["", "{", "[]", '{"format": 2, "seen": {}}', '{"format": 1}'])
def test_a_file_that_cannot_be_read_is_begun_again(tmp_path: Path, text: str) -> None:
    (tmp_path / "seen.json").write_text(text)
    assert noted(tmp_path, status(100, "inesc-a")).keys() == {"inesc-a"}
