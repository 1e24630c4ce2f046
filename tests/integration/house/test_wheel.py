"""The wheel, built twice and installed in an environment of its own, works from an empty folder without a checkout.

Its dependencies are those of the development environment, so that no network is needed: that the declared ones suffice,
`make release` shows.
"""

import os
import subprocess
import sys
import sysconfig
from dataclasses import dataclass
from pathlib import Path

import pytest
from house_checkout import ROOT, clean_environment, copy_of_checkout

pytestmark = pytest.mark.slow
EPOCH = "1700000000"


def build(source: Path, to: Path) -> None:
    environment = {**os.environ, "SOURCE_DATE_EPOCH": EPOCH, "PYTHON": sys.executable}
    subprocess.run([ROOT / "tools" / "release", "build", source, to], env=environment, check=True)


@dataclass(frozen=True)
class Install:
    """A wheel in an environment, and an empty folder and HOME of its user."""

    place: Path
    wheel: Path

    @property
    def package(self) -> Path:
        (folder,) = (self.place / "environment" / "lib").glob("python3*/site-packages/atlantis_netcfg")
        return folder

    def files(self) -> set[Path]:
        """The files of the package, without those that Python compiles."""
        return {path for path in self.package.rglob("*") if path.is_file() and path.suffix != ".pyc"}

    def run(self, *command: str, **more: str) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            [str(self.place / "environment" / "bin" / command[0]), *command[1:]],
            cwd=self.place / "empty",
            env=clean_environment(HOME=str(self.place / "home"), ATLANTIS_NO_MACHINES="1", **more),
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            check=False,
        )

    def provision(self, *words: str, code: int = 0) -> str:
        done = self.run("provision", *words)
        assert done.returncode == code, done.stdout + done.stderr
        return done.stdout + done.stderr


@pytest.fixture(scope="module")
def install(tmp_path_factory: pytest.TempPathFactory) -> Install:
    place = tmp_path_factory.mktemp("wheel")
    source = copy_of_checkout(place / "source")
    build(source, place / "first")
    build(source, place / "second")
    (wheel,) = (place / "first").glob("*.whl")
    for folder in ("empty", "home"):
        (place / folder).mkdir()
    subprocess.run([sys.executable, "-I", "-m", "venv", "--without-pip", place / "environment"], check=True)
    python = place / "environment" / "bin" / "python"
    pip = [sys.executable, "-I", "-m", "pip", "--python", str(python), "install", "--quiet", "--no-index", "--no-deps"]
    subprocess.run([*pip, "--disable-pip-version-check", str(wheel)], check=True)
    result = Install(place, wheel)
    (result.package.parent / "dependencies.pth").write_text(sysconfig.get_path("purelib"))
    return result


def test_the_same_source_gives_the_same_bytes(install: Install) -> None:
    first, second = (
        {file.name: file.read_bytes() for file in sorted((install.place / folder).iterdir())}
        for folder in ("first", "second")
    )
    assert [name.rpartition("0")[2] for name in first] == ["-py3-none-any.whl", ".tar.gz"]
    assert first == second


def test_the_installed_package_has_everything_of_the_checkout(install: Install) -> None:
    tree = install.place / "source"
    for name in ("inventory", "playbooks", "roles", "templates"):
        shipped = {path.relative_to(tree / name) for path in (tree / name).rglob("*") if path.is_file()}
        copy = install.package / "share" / name
        assert {path.relative_to(copy) for path in install.files() if path.is_relative_to(copy)} == shipped
    package = tree / "atlantis_netcfg"
    modules = {path.relative_to(package) for path in package.rglob("*") if path.is_file()}
    files = {path.relative_to(install.package) for path in install.files()}
    assert {path.with_suffix(".mo") if path.suffix == ".po" else path for path in modules} <= files
    assert [path for path in files if path.suffix == ".po"] == []


def test_an_installed_program_goes_from_an_empty_folder_to_a_rehearsal(install: Install) -> None:
    before = install.files()
    at = install.run("python", "-c", "import atlantis_netcfg; print(atlantis_netcfg.__file__)").stdout
    assert Path(at.strip()).parent == install.package, "not the checkout's"

    created = install.provision("inventory", "init", "my-pilot", "--from", "example")
    assert "my-pilot: written and validated, no errors, 13 hosts at 3 sites" in created
    assert "my-pilot: no errors" in install.provision("inventory", "validate", "inventory=my-pilot")
    assert "my-pilot: sem erros" in install.provision("inventory", "validate", "inventory=my-pilot", "--lang", "pt")
    rehearsal = install.provision("site=coastal", "inventory=my-pilot", "--rehearse")
    assert "second run over satellite: 0 changes" in rehearsal, rehearsal

    assert install.files() == before, "nothing is written into the package"
    assert (install.place / "home" / ".local" / "state" / "atlantis").is_dir()
    assert [path.name for path in (install.place / "empty").iterdir()] == ["my-pilot"]


def test_without_a_name_an_installed_program_takes_the_inventory_of_the_folder(install: Install) -> None:
    refused = install.provision("inventory", "validate", code=7)
    assert f"the inventory directory {install.place / 'empty' / 'inventory'} does not exist" in refused
    install.provision("inventory", "init", "inventory", "--from", "example")
    assert "inventory: no errors" in install.provision("inventory", "validate")


def test_the_shipped_settings_find_collection_and_roles_from_any_folder(install: Install) -> None:
    share = install.package / "share"
    words = ["-m", "ansible", "playbook", "-i", str(share / "inventory"), str(share / "playbooks" / "site.yml")]
    done = install.run("python", *words, "--syntax-check", ANSIBLE_CONFIG=str(share / "ansible.cfg"))
    assert (done.returncode, done.stderr) == (0, "")
