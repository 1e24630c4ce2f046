"""Text of a device through every door of every command that asks one: nothing of it is obeyed, and none begins a line.

The control characters of a device are looked for on the output and the error output, in the JSON as it is printed, and
in the files that a command writes.
"""

from __future__ import annotations

import json
import subprocess
from typing import TYPE_CHECKING

import pytest
from impostor import (
    HOSTILE,
    control_characters,
    fake_lines,
    hostile,
    in_every,
    leaving_out,
    refused_login,
    refusing,
)
from npk_files import write
from quay import PROVISION, ROUTER, Quay, quay

from atlantis_netcfg.journal import Store

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from impostor import Answer

pytestmark = [pytest.mark.slow, pytest.mark.namespace]

SAID: dict[str, Answer] = {
    "texts": in_every("comment", "board-name", "message", "ssid", "host-name", "identity", "address-list", "contact"),
    "everything": in_every(),
    "refusals": refusing,
    "login": refused_login,
}
"""In what a device may put it: the texts of its rows, every value, its refusals, and what it says to a login."""
ASKING: dict[str, tuple[str, ...]] = {
    "plan": ("site=coastal", "--plan"),
    "change": ("site=coastal", "--yes"),
    "drift": ("drift", "site=coastal", "--junit=DRIFT"),
    "backup": ("backup", "site=coastal"),
    "resume": ("resume", "site=coastal"),
    "links": ("links", "site=coastal", "--accept-cost"),
    "prove": ("prove", "site=coastal", "--accept-cost"),
    "upgrade": ("upgrade", "site=coastal", f"device={ROUTER}", "packages=PACKAGE", "--plan"),
    "check": ("check", "site=coastal", "--accept-cost", "--anew"),
}


@pytest.fixture
def at(tmp_path: Path) -> Iterator[Quay]:
    with quay(tmp_path) as opened:
        yield opened


@pytest.mark.parametrize("said", SAID)
@pytest.mark.parametrize("asked", ASKING)
def test_nothing_of_it_is_obeyed(at: Quay, tmp_path: Path, asked: str, said: str) -> None:
    files = {"DRIFT": tmp_path / "drift.xml", "PACKAGE": write(tmp_path, "routeros", "7.21.5", "arm64")}
    words = [_named(word, files) for word in ASKING[asked]]
    with hostile(tmp_path, at.door.port, SAID[said]) as device:
        at.door.port = device.port
        Store(at.state).pins.change(ROUTER, device.fingerprint)
        for more in ((), ("--json",)):
            done = _typed(at, *words, *more)
            assert "provision itself failed" not in done.stdout + done.stderr
            for text in (done.stdout, done.stderr):
                assert control_characters(text) == []
                assert fake_lines(text) == []
            if more:
                json.loads(done.stdout)
    for file in written(at, files["DRIFT"]):
        assert control_characters(file.read_text(encoding="utf-8")) == [], file.name


def _named(word: str, files: dict[str, Path]) -> str:
    for name, file in files.items():
        word = word.replace(name, str(file))
    return word


def _typed(at: Quay, *words: str) -> subprocess.CompletedProcess[str]:
    """Type it, however it ends: refused, drifted, planned, done, not known."""
    done = subprocess.run(
        [PROVISION, *words, *at.only(words), f"inventory={at.inventory}"],
        env=at.environment(),
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode in {0, 2, 4, 5, 6}, f"exit {done.returncode}\n{done.stdout}\n{done.stderr}"
    return done


def written(at: Quay, drift: Path) -> list[Path]:
    """What is meant for people and other programs; journals and saved states are kept as the device has said it."""
    kinds = {".html", ".xml", ".json"}
    pages = [path for path in at.state.rglob("checklist*/**/*") if path.suffix in kinds]
    return [*pages, *([drift] if drift.exists() else [])]


MISSING = {
    "number": (".id",),
    "name": ("name", "default-name"),
    "place": ("address", "interface", "chain", "action", "dst-address"),
}


@pytest.mark.parametrize("missing", MISSING)
def test_what_a_device_leaves_out_is_no_fault_of_ours(at: Quay, tmp_path: Path, missing: str) -> None:
    with hostile(tmp_path, at.door.port, leaving_out(*MISSING[missing])) as device:
        at.door.port = device.port
        Store(at.state).pins.change(ROUTER, device.fingerprint)
        done = _typed(at, *ASKING["plan"])
    assert "our fault" not in done.stdout + done.stderr


def test_the_hostile_text_does_arrive(at: Quay, tmp_path: Path) -> None:
    """Else nothing was shown above."""
    with hostile(tmp_path, at.door.port, SAID["texts"]) as device:
        at.door.port = device.port
        Store(at.state).pins.change(ROUTER, device.fingerprint)
        told = at.provision("drift", "site=coastal", code=6).stdout
    assert r"evil\u001b]0;owned\u0007\u001b[2J\u202e\u009b31m\u2066\u000a\u0009evil\u000d\u007f\u200f\u2028evil" in told
    assert control_characters(HOSTILE) != []
