"""What a gateway may do at the control centre: the words that are admitted, the paths, and what is said of a file."""

import hashlib
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from retrieval_programs import program
from waiting import HANG_S

RECEIVER = program("retrieval_receive")
DATA = b"bag" * 1000


def row(path: str, data: bytes = DATA) -> list[Any]:
    return [path, len(data), hashlib.sha256(data).hexdigest()]


@pytest.fixture
def receiver(tmp_path: Path) -> Any:  # noqa: ANN401 - a program, no module of ours
    return RECEIVER.Receiver("coastal-gateway", tmp_path / "recordings", 1_000_000)


def lay(folder: Path, path: str, data: bytes) -> Path:
    place: Path = folder / path
    place.parent.mkdir(parents=True, exist_ok=True)
    place.write_bytes(data)
    return place


def test_file_is_moved_into_place_after_verification(receiver: Any) -> None:  # noqa: ANN401 - as above
    assert receiver.have([row("bag/a")])["answers"] == ["missing"]
    lay(receiver.incoming, "bag/a", DATA[:50])
    assert receiver.have([row("bag/a")])["answers"] == ["partial"]
    assert receiver.keep([row("bag/a")])["answers"] == ["differs"]
    assert not (receiver.kept / "bag/a").exists(), "half a file has no name there"
    lay(receiver.incoming, "bag/a", DATA)
    assert receiver.have([row("bag/a")])["answers"] == ["partial"], "whole, and not yet kept"
    assert receiver.keep([row("bag/a")])["answers"] == ["kept"]
    assert (receiver.kept / "bag/a").read_bytes() == DATA
    assert not (receiver.incoming / "bag").exists()
    assert receiver.keep([row("bag/a")])["answers"] == receiver.have([row("bag/a")])["answers"] == ["kept"]


def test_corrupted_file_is_detected_and_replaced_by_a_new_copy(receiver: Any) -> None:  # noqa: ANN401 - as above
    spoilt = b"X" + DATA[1:]
    kept = lay(receiver.kept, "bag/a", spoilt)
    assert receiver.have([row("bag/a")])["answers"] == ["differs"]
    assert (receiver.incoming / "bag/a").read_bytes() == spoilt, "what is right of it need not come again"
    assert kept.read_bytes() == spoilt
    lay(receiver.incoming, "bag/a", DATA)
    assert receiver.keep([row("bag/a")])["answers"] == ["kept"]
    assert kept.read_bytes() == DATA


def test_free_space_is_the_remaining_budget(receiver: Any) -> None:  # noqa: ANN401 - as above
    lay(receiver.kept, "a", b"1" * 600_000)
    lay(receiver.folder, "another-gateway/b", b"1" * 300_000)
    assert receiver.have([])["room"] == 100_000
    lay(receiver.kept, "c", b"1" * 200_000)
    assert receiver.have([])["room"] == 0


@pytest.mark.parametrize("path", ["", "/etc/passwd", "../other/a", "a/../../b", "a//b", "./a", "a\nb"])
def test_path_outside_its_folder_is_rejected(receiver: Any, path: str) -> None:  # noqa: ANN401 - as above
    with pytest.raises(ValueError, match="no path of a recording"):
        receiver.have([row(path)])


@pytest.mark.parametrize(
    "command",
    [
        "rsync --server --sender -te.LsfxCIvu . .",
        "rsync --server -te.LsfxCIvu . /etc",
        "rsync --server -te.LsfxCIvu . ..",
        "rsync --server -lte.LsfxCIvu . .",
        "rsync --server -te.LsfxCIvu --delete . .",
        "rsync --server -te.LsfxCIvu --temp-dir=/tmp . .",
        "rsync --daemon . .",
        "rsync --server",
        "sh -c id",
        "",
    ],
)
def test_commands_other_than_writing_are_rejected(command: str) -> None:
    with pytest.raises(ValueError, match="admitted"):
        RECEIVER.server(command.split())


def test_our_rsync_command_is_accepted() -> None:
    words = ["rsync", "--server", "-tRe.LsfxCIvu", "--timeout=120", "--append", "--append", "--inplace", ".", "."]
    assert RECEIVER.server(words) == words


@pytest.mark.parametrize(
    "script",
    [
        "exec head -c 20000000 /dev/zero >one",
        "for n in 1 2 3 4 5 6 7 8 9; do head -c 900000 /dev/zero >$n; done; sleep 600",
    ],
    ids=["one file", "many files"],
)
def test_budget_is_enforced_against_a_compromised_gateway(tmp_path: Path, script: str) -> None:
    """A gateway that somebody has taken over does not ask how much room there is."""
    (tmp_path / "rsync").write_text(f"#!/bin/sh\n{script}\n")
    (tmp_path / "rsync").chmod(0o755)
    folder = tmp_path / "recordings"
    done = subprocess.run(
        [sys.executable, "-I", str(RECEIVER.__file__), "coastal-gateway", str(folder), "1"],
        env={
            "PATH": f"{tmp_path}:{os.environ['PATH']}",
            "SSH_ORIGINAL_COMMAND": "rsync --server -vtIe.iLsfxC --timeout=60 --inplace . coastal-gateway",
        },
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        check=False,
        timeout=HANG_S,
    )
    assert (done.returncode, done.stderr) == (3, "atlantis: the budget of 1 MB is used up\n")
    sizes = [file.stat().st_size for file in folder.rglob("*") if file.is_file()]
    assert max(sizes) <= 1_000_000
    again = RECEIVER.Receiver("coastal-gateway", folder, 1_000_000)
    assert again.room() == 0
