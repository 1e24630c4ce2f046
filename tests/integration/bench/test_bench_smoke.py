"""`make bench` still runs: our own part and a peer or two, on one twin, on two, and for two devices of a VPN."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[3]
NO_STRANGERS = "no .venv-strangers here: `tools/strangers` makes it"


@pytest.mark.slow
@pytest.mark.namespace
def test_the_bench_runs_and_writes_its_page(tmp_path: Path) -> None:
    if not (ROOT / ".venv-strangers" / "stamp").exists():
        pytest.skip(NO_STRANGERS)
    page = tmp_path / "page.md"
    only = ("--only", "ours", "librouteros", "netmiko", "crowd", "runs", "vpn")
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
    assert re.search(r"^\| 2 \| 0 \| [0-9]", text, re.MULTILINE), text
    assert len(re.findall(r"^\| (report runs|recover resume) \| (10|20) \| [0-9]", text, re.MULTILINE)) == 4, text
    assert "| 2 | ours | " in text
    assert "| 2 | easy-rsa | " in text
    assert "not measured" not in text
