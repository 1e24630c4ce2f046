"""`provision gateway bundle` as a technician types it, against a mirror of stand-ins on the loopback."""

import functools
import gzip
import json
import lzma
import os
import re
import shutil
import stat
import subprocess
import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import pytest
import yaml
from ansible.parsing.vault import VaultLib, VaultSecret
from bundle_stand import HOST, arm64, status

from atlantis_netcfg.cli import main
from atlantis_netcfg.core.errors import UsageError
from atlantis_netcfg.emulator.lab.stubs import publish
from atlantis_netcfg.inventory import load
from atlantis_netcfg.inventory.model import Gateway, ImageLayout
from atlantis_netcfg.operations.bundle import from_image, host_requirements
from atlantis_netcfg.operations.common.request import Request

pytestmark = pytest.mark.slow

ROOT = Path(__file__).resolve().parents[4]
SUITES = ("focal", "focal-updates", "focal-security")


class Quiet(SimpleHTTPRequestHandler):
    def log_message(self, *_arguments: object) -> None:
        """Requests are apt's business."""


@pytest.fixture
def inventory(tmp_path: Path) -> Path:
    """The shipped one without examples, and without ROS 2 and the library, which come from servers of their own."""
    made = shutil.copytree(ROOT / "inventory", tmp_path / "inventory")
    pilot = made / "group_vars" / "all" / "pilot.yml"
    told = yaml.safe_load(pilot.read_text())
    told["pilot"].pop("gateways", None)
    pilot.write_text(yaml.safe_dump(told))
    for path in made.rglob("*.yml"):
        path.write_text(real(path.read_text()))
    return made


def real(text: str) -> str:
    """No example any more; secrets are sealed, and nobody has the password."""
    for documentation, ours in (("203.0.113.", "10.99.3."), ("198.51.100.", "10.99.2."), ("192.0.2.", "10.99.1.")):
        text = text.replace(documentation, ours)
    text = re.sub(r" #.*\bEXAMPLE\b(?!-).*", "", text)
    text = text.replace("example_values: true", "example_values: false").replace("example.org", "atlantis.internal")
    text = text.replace("internet.example", "internet.atlantis.internal").replace("ssid: EXAMPLE-", "ssid: ")
    text = text.replace(" EXAMPLE technician", " technician").replace("name: EXAMPLE-", "name: ")
    return re.sub(r"EXAMPLE-[a-z0-9-]+", sealed, text)


@functools.cache
def vault() -> VaultLib:
    return VaultLib([("default", VaultSecret(b"nobody has it"))])


def sealed(found: re.Match[str]) -> str:
    return f"!vault {json.dumps(vault().encrypt(found[0].encode()).decode())}"


@pytest.fixture
def mirror(tmp_path: Path, inventory: Path) -> Iterator[str]:
    """Of Ubuntu 20.04, with whatever the declaration wants of a gateway, and `archive.gpg` that signs it."""
    declaration = load(inventory)
    wanted = host_requirements(declaration, declaration.hosts[HOST], Request()).packages
    packages = tuple(arm64(each.name, "1.0") for each in wanted) or (arm64("nothing"),)
    place = tmp_path / "mirror"
    keys = b""
    for suite in SUITES:
        made = publish(tmp_path / suite, packages if suite == "focal" else (), codename=suite)
        keys += made.key
        shutil.copytree(made.folder, place, dirs_exist_ok=True)
    (tmp_path / "archive.gpg").write_bytes(keys)
    server = ThreadingHTTPServer(("127.0.0.1", 0), functools.partial(Quiet, directory=str(place)))
    thread = threading.Thread(target=server.serve_forever)
    thread.start()
    yield f"http://127.0.0.1:{server.server_address[1]}"
    server.shutdown()
    thread.join()
    server.server_close()


@dataclass(frozen=True)
class Said:
    returncode: int
    stdout: str
    stderr: str

    def told(self) -> dict[str, Any]:
        result: dict[str, Any] = json.loads(self.stdout)
        assert result["exit"] == self.returncode
        return result


@pytest.fixture
def provision(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> Callable[..., Said]:
    """Type a command line; its state is in `state`."""
    monkeypatch.setenv("ATLANTIS_STATE", str(tmp_path / "state"))

    def typed(*words: str) -> Said:
        code = main(["gateway", "bundle", "site=coastal", f"inventory={tmp_path / 'inventory'}", *words])
        return Said(code, *capsys.readouterr())

    return typed


def words_for(mirror: str, folder: Path) -> list[str]:
    (folder / "status").write_bytes(status())
    return [f"status={folder / 'status'}", f"mirror={mirror}", f"keyring={folder / 'archive.gpg'}"]


@pytest.mark.smoke
def test_bundle_is_made_checked_and_accepted_on_another_computer(
    mirror: str, tmp_path: Path, provision: Callable[..., Said]
) -> None:
    words = words_for(mirror, tmp_path)
    done = provision(*words, f"to={tmp_path / 'usb'}")
    assert done.returncode == 0, done.stderr
    assert "to download" in done.stdout.splitlines()[0]
    assert f"{HOST}: ubuntu focal arm64, " in done.stdout
    assert "fetching packages for coastal-gateway" in done.stderr
    checked = provision(f"check={tmp_path / 'usb'}", "--json").told()
    assert (checked["site"], checked["hosts"][HOST]["codename"]) == ("coastal", "focal")
    assert checked["size"] == sum(file["size"] for file in checked["files"])

    shutil.rmtree(tmp_path / "state")
    refused = provision(f"check={tmp_path / 'usb'}")
    assert refused.returncode == 3
    assert f"was signed on another computer, by key {checked['key']}" in refused.stderr
    assert provision(f"check={tmp_path / 'usb'}", f"key={checked['key']}").returncode == 0
    assert provision(f"check={tmp_path / 'usb'}").returncode == 0


def test_bundle_is_stored_in_the_state_directory_by_default(
    mirror: str, tmp_path: Path, provision: Callable[..., Said]
) -> None:
    made = provision(*words_for(mirror, tmp_path), "--json").told()
    assert made["bundle"] == str(tmp_path / "state" / "bundles" / "coastal")
    assert (tmp_path / "state" / "bundles" / "coastal" / "manifest.json").is_file()


def test_unavailable_package_lists_are_reported(mirror: str, tmp_path: Path, provision: Callable[..., Said]) -> None:
    for suite in SUITES:
        shutil.rmtree(tmp_path / "mirror" / "dists" / suite)
    refused = provision(*words_for(mirror, tmp_path), "--json").told()
    assert refused["exit"] == 3
    assert all(row["message"].startswith("the lists of packages cannot be had: ") for row in refused["errors"])
    assert any("focal" in row["message"] for row in refused["errors"])


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["status=/none"], "cannot read /none: No such file or directory"),
        (["image=/none"], "/none is not a file"),
        (["image=/none", "status=/none"], "`image=` and `status=` cannot be used together"),
        (["key=0"], "`key=` requires `check=`"),
        (
            ["device=coastal-router"],
            (
                "`coastal-router`: no gateway, control centre or operator station is selected, "
                "and bundles are only for these"
            ),
        ),
        (["check=/none"], "/none is no bundle, or not a whole one"),
    ],
)
def test_invalid_arguments_are_refused(
    inventory: Path, provision: Callable[..., Said], words: list[str], said: str
) -> None:
    assert inventory.is_dir()
    done = provision(*words)
    assert done.returncode in (3, 7)
    assert done.stderr.startswith(f"error: {said}") or f"error: {said}" in done.stderr


def test_example_values_are_refused(tmp_path: Path, provision: Callable[..., Said]) -> None:
    shutil.copytree(ROOT / "inventory", tmp_path / "inventory")
    done = provision("status=/none")
    assert done.returncode == 3
    assert done.stderr.startswith("error: the inventory still contains example values")


@pytest.mark.smoke
def test_package_status_of_the_board_is_read_over_ssh(
    mirror: str, tmp_path: Path, provision: Callable[..., Said], monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "answer").write_bytes(gzip.compress(status()))
    program = tmp_path / "bin" / "ssh"
    program.parent.mkdir()
    program.write_text(f'#!/bin/sh\necho "$@" >{tmp_path}/asked\ncat {tmp_path}/answer\n')
    program.chmod(program.stat().st_mode | stat.S_IEXEC)
    monkeypatch.setenv("PATH", f"{program.parent}:{os.environ['PATH']}")
    words = [word for word in words_for(mirror, tmp_path) if not word.startswith("status=")]
    done = provision(*words)
    assert done.returncode == 0, done.stderr
    asked = (tmp_path / "asked").read_text()
    assert "BatchMode=yes" in asked
    assert f"HostKeyAlias={HOST}" in asked
    assert asked.endswith("root@10.64.1.10 gzip -9c /var/lib/dpkg/status\n")


@pytest.mark.parametrize("packed", [False, True])
def test_package_status_is_read_from_an_image(tmp_path: Path, packed: bool) -> None:  # noqa: FBT001 - a column
    root, image = tmp_path / "root", tmp_path / "vendor.img"
    (root / "var/lib/dpkg").mkdir(parents=True)
    (root / "var/lib/dpkg/status").write_bytes(status(chrony="3.5"))
    with image.open("wb") as file:
        file.truncate(12 * 2**20)
    subprocess.run(["sfdisk", "-q", str(image)], input=b"label: dos\n2048,,83\n", check=True)
    offset = f"offset={2048 * 512}"
    subprocess.run(["mke2fs", "-q", "-t", "ext4", "-E", offset, "-d", str(root), str(image), "8M"], check=True)
    if packed:
        image.write_bytes(lzma.compress(image.read_bytes(), preset=0))
        image = image.rename(tmp_path / "vendor.img.xz")
    host = load(ROOT / "inventory").hosts[HOST]
    assert isinstance(host.device, Gateway)
    assert host.device.image is not None
    plain = host.device.image.model_copy(update={"layout": ImageLayout.PLAIN})
    target = from_image(
        replace(host, device=host.device.model_copy(update={"image": plain})), image, lambda _done, _total: None
    )
    assert (target.title, target.installed_packages["chrony"]) == ("ubuntu focal arm64", "3.5")
    with pytest.raises(UsageError, match="does not have layout `odroid-n2`"):
        from_image(host, image, lambda _done, _total: None)
