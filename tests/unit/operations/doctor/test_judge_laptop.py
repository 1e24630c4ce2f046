"""What is said of a laptop's software and clock, in each state that can be told apart."""

import os
import subprocess
import tomllib
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
from cryptography import x509
from cryptography.hazmat.primitives import serialization
from cryptography.hazmat.primitives.asymmetric import ed25519
from cryptography.x509.oid import NameOID
from laptop_network import lines

from atlantis_netcfg.core import packages
from atlantis_netcfg.core.paths import checkout
from atlantis_netcfg.operations.doctor import clock, software
from atlantis_netcfg.runs import Store

# --- software -----------------------------------------------------------------------------------------------------


def test_python_version_is_checked_against_the_project_minimum() -> None:
    assert lines(software.judge_python("3.11.2")) == ["PASS Python: 3.11.2"]
    assert lines(software.judge_python("3.10.12")) == [
        "FAIL Python: 3.10.12; 3.11 or newer is required",
        "  sudo apt-get install -y python3-venv",
    ]
    project = tomllib.loads((checkout() / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert project["requires-python"] == f">={'.'.join(map(str, software._MINIMUM_PYTHON))}"


LOCK = """\
# made by a tool
ansible-core==2.19.14 \\
    --hash=sha256:1e76
colorama==0.4.6 ; sys_platform == "win32" \\
    --hash=sha256:1e76
ruamel.yaml==0.18.1 ; sys_platform == "linux" \\
    --hash=sha256:1e76
"""


def test_pins_for_this_computer_are_selected() -> None:
    assert packages.pinned_packages(LOCK) == {"ansible-core": "2.19.14", "ruamel.yaml": "0.18.1"}
    shipped = (checkout() / "requirements" / "run.txt").read_text(encoding="utf-8")
    assert len(packages.pinned_packages(shipped)) > 30


@pytest.mark.parametrize(
    ("installed", "expected"),
    [
        (
            {"ansible-core": "2.19.14", "b": "1", "c": "1", "d": "1"},
            ["PASS packages: 4 match the pinned versions; ansible-core 2.19.14"],
        ),
        (
            {"ansible-core": "2.19.15", "c": "1", "d": "1"},
            [
                "FAIL packages: ansible-core is 2.19.15, but 2.19.14 is required; b is missing",
                "  the next start reinstalls them from the package index, after:",
                "  rm .venv/run.stamp",
            ],
        ),
        (
            {},
            [
                "FAIL packages: ansible-core is missing; b is missing; c is missing; and 1 more",
                "  the next start reinstalls them from the package index, after:",
                "  rm .venv/run.stamp",
            ],
        ),
    ],
)
def test_package_verdicts(installed: dict[str, str], expected: list[str]) -> None:
    pins = {"ansible-core": "2.19.14", "b": "1", "c": "1", "d": "1"}
    assert lines(software.judge_packages(pins, installed.get)) == expected


@pytest.mark.parametrize(
    ("release", "expected"),
    [
        ('ID=debian\nVERSION_ID="12"\nPRETTY_NAME="Debian 12"', "PASS system: Debian 12"),
        ('ID="debian"\nVERSION_ID="13"\nPRETTY_NAME="Debian 13"', "PASS system: Debian 13"),
        ('ID=ubuntu\nVERSION_ID="24.04"\nPRETTY_NAME="Ubuntu 24.04"', "PASS system: Ubuntu 24.04"),
        (
            'ID=ubuntu\nVERSION_ID="22.04"\nPRETTY_NAME="Ubuntu 22.04"',
            "WARN system: Ubuntu 22.04: older than the systems this version was tested on",
        ),
        (
            'ID=fedora\nVERSION_ID=43\nPRETTY_NAME="Fedora 43"',
            "WARN system: Fedora 43: not tested; tested are Debian 12, Ubuntu 24.04 and newer",
        ),
        ("", "WARN system: unknown: not tested; tested are Debian 12, Ubuntu 24.04 and newer"),
    ],
)
def test_operating_system_verdicts(release: str, expected: str) -> None:
    assert lines(software.judge_system(release)) == [expected]


def test_missing_program_fails_only_if_required() -> None:
    needs = {need.name: need for need in software.program_needs(computers=True)}
    ssh, versions = needs["OpenSSH"], {"openssh-client": "1:9.2p1-2", "other": "1"}
    assert lines(software.judge_programs(ssh, lambda _: True, versions)) == ["PASS OpenSSH: openssh-client 1:9.2p1-2"]
    assert lines(software.judge_programs(ssh, lambda _: True, {})) == ["PASS OpenSSH: ssh"]
    assert lines(software.judge_programs(ssh, lambda _: False, {})) == [
        "FAIL OpenSSH: missing: ssh; required for gateways and the VPN server",
        "  sudo apt install openssh-client",
    ]
    assert lines(software.judge_programs(replace(ssh, is_required=False), lambda _: False, {})) == [
        "SKIP OpenSSH: missing: ssh; required only for gateways and the VPN server",
        "  sudo apt install openssh-client",
    ]
    images = software.judge_programs(needs["for card images"], lambda program: program == "mcopy", {})
    assert images.commands == ("sudo apt install e2fsprogs",)
    (optional,) = [need for need in software.program_needs(computers=False) if need.name == "OpenSSH"]
    assert not optional.is_required


def test_versions_come_from_dpkg() -> None:
    assert software.debian_versions(["dpkg", "no-such-package"]).keys() == {"dpkg"}


@pytest.mark.parametrize(
    ("root", "missing", "off", "expected"),
    [
        (True, (), False, ["PASS rehearsals: routers and gateways: everything required for real systems is installed"]),
        (
            True,
            ("mmdebstrap",),
            False,
            ["SKIP rehearsals: routers only; missing for gateways: mmdebstrap", "  sudo apt install mmdebstrap"],
        ),
        (False, (), False, ["SKIP rehearsals: routers only; gateways are rehearsed as root, with `sudo`"]),
        (True, (), True, ["SKIP rehearsals: routers only: ATLANTIS_NO_MACHINES is set"]),
    ],
)
def test_rehearsal_capability_verdicts(*, root: bool, missing: tuple[str, ...], off: bool, expected: list[str]) -> None:
    assert lines(software.judge_emulation(root=root, missing=missing, off=off)) == expected


# --- clock --------------------------------------------------------------------------------------------------------

NOW = datetime(2026, 11, 25, 12, tzinfo=UTC)


@pytest.mark.parametrize(
    ("earlier", "ends", "expected"),
    [
        (
            {"the newest commit": NOW - timedelta(days=2), "the latest run": NOW - timedelta(days=1)},
            None,
            ["PASS time: 2026-11-25 12:00 UTC, after the latest run (2026-11-24)"],
        ),
        (
            {"the newest commit": NOW + timedelta(minutes=9)},
            NOW + timedelta(days=1),
            ["PASS time: 2026-11-25 12:00 UTC, after the newest commit (2026-11-25)"],
        ),
        (
            {"the newest commit": NOW + timedelta(minutes=11), "the latest run": NOW - timedelta(days=1)},
            None,
            [
                "FAIL time: 2026-11-25 12:00 UTC is before the newest commit (2026-11-25 12:11 UTC)",
                "  set it:",
                "  sudo timedatectl set-ntp true",
            ],
        ),
        (
            {"the latest run": NOW - timedelta(days=1)},
            NOW - timedelta(hours=1),
            [
                "FAIL time: 2026-11-25 12:00 UTC is after the expiry of the VPN authority (2026-11-25)",
                "  set the clock; if it is right, create a new authority",
            ],
        ),
        ({}, None, ["WARN time: 2026-11-25 12:00 UTC: nothing to compare it with"]),
    ],
)
def test_time_verdicts(earlier: dict[str, datetime], ends: datetime | None, expected: list[str]) -> None:
    assert lines(clock.judge_time(NOW, earlier, ends)) == expected


@pytest.mark.parametrize(
    ("printed", "expected"),
    [
        ("NTP=yes\nNTPSynchronized=yes\n", ["PASS time server: the clock is set by a time server"]),
        (
            "NTP=no\nNTPSynchronized=no\n",
            ["WARN time server: no time server sets the clock", "  sudo timedatectl set-ntp true"],
        ),
        (
            "NTP=yes\nNTPSynchronized=no\n",
            [
                "WARN time server: no time server has responded since the start",
                "  connect to the internet once, or compare with a watch",
            ],
        ),
        (None, ["WARN time server: unknown: timedatectl reports nothing here", "  compare with a watch"]),
        ("garbage", ["WARN time server: unknown: timedatectl reports nothing here", "  compare with a watch"]),
    ],
)
def test_time_synchronisation_verdicts(printed: str | None, expected: list[str]) -> None:
    assert lines(clock.judge_synchronised(printed)) == expected


def test_the_clock_is_compared_with_the_latest_run(tmp_path: Path) -> None:
    runs = tmp_path / "real" / "coastal" / "runs"
    for name in ("20261124T101112Z", "20991124T101112Z-02", "named"):
        (runs / name).mkdir(parents=True)
    latest = clock._latest_run(Store(tmp_path).runs("coastal"))
    assert latest == datetime(2099, 11, 24, 10, 11, 12, tzinfo=UTC)
    (item, _) = clock.clock_items(tmp_path, Store(tmp_path).runs("coastal"), None)
    assert (item.verdict, "is before the latest run" in item.observation) == ("FAIL", True)


def test_the_clock_is_compared_with_the_newest_commit(tmp_path: Path) -> None:
    assert clock._commit(tmp_path) is None
    who = ["-c", "user.name=a", "-c", "user.email=a@example.org", "-c", "commit.gpgsign=false"]
    for words in (["init", "-q"], [*who, "commit", "-q", "--allow-empty", "-m", "x"]):
        when = {"GIT_COMMITTER_DATE": "2031-02-03T04:05:06Z", "GIT_CONFIG_GLOBAL": "/dev/null"}
        subprocess.run(["git", "-C", str(tmp_path), *words], check=True, env={**os.environ, **when})
    assert clock._commit(tmp_path) == datetime(2031, 2, 3, 4, 5, 6, tzinfo=UTC)


def test_clock_is_compared_with_the_ca_certificate(tmp_path: Path) -> None:
    key = ed25519.Ed25519PrivateKey.generate()
    name = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, "CA")])
    begins, ends = datetime(2027, 1, 1, tzinfo=UTC), datetime(2037, 1, 1, tzinfo=UTC)
    made = x509.CertificateBuilder(name, name, key.public_key(), 1, begins, ends).sign(key, None)
    (tmp_path / "ca.crt").write_bytes(made.public_bytes(serialization.Encoding.PEM))
    assert clock._authority_dates(tmp_path) == (begins, ends)
    (tmp_path / "ca.crt").write_text("damaged")
    assert clock._authority_dates(tmp_path) == (None, None)
    assert clock._authority_dates(None) == (None, None)
