"""One at a time; the others wait, and are told for whom."""

import os
from multiprocessing import get_context
from pathlib import Path

import pytest
from authority_stand import stand

from atlantis_netcfg.core.errors import ExitCode
from atlantis_netcfg.vpn.authority import model
from atlantis_netcfg.vpn.authority.model import AuthorityBusy, Lock, is_held


def test_lock_holder_is_named_and_waited_for(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    made = stand(tmp_path)
    monkeypatch.setattr(model, "PATIENCE_S", 0.12)
    told: list[str] = []
    with Lock(made.folder, "ana"):
        assert is_held(made.folder)
        with (
            pytest.raises(
                AuthorityBusy, match=rf"authority is locked by .*\(process {os.getpid()}\).*: as ana"
            ) as busy,
            made.signing(waiting=told.append),
        ):
            pass
        assert busy.value.exit is ExitCode.FAILED
    assert len(told) == 1
    assert told[0].startswith("waiting for ")
    assert "as ana, who is working on the authority" in told[0]
    assert not is_held(made.folder)
    with made.signing(waiting=told.append):
        assert is_held(made.folder)
    assert len(told) == 1
    assert (made.folder / "lock").read_bytes() == b""


def hold_and_die(folder: Path) -> None:
    Lock(folder, "ana").__enter__()
    os._exit(9)


def test_dead_holder_releases_the_lock_and_partial_files_are_removed(tmp_path: Path) -> None:
    made = stand(tmp_path)
    process = get_context("fork").Process(target=hold_and_die, args=(made.folder,))
    process.start()
    process.join()
    (made.folder / "handouts" / "x").mkdir(parents=True)
    half = made.folder / "handouts" / "x" / ".member.ovpn.123"
    half.write_text("half a key")
    assert not is_held(made.folder)
    with made.signing():
        assert not half.exists()


def test_a_full_disk_does_not_make_it_weaker(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    made = stand(tmp_path)

    def full(*_: object) -> int:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "pwrite", full)
    monkeypatch.setattr(model, "PATIENCE_S", 0.0)
    refused = pytest.raises(AuthorityBusy, match="somebody who has just started")
    with Lock(made.folder, "ana"), refused, Lock(made.folder, "rui"):
        pass
