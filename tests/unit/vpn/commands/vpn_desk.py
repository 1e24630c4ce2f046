"""A technician with an authority: command lines typed in this process, their passphrase over a pipe."""

import json
import os
import shutil
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import pytest

from atlantis_netcfg.cli import main
from atlantis_netcfg.cli.vpn import _common
from atlantis_netcfg.core.paths import checkout
from atlantis_netcfg.inventory import Inventory, load

PASSPHRASE = "mackerel-lantern-orbit-velvet"
NOBODY = "age1ql3z7hjy54pw3hyww5ayyfg7zqgvc7w3j2elw8zmrj2kg5sfn9aqmcac8p"
"""A key that age's own documentation shows."""


@dataclass
class Desk:
    """Where somebody types."""

    folder: Path
    capsys: pytest.CaptureFixture[str]

    @property
    def authority(self) -> Path:
        return self.folder / "vpn"

    def files(self) -> dict[str, bytes]:
        """All that is on its disk."""
        return {
            str(path.relative_to(self.folder)): path.read_bytes() for path in self.folder.rglob("*") if path.is_file()
        }

    def type(self, *words: str, passphrase: str | None = None) -> tuple[int, str, str]:
        """Exit code, output, errors; with a passphrase, it comes over a pipe."""
        line = ["vpn", *words, f"authority={self.authority}"]
        if passphrase is None:
            code = main(line)
        else:
            with over_a_pipe(passphrase) as number:
                code = main([*line, "--passphrase-fd", number])
        said = self.capsys.readouterr()
        return code, said.out, said.err

    def told(self, *words: str, passphrase: str | None = None, code: int = 0) -> dict[str, Any]:
        """The same with `--json`, which must say what the exit code says."""
        ended, out, err = self.type(*words, "--json", passphrase=passphrase)
        told: dict[str, Any] = json.loads(out)
        assert (ended, told["exit"], err) == (code, code, ""), told
        return told


@cache
def founded(base: Path) -> Path:
    """A folder with an authority in it, made by the command, once for each process of a test run.

    Sealed as Ansible does it: tests do not wait for age's second.
    """
    folder = base / "founded"
    with over_a_pipe(PASSPHRASE) as number:
        assert (
            main(["vpn", "init", f"authority={folder / 'vpn'}", "sealed=vault", "--passphrase-fd", number, "--json"])
            == 0
        )
    return folder


@contextmanager
def over_a_pipe(text: str) -> Iterator[str]:
    """Number of a descriptor from which a line can be read."""
    read, write = os.pipe()
    os.write(write, f"{text}\n".encode())
    os.close(write)
    try:
        yield str(read)
    finally:
        os.close(read)


def seated(base: Path, folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> Desk:
    """A desk with a copy of the authority, and a state directory of its own."""
    reading_once(monkeypatch)
    monkeypatch.setenv("ATLANTIS_STATE", str(folder / "state"))
    shutil.copytree(founded(base), folder / "desk")
    capsys.readouterr()
    return Desk(folder / "desk", capsys)


def onboarding(partner: str, device: str, kind: str = "laptop", *more: str) -> Sequence[str]:
    """The words of an onboarding that contacts nobody and is sealed to a key: no second is lost to scrypt."""
    return ["onboard", f"partner={partner}", f"device={device}", f"kind={kind}", *more, "--no-push"]


@cache
def declared() -> Inventory:
    """The shipped pilot, read once."""
    return load(checkout() / "inventory")


def reading_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let no command line read the inventory's files again."""
    monkeypatch.setattr(_common, "load_inventory", lambda _arguments: declared())
