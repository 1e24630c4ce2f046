"""`make bench` still runs: our own part and one peer, on one twin and on two."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[3]
NO_STRANGERS = "no .venv-strangers here: `tools/strangers` makes it"


@pytest.mark.slow
@pytest.mark.namespace
@pytest.mark.timeout(600)
def test_the_bench_runs_and_writes_its_page(tmp_path: Path) -> None:
    if not (ROOT / ".venv-strangers" / "stamp").exists():
        pytest.skip(NO_STRANGERS)
    page = tmp_path / "page.md"
    only = ("--only", "ours", "librouteros", "netmiko", "crowd")
    done = subprocess.run(
        [sys.executable, "-m", "bench", "--smoke", *only, "--write", str(page)],
        cwd=ROOT,
        env={**os.environ, "TMPDIR": str(tmp_path)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    text = page.read_text(encoding="utf-8")
    assert text.count("| as ours |") == 9, text
    assert "FAILED" not in text
    assert "| 2 |" in text
