"""The status file of a system says what it is and what is on it."""

from pathlib import Path

import pytest

from atlantis_netcfg.computers.bundle.manifest import Keys
from atlantis_netcfg.computers.bundle.requirements import BundleError, read_target
from atlantis_netcfg.computers.bundle.resolve import archive


def status(base: str = "11ubuntu5.8", architecture: str = "arm64", extra: str = "") -> bytes:
    rows = [("dpkg", "1.19", architecture), ("base-files", base, architecture), ("tzdata", "2024a", "all")]
    return (
        "".join(
            f"Package: {name}\nStatus: install ok installed\nArchitecture: {of}\nVersion: {version}\n"
            f"Description: two lines\n Package: not this\n\n"
            for name, version, of in rows
        ).encode()
        + extra.encode()
    )


@pytest.mark.parametrize(
    ("base", "release"),
    [
        ("11ubuntu5.8", "ubuntu focal"),
        ("12ubuntu4.6", "ubuntu jammy"),
        ("13ubuntu10", "ubuntu noble"),
        ("11.1+deb11u9", "debian bullseye"),
        ("12.4+deb12u10", "debian bookworm"),
        ("13.8", "debian trixie"),
    ],
)
def test_system_release_is_identified(base: str, release: str) -> None:
    assert read_target(status(base), "status").title == f"{release} arm64"


def test_only_installed_packages_count() -> None:
    extra = (
        "Package: gone\nStatus: deinstall ok config-files\nArchitecture: arm64\nVersion: 1\n\n"
        "Package: half\nStatus: install ok half-configured\nArchitecture: arm64\nVersion: 1\n\n"
        "Package: held\nStatus: hold ok installed\nArchitecture: arm64\nVersion: 1\n\n"
        "Package: other\nStatus: install ok installed\nArchitecture: armhf\nVersion: 1\n"
    )
    found = read_target(status(extra=extra), "status").installed_packages
    assert found == {"dpkg": "1.19", "base-files": "11ubuntu5.8", "tzdata": "2024a", "held": "1"}


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (b"", "x does not describe a system: `dpkg` is not in it"),
        (b"PK\x03\x04\xff", "x does not describe a system: `dpkg` is not in it"),
        (status("10.3+deb10u13"), "x: `base-files 10.3+deb10u13` is of no release that bundles are made for"),
        (status("14ubuntu1"), "x: `base-files 14ubuntu1` is of no release that bundles are made for"),
    ],
)
def test_invalid_status_is_refused(data: bytes, words: str) -> None:
    with pytest.raises(BundleError) as caught:
        read_target(data, "x")
    assert str(caught.value) == words


@pytest.mark.parametrize(
    ("base", "architecture", "mirror", "lines"),
    [
        (
            "11ubuntu5",
            "arm64",
            None,
            ["URIs: http://ports.ubuntu.com/ubuntu-ports", "Suites: focal focal-updates focal-security"],
        ),
        (
            "13ubuntu10",
            "amd64",
            None,
            ["URIs: http://archive.ubuntu.com/ubuntu", "Suites: noble noble-updates noble-security"],
        ),
        (
            "12.4",
            "arm64",
            "http://192.0.2.1/debian/",
            [
                "URIs: http://192.0.2.1/debian",
                "Suites: bookworm bookworm-updates",
                "URIs: http://192.0.2.1/debian-security",
                "Suites: bookworm-security",
            ],
        ),
    ],
)
def test_distribution_sources_and_key(  # noqa: PLR0913, PLR0917 - columns of the table
    base: str, architecture: str, mirror: str | None, lines: list[str], tmp_path: Path, request: pytest.FixtureRequest
) -> None:
    assert request.node.name
    (tmp_path / "key").write_bytes(b"key")
    source, key = archive(read_target(status(base, architecture), "x"), mirror, tmp_path / "key")
    assert [line for line in source.content.splitlines() if line.startswith(("URIs", "Suites"))] == lines
    assert source.content.count(f"Signed-By: {key.path}\n") == len(lines) // 2
    assert key.content == b"key"


def test_unreadable_keyring_is_reported(tmp_path: Path) -> None:
    with pytest.raises(BundleError, match="the key of the distribution cannot be read") as caught:
        archive(read_target(status(), "x"), None, tmp_path / "none")
    assert caught.value.hint == "`keyring=` names a file"


def test_signing_key_is_stable_and_private(tmp_path: Path) -> None:
    keys = Keys.of(tmp_path)
    assert keys.signer().fingerprint == keys.signer().fingerprint
    assert (tmp_path / "bundle" / "signing-key.asc").stat().st_mode & 0o777 == 0o600
    assert keys.signer().sign_inline("Date: x\n") == keys.signer().sign_inline("Date: x\n")
    assert "signing" not in repr(keys.signer())
