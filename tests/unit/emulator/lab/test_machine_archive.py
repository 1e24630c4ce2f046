"""The stand-ins' archive and the bundles' key, where gpg's clock passes the edge of a second while a key is made."""

import os
import re
import shutil
import subprocess
from pathlib import Path

import pytest

from atlantis_netcfg.computers.bundle.manifest import Keys, find_signer
from atlantis_netcfg.emulator.lab.stubs.archive import publish

GPG = """\
#!/bin/sh
# A key takes seconds: it is begun in the very second that gpg is told, and every look at the clock takes 0.5 s.
case " $* " in
*" --quick-generate-key "*)
    second=$(echo "$@" | sed -E 's/.*--faked-system-time[= ](....)(..)(..)T(..)(..)(..).*/\\1-\\2-\\3 \\4:\\5:\\6/')
    export TZ=UTC FAKETIME_NO_CACHE=1 FAKETIME="@$second i0.5" LD_PRELOAD={library};;
esac
exec {gpg} "$@"
"""


@pytest.fixture
def _clock_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Let gpg make its keys over the edge of a second."""
    library = next(Path("/usr/lib").glob("*/faketime/libfaketime.so.1"))
    script = tmp_path / "bin" / "gpg"
    script.parent.mkdir()
    script.write_text(GPG.format(library=library, gpg=shutil.which("gpg")))
    script.chmod(0o755)
    monkeypatch.setenv("PATH", f"{script.parent}:{os.environ['PATH']}")


def verified(folder: Path, key: bytes) -> str:
    """What gpgv(1) says of an archive, by this computer's clock."""
    (folder / "key.gpg").write_bytes(key)
    release = next(folder.glob("**/InRelease"))
    words = ["gpgv", "--homedir", str(folder), "--keyring", str(folder / "key.gpg"), "--status-fd", "1", str(release)]
    return subprocess.run(words, capture_output=True, text=True, check=False).stdout


@pytest.mark.usefixtures("_clock_runs")
def test_the_key_of_an_archive_is_never_younger_than_its_signature(tmp_path: Path) -> None:
    made = publish(tmp_path / "archive", [], codename="bookworm")
    assert re.search(rf"^\[GNUPG:\] VALIDSIG {made.fingerprint} ", verified(made.folder, made.key), re.MULTILINE)


@pytest.mark.usefixtures("_clock_runs")
def test_the_key_of_bundles_is_never_younger_than_its_signature(tmp_path: Path) -> None:
    signer = Keys.of(tmp_path).signer()
    assert find_signer(b"data", signer.sign_detached(b"data"), signer.public) == signer.fingerprint
