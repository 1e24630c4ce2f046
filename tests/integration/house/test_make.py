"""`make` explains itself, and .ci/run tells the whole outcome on its last line."""

import os
import re
import subprocess
from pathlib import Path

import pytest
from house_checkout import ROOT

CLOSING = "======================= 12 passed in 3.45s ========================"
FAILING = "================== 1 failed, 11 passed in 3.45s ==================="
NOTHING = "===================== no tests ran in 0.02s ======================="


def test_make_alone_lists_every_target() -> None:
    process = subprocess.run(["make"], cwd=ROOT, capture_output=True, text=True, check=True)
    phony = re.search(r"^\.PHONY: (.*)$", (ROOT / "Makefile").read_text(), re.MULTILINE)
    assert phony is not None
    assert re.findall(r"^  ([\w-]+)  +\S", process.stdout, re.MULTILINE) == phony[1].split()


@pytest.mark.parametrize(
    ("ends", "closing", "code"),
    [
        ((0, 0, 0), CLOSING, 0),
        ((2, 0, 0), CLOSING, 1),
        ((0, 2, 0), CLOSING, 1),
        ((0, 0, 2), FAILING, 1),
        ((2, 2, 2), FAILING, 1),
        ((0, 0, 2), NOTHING, 1),
    ],
)
def test_last_line_of_ci_is_the_summary(ends: tuple[int, int, int], closing: str, code: int, tmp_path: Path) -> None:
    lint, tests, rest = ends
    make = tmp_path / "make"
    make.write_text(
        f'#!/bin/sh\nread -r line && exit 9\n[ "$CI" = true ] || exit 9\n[ "$1" = lint ] && exit {lint}\n'
        f'[ "$1" = test ] && code={tests} line="{CLOSING}"\n'
        f'[ "$1" = test-full ] && case $2 in SHARD=[1-9]/12 | SHARD=1[0-2]/12) code={rest} line="{closing}" ;; esac\n'
        '[ -n "$code" ] || exit 9\necho ".. [100%]"\necho "$line"\necho "make: done" >&2\nexit "$code"\n'
    )
    make.chmod(0o755)
    environment = os.environ | {"PATH": f"{tmp_path}:{os.environ['PATH']}", "CI": ""}
    process = subprocess.run(
        ["bash", str(ROOT / ".ci" / "run")],
        env=environment,
        cwd=tmp_path,
        input="y\n",
        capture_output=True,
        text=True,
        check=False,
    )
    assert (process.returncode, process.stdout.splitlines()[-1]) == (code, closing)


def test_ci_fails_if_pytest_did_not_finish(tmp_path: Path) -> None:
    make = tmp_path / "make"
    make.write_text("#!/bin/sh\nexit 0\n")
    make.chmod(0o755)
    environment = os.environ | {"PATH": f"{tmp_path}:{os.environ['PATH']}"}
    process = subprocess.run(["bash", str(ROOT / ".ci" / "run")], env=environment, capture_output=True, check=False)
    assert process.returncode != 0
    assert b"pytest has not closed" in process.stdout
