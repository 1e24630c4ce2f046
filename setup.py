"""Lays the folders that a run needs, which stand beside the package in a checkout, into the package of a wheel."""

import sys
from pathlib import Path
from shutil import copy2

from setuptools import setup
from setuptools.command.build_py import build_py

ROOT = Path(__file__).parent
RESOURCES = ("ansible.cfg", "inventory", "playbooks", "roles", "templates")
"""`atlantis_netcfg.core.paths.resource` finds them, in a checkout and in an installed package."""

SETTINGS = Path("ansible.cfg")


def wheel_settings(text: str) -> str:
    """Return Ansible's settings for a wheel, where the collection stands above the folder of this file."""
    before, after = "collections_path = atlantis_netcfg\n", "collections_path = ..\n"
    if text.count(before) != 1:
        raise ValueError(f"{SETTINGS}: expected the line `{before.strip()}` once")
    return text.replace(before, after)


def resource_files(root: Path = ROOT) -> list[Path]:
    """Return the paths of all files to lay in, without what tools left behind, and without images of systems."""
    files = (file for name in RESOURCES for file in ((root / name), *sorted((root / name).rglob("*"))))
    paths = [file.relative_to(root) for file in files if file.is_file()]
    return [path for path in paths if "__pycache__" not in path.parts and path.parts[:2] != ("inventory", "images")]


def compile_catalogues(package: Path) -> None:
    """Put the compiled catalogue in the place of each .po file."""
    sys.path.insert(0, str(ROOT))
    from atlantis_netcfg.core import compiled_catalogue  # noqa: PLC0415 - a build knows no other path to it

    for source in package.glob("locale/*/LC_MESSAGES/*.po"):
        source.with_suffix(".mo").write_bytes(compiled_catalogue.compile_catalogue(compiled_catalogue.read(source)))
        source.unlink()


class BuildWithResources(build_py):
    """Build the package with its resources; an editable installation uses those of the checkout."""

    def run(self) -> None:
        """Copy them below the modules."""
        super().run()
        if self.editable_mode:
            return
        package = Path(self.build_lib, "atlantis_netcfg")
        compile_catalogues(package)
        for path in resource_files():
            copy = package / "share" / path
            copy.parent.mkdir(parents=True, exist_ok=True)
            copy2(ROOT / path, copy)
            if path == SETTINGS:
                copy.write_text(wheel_settings(copy.read_text()))

    def get_source_files(self) -> list[str]:
        """Return what the source archive needs to build the same."""
        return [*super().get_source_files(), *map(str, resource_files())]


if __name__ == "__main__":
    setup(cmdclass={"build_py": BuildWithResources})
