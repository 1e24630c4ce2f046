"""Checkouts as a stranger has them: the files that git knows, in a folder of their own, started by the launcher."""

import fcntl
import os
import shutil
import subprocess
from collections.abc import Mapping, Sequence
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[3]
NOBODY = 65534
INDEX_SETTINGS = ("PIP_INDEX_URL", "PIP_EXTRA_INDEX_URL", "PIP_FIND_LINKS", "PIP_CERT", "PIP_PROXY", "PIP_TRUSTED_HOST")
SILENT_INDEX = "the package index does not respond"


def clean_environment(**more: str) -> dict[str, str]:
    """What a new user of this machine has: a path, and the way to the package index; no HOME."""
    places = [place for place in os.environ["PATH"].split(":") if not place.startswith(f"{ROOT}/")]
    kept = {
        name: os.environ[name]
        for name in (*INDEX_SETTINGS, "https_proxy", "http_proxy", "ATLANTIS_NO_MACHINES")
        if name in os.environ
    }
    return {"PATH": ":".join(places), "LANG": "C.UTF-8"} | kept | more


def as_nobody() -> list[str]:
    """A prefix that runs a program as an ordinary user; empty where the tests already do."""
    if os.geteuid() != 0:
        return []
    return ["setpriv", f"--reuid={NOBODY}", f"--regid={NOBODY}", "--clear-groups", "--"]


def let_others_pass(path: Path) -> None:
    """Other users may walk through the private folders of pytest above this path, not look around in them."""
    for above in path.parents:
        if above.stat().st_uid == os.geteuid() and not above.stat().st_mode & 1:
            above.chmod(above.stat().st_mode | 0o011)


def start(
    checkout: Path,
    *arguments: str,
    prefix: Sequence[str] = (),
    environment: Mapping[str, str] | None = None,
    cwd: Path | None = None,
) -> subprocess.CompletedProcess[str]:
    """Type `provision ARGUMENTS`, with all that it says."""
    return subprocess.run(
        [*prefix, str(checkout / "provision"), *arguments],
        env=clean_environment() if environment is None else environment,
        cwd=cwd or checkout.parent,
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        check=False,
    )


def copy_of_checkout(place: Path) -> Path:
    """The files that git knows or would know, as a clone of this state has them."""
    listed = ["git", "-c", "safe.directory=*", "ls-files", "-z", "--cached", "--others", "--exclude-standard"]
    names = subprocess.run(listed, cwd=ROOT, capture_output=True, text=True, check=True).stdout.split("\0")
    for name in filter(None, names):
        if (ROOT / name).is_file():
            (place / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(ROOT / name, place / name, follow_symlinks=False)
    return place


def _compile(checkout: Path) -> None:
    """As the commands that are typed in it do bit by bit; each page of the docs would do it again, in its own layer."""
    python = checkout / ".venv" / "bin" / "python"
    if python.exists():
        subprocess.run([python, "-I", "-m", "compileall", "-q", checkout / "atlantis_netcfg"], check=True)


def shared_checkout(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The real checkout, its environment made by the launcher itself: once for all workers of a test run."""
    base = tmp_path_factory.getbasetemp()
    shared = base.parent if os.environ.get("PYTEST_XDIST_WORKER") else base
    place = shared / "first start" / "checkout"
    place.parent.mkdir(exist_ok=True)
    with (shared / "first start.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not place.exists():
            copy_of_checkout(place)
            first = start(place, "--help", environment=clean_environment(HOME=str(place.parent)))
            (place.parent / "first.stdout").write_text(first.stdout)
            (place.parent / "first.stderr").write_text(f"{first.stderr}exit {first.returncode}\n")
            _compile(place)
    said = (place.parent / "first.stderr").read_text()
    if SILENT_INDEX in said:
        pytest.skip(SILENT_INDEX)
    return place
