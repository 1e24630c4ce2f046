"""A disk that is really full, page by page: refused in words, and done when there is room."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

PROGRAM = """
import shutil, sys
from pathlib import Path
import authority_witness as witness
from authority_child import place, run
from atlantis_netcfg.core.errors import NetcfgError
from atlantis_netcfg.vpn.authority.authority import Authority

before, disk = map(Path, sys.argv[1:])
place(before)
run(before, "issue a b")
PAGE = 4096
for command in ("issue c d", "renew iqua-a", "revoke iqua-b"):
    refused = 0
    for pages in (0, 1, 2, 3, 5, 8, 11):
        work = disk / "work"
        shutil.copytree(before, work)
        listed = witness.listed(work / "vpn").number
        free = shutil.disk_usage(disk).free
        with (disk / "filler").open("wb") as filler:
            filler.write(bytes(free - pages * PAGE))
        try:
            run(work, command)
        except NetcfgError as error:
            refused += 1
            assert error.exit == 4 and error.hint, error
            assert "No space left on device" in str(error), error
        witness.nothing_outside_the_record(work / "vpn")
        witness.issued(work / "vpn")
        assert witness.listed(work / "vpn").number >= listed
        (disk / "filler").unlink()
        run(work, command)
        assert Authority.open(work / "vpn").check() == []
        witness.private_and_clean(work / "vpn")
        admitted = {name: len(some) for name, some in witness.admitted(work / "vpn").items()}
        wanted = {"issue c d": {"a": 1, "b": 1, "c": 1, "d": 1}, "renew iqua-a": {"a": 2, "b": 1}}
        assert admitted == {f"iqua-{name}": n for name, n in wanted.get(command, {"a": 1, "b": 0}).items()}
        shutil.rmtree(work)
    print(command, refused)
    assert refused >= 1
"""


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can mount")
@pytest.mark.namespace
def test_full_disk_is_reported_and_harms_nothing(tmp_path: Path) -> None:
    (tmp_path / "before").mkdir()
    (tmp_path / "disk").mkdir()
    script = f'mount -t tmpfs -o size=512k tmpfs "$1/disk" && exec "{sys.executable}" -c "$2" "$1/before" "$1/disk"'
    root = Path(__file__).parents[4]
    places = (root, Path(__file__).parent, root / "tests" / "unit" / "vpn" / "authority")
    done = subprocess.run(
        ["unshare", "--mount", "sh", "-c", script, "sh", str(tmp_path), PROGRAM],
        env={"PATH": "/usr/bin:/bin", "PYTHONPATH": ":".join(map(str, places))},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert len(done.stdout.splitlines()) == 3
