"""What the server's computer itself asks of a revocation list before it takes the place of another."""

import subprocess
from datetime import UTC, datetime
from pathlib import Path

import pytest

from atlantis_netcfg.inventory import Inventory, load
from atlantis_netcfg.vpn import pki
from atlantis_netcfg.vpn.identity import MembershipList
from atlantis_netcfg.vpn.server import FOLDER, live_files

NOW = datetime.now(UTC)
OURS, OTHERS = (pki.new_ca("ATLANTIS VPN", NOW) for _ in range(2))
"""Of the same name."""


@pytest.fixture(scope="module")
def declaration(request: pytest.FixtureRequest) -> Inventory:
    return load(request.config.rootpath / "inventory")


def accepted(declared: Inventory, folder: Path, new: bytes, here: bytes | None) -> subprocess.CompletedProcess[str]:
    """Run the validator of the file, as the module that places it does."""
    empty = MembershipList({}, 0, "", NOW, ())
    files = live_files(declared, empty, new, ca=pki.cert_pem(OURS.certificate))
    (file,) = (file for file in files if file.path == f"{FOLDER}/crl.pem")
    (folder / "new").write_text(file.content)
    if here is not None:
        (folder / "here").write_bytes(here)
    places = {"%s": str(folder / "new"), f"{FOLDER}/crl.pem": str(folder / "here")}
    words = [places.get(word, word) for word in file.validate]
    return subprocess.run(words, capture_output=True, text=True, check=False)


@pytest.mark.parametrize(("new", "here"), [(1, None), (10, 9), (17, 10), (256, 255)])
def test_successor_list_is_accepted(declaration: Inventory, tmp_path: Path, new: int, here: int | None) -> None:
    before = pki.new_crl(OURS, [], here, NOW) if here is not None else None
    assert accepted(declaration, tmp_path, pki.new_crl(OURS, [], new, NOW), before).returncode == 0


@pytest.mark.parametrize(("new", "here"), [(9, 10), (10, 17), (255, 256)])
def test_earlier_list_is_refused(declaration: Inventory, tmp_path: Path, new: int, here: int) -> None:
    """A run that was planned before a revocation, and is applied after it."""
    said = accepted(declaration, tmp_path, pki.new_crl(OURS, [], new, NOW), pki.new_crl(OURS, [], here, NOW))
    assert said.returncode == 1
    assert f"list {here} is in its place, and this is list {new}," in said.stderr


SERIALS = [pki.RevokedSerial(pki.new_serial(), NOW) for _ in range(3)]


@pytest.mark.parametrize("count", [0, 1, 3])
def test_installed_list_is_accepted_again(declaration: Inventory, tmp_path: Path, count: int) -> None:
    here = pki.new_crl(OURS, SERIALS[:count], 9, NOW)
    assert accepted(declaration, tmp_path, here, here).returncode == 0
    assert accepted(declaration, tmp_path, pki.new_crl(OURS, SERIALS, 10, NOW), here).returncode == 0


@pytest.mark.parametrize(("number", "first"), [(9, 0), (9, 1), (10, 1), (12, 2)])
def test_a_list_of_a_restored_authority_is_refused(
    declaration: Inventory, tmp_path: Path, number: int, first: int
) -> None:
    """Its number was given out before, or it lacks somebody who is revoked on the server."""
    here = pki.new_crl(OURS, SERIALS[:2], 9, NOW)
    said = accepted(declaration, tmp_path, pki.new_crl(OURS, SERIALS[first:], number, NOW), here)
    assert said.returncode == 1
    assert f"which lacks {first} of those that are revoked there" in said.stderr


def test_a_foreign_list_is_refused_and_replaced(declaration: Inventory, tmp_path: Path) -> None:
    ours, others = pki.new_crl(OURS, [], 1, NOW), pki.new_crl(OTHERS, [], 99, NOW)
    assert accepted(declaration, tmp_path, others, ours).returncode == 1
    assert accepted(declaration, tmp_path, ours, others).returncode == 0
    assert accepted(declaration, tmp_path, ours, b"half a li").returncode == 0
