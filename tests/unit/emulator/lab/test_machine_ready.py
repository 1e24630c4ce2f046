"""Why no machine runs here, in the words that a technician reads."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from atlantis_netcfg.emulator.lab import MachineError, open_lab, provide, why_not
from atlantis_netcfg.emulator.lab import lab as ready


@pytest.fixture(autouse=True)
def able(monkeypatch: pytest.MonkeyPatch) -> None:
    """A computer that lacks nothing."""
    monkeypatch.setattr(os, "geteuid", lambda: 0)
    monkeypatch.setattr(shutil, "which", lambda name: f"/usr/bin/{name}")
    monkeypatch.setattr(ready, "_KEYRING", Path("/"))
    monkeypatch.setattr(ready, "_has_overlays", lambda: True)
    monkeypatch.setattr(
        "atlantis_netcfg.emulator.lab.hosts.output_of", lambda words: subprocess.CompletedProcess(words, 0)
    )


def test_no_reason_when_machines_can_run() -> None:
    assert why_not({}) is None


@pytest.mark.parametrize("value", ["1", "no", ""])
def test_any_value_of_the_variable_disables_machines(value: str) -> None:
    assert why_not({"ATLANTIS_NO_MACHINES": value}) == "ATLANTIS_NO_MACHINES is set"


def test_non_root_user_cannot_run_machines(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "geteuid", lambda: 1000)
    assert why_not({}) == "not root"


def test_only_linux_can_run_machines(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "platform", "darwin")
    assert why_not({}) == "not Linux"


def test_missing_programs_are_reported_as_install_command(monkeypatch: pytest.MonkeyPatch) -> None:
    there = {"ip", "mount", "setpriv", "unshare", "nsenter", "git", "gpg"}
    monkeypatch.setattr(shutil, "which", lambda name: name if name in there else None)
    assert why_not({}) == "missing: apt install conntrack mmdebstrap nftables openvpn systemd-container"


def test_missing_debian_keyring_is_reported(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(ready, "_KEYRING", tmp_path / "none.gpg")
    assert why_not({}) == "missing: apt install debian-archive-keyring"


def test_kernel_without_overlayfs_is_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ready, "_has_overlays", lambda: False)
    assert why_not({}) == "the kernel has no overlay file system"


def test_container_without_namespaces_is_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(
        "atlantis_netcfg.emulator.lab.hosts.output_of", lambda words: subprocess.CompletedProcess(words, 1)
    )
    assert why_not({}) == "this computer may not make namespaces"


def test_lab_error_says_why_no_machine_can_run(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("ATLANTIS_NO_MACHINES", "1")
    with (
        pytest.raises(MachineError, match="no machine can be run here: ATLANTIS_NO_MACHINES is set"),
        open_lab(tmp_path),
    ):
        pytest.fail("it stands")


@pytest.fixture
def installed(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """What apt-get was asked for, on a computer without mmdebstrap; it fails until its lists are new."""
    asked: list[str] = []

    def run(words: tuple[str, ...]) -> subprocess.CompletedProcess[str]:
        asked.append(" ".join(words[words.index("apt-get") :]))
        return subprocess.CompletedProcess(words, 0 if any(" update" in line for line in asked) else 100)

    monkeypatch.setattr(shutil, "which", lambda name: None if name == "mmdebstrap" else name)
    monkeypatch.setattr("atlantis_netcfg.emulator.lab.hosts.output_of", run)
    return asked


def test_missing_packages_are_installed_as_root(installed: list[str]) -> None:
    told: list[str] = []
    provide(told.append, {})
    assert told == ["installing mmdebstrap"]
    install = "apt-get -qq -o DPkg::Lock::Timeout=300 install -y --no-install-recommends mmdebstrap"
    assert installed == [install, "apt-get -qq -o DPkg::Lock::Timeout=300 update", install]


def test_nothing_is_installed_when_disabled_or_not_root(installed: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    provide(pytest.fail, {"ATLANTIS_NO_MACHINES": "1"})
    monkeypatch.setattr(os, "geteuid", lambda: 1000)
    provide(pytest.fail, {})
    assert installed == []


def test_nothing_is_installed_where_nothing_is_missing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("atlantis_netcfg.emulator.lab.hosts.output_of", lambda words: pytest.fail(str(words)))
    provide(pytest.fail, {})
    assert ready.missing_packages() == ()
