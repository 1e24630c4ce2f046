"""What is advised about bundles is typed as it was printed."""

import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from bundle_made import HOST, WISH, folder, keys, manifest, signer
from hints_said import advised, said

from atlantis_netcfg.ansible_collections.atlantis.netcfg.plugins.module_utils import apt_messages, apt_run
from atlantis_netcfg.ansible_collections.atlantis.netcfg.plugins.module_utils.apt_converge import AptConvergence
from atlantis_netcfg.ansible_collections.atlantis.netcfg.plugins.module_utils.errors import ModuleError
from atlantis_netcfg.cli import main
from atlantis_netcfg.computers.bundle.manifest import BundleSigner, Keys, Manifest
from atlantis_netcfg.operations import bundle as bundling
from atlantis_netcfg.operations.common.request import Mode
from atlantis_netcfg.operations.computers._watch import ComputerResult
from atlantis_netcfg.routeros.apply import Status

__all__ = ["folder", "keys", "signer"]
KEYS_OF = Keys.of


class Place:
    def __init__(self, bundle: Path, state: Path, capsys: pytest.CaptureFixture[str]) -> None:
        self.bundle, self.state, self.capsys = bundle, state, capsys
        self.fresh = bundle.with_name("fresh")

    def type(self, *words: str, code: int = 0) -> str:
        ended = main(words)
        printed = self.capsys.readouterr()
        assert ended == code, f"exit {ended}\n{printed.out}{printed.err}"
        return printed.out + printed.err

    def checked(self, *more: str, code: int) -> str:
        return self.type("gateway", "bundle", "site=coastal", f"check={self.bundle}", *more, code=code)


@pytest.fixture
def at(  # noqa: PLR0913, PLR0917 - fixtures
    folder: Path,
    keys: Keys,
    signer: BundleSigner,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> Place:
    """What is wanted is small, and what a mirror would give is there."""
    place = Place(folder, tmp_path / "state", capsys)
    shutil.copytree(folder, place.fresh)

    def made(asked: bundling.BundleRequest, *_: object) -> Manifest:
        shutil.copytree(place.fresh, asked.place, dirs_exist_ok=True)
        return manifest(signer)

    monkeypatch.setenv("ATLANTIS_STATE", str(place.state))
    monkeypatch.setattr(bundling, "make_bundle", made)
    monkeypatch.setattr(bundling, "host_requirements", lambda *_, **__: WISH)
    monkeypatch.setattr(Keys, "of", lambda _state: keys)
    return place


def damaged(at: Place) -> str:
    (at.bundle / "pool/chrony_3.5_arm64.deb").write_bytes(b"x")
    return at.checked(code=3)


def lacking(at: Place) -> str:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(bundling, "host_requirements", lambda *_, **__: replace(WISH, codename="jammy"))
        return at.checked(code=3)


def none(at: Place) -> str:
    at.bundle = at.bundle.with_name("nowhere")
    return at.checked(code=3)


def told(hint: str) -> str:
    """As the laptop tells what a gateway has refused."""
    result = ComputerResult(HOST, Mode.APPLY, "coastal")
    result.fail("packages", {"msg": "refused", "hint": hint}, Status.LEFT_AS_FOUND)
    return str(result.as_dict()["hint"])


def too_dear(_at: Place) -> str:
    wanted: Any = SimpleNamespace(desired_packages=SimpleNamespace(limit_words="", limit_bytes=1))
    return told(str(AptConvergence._over_limit_error(wanted, "20 MB").hint))


def no_name(_at: Place) -> str:
    found = apt_messages.explain_install_failure("E: Temporary failure resolving 'archive.example.org'\n", ["chrony"])
    return told(str(found.hint))


def another_system(_at: Place) -> str:
    apt: Any = SimpleNamespace(tree=SimpleNamespace(read=lambda _: b"ID=debian\nVERSION_CODENAME=bookworm\n"))
    with pytest.raises(ModuleError) as refused:
        apt_run.refuse_another_system(apt, "ubuntu", "focal", ())
    return told(str(refused.value.hint))


SITUATIONS: dict[str, tuple[Callable[[Place], str], str]] = {
    "damaged": (damaged, "copy the bundle again, or make it anew: `provision gateway bundle site={}`"),
    "lacking": (lacking, "on a computer with internet: `provision gateway bundle site={}`"),
    "none": (
        none,
        "name the folder itself; `provision gateway bundle site=…` makes one, and tells where it has put it",
    ),
    "too dear": (
        too_dear,
        (
            "run the same command with --accept-cost (ansible-playbook: -e atlantis_accept_cost=true), or bring the "
            "packages: `provision gateway bundle site=…`, then `--offline`"
        ),
    ),
    "no name": (
        no_name,
        (
            "check the site's link, and `ip route` on the computer; or bring the packages: `provision gateway "
            "bundle site=…`, then `--offline`"
        ),
    ),
}


@pytest.mark.parametrize("name", SITUATIONS)
def test_advised_bundle_is_made_and_usable(name: str, at: Place) -> None:
    brings, hint = SITUATIONS[name]
    (words,) = advised(said(brings(at), hint))
    printed = at.type(*words)
    at.bundle = at.state / "bundles" / "coastal"
    assert str(at.bundle) in printed
    assert "signed by" in at.checked(code=0)


def test_bundle_of_another_computer_opens_with_the_advised_key(
    at: Place, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    other = KEYS_OF(tmp_path / "other")
    monkeypatch.setattr(Keys, "of", lambda _state: other)
    hint = "let whoever made it read you the key; if it is this one: `provision gateway bundle site=… check={} key={}`"
    (words,) = advised(said(at.checked(code=3), hint))
    assert "signed by" in at.type(*words)
    assert "signed by" in at.checked(code=0)


def test_key_without_a_bundle_advises_a_working_command(at: Place, signer: BundleSigner) -> None:
    hint = "add `check=` and the bundle folder: `provision gateway bundle site={} check=BUNDLE key={}`"
    printed = at.type("gateway", "bundle", "site=coastal", f"key={signer.fingerprint}", code=3)
    (words,) = advised(said(printed, hint))
    assert "signed by" in at.type(*(word.replace("BUNDLE", str(at.bundle)) for word in words))


def test_advised_image_command_works(at: Place) -> None:
    hint = (
        "write a card with the right system (`provision gateway image --help`), or set the release of this one in "
        "the inventory"
    )
    (words,) = advised(said(another_system(at), hint))
    assert "host=coastal-gateway" in at.type(*words) or "gateway computer of the site" in at.type(*words)
