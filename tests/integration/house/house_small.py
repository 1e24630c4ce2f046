"""A small checkout for tests in which only the launcher matters: the launcher and its tools are the real ones.

Its package tells how it was started. It is installed from a folder of wheels made here, so that its environment is made
in seconds and without any index.
"""

import base64
import hashlib
import io
import shutil
import sys
import zipfile
from pathlib import Path

import pip
from house_checkout import ROOT

MAIN = """\
import json, os, sys
print(json.dumps({"argv": sys.argv[1:], "cwd": os.getcwd(), "path": sys.path, "python": sys.executable}))
sys.exit(7)
"""
PROJECT = """\
[build-system]
requires = ["setuptools"]
build-backend = "setuptools.build_meta"
[project]
name = "atlantis-netcfg"
version = "1"
dependencies = []
"""
BACKEND = """\
# Stands for setuptools: an editable wheel is a path file and a record.
import os, tomllib, zipfile

FILES = {
    "METADATA": "Metadata-Version: 2.1\\nName: atlantis-netcfg\\nVersion: 1\\n",
    "WHEEL": "Wheel-Version: 1.0\\nGenerator: x\\nRoot-Is-Purelib: true\\nTag: py3-none-any\\n",
}

def build_editable(folder, config_settings=None, metadata_directory=None):
    name = "atlantis_netcfg-1-py3-none-any.whl"
    files = {f"atlantis_netcfg-1.dist-info/{name}": text for name, text in FILES.items()}
    with open("pyproject.toml", "rb") as project:
        for needed in tomllib.load(project)["project"]["dependencies"]:
            files["atlantis_netcfg-1.dist-info/METADATA"] += f"Requires-Dist: {needed}\\n"
    files["atlantis_netcfg.pth"] = os.getcwd() + "\\n"
    files["atlantis_netcfg-1.dist-info/RECORD"] = "".join(f"{name},,\\n" for name in files)
    with zipfile.ZipFile(os.path.join(folder, name), "w") as wheel:
        for path, text in files.items():
            wheel.writestr(path, text)
    return name
"""


PIP = """\
# Stands for pip where only the launcher's own steps matter: an editable checkout is a path file.
import pathlib, sys, sysconfig
if "--editable" in sys.argv:
    pathlib.Path(sysconfig.get_path("purelib"), "atlantis_netcfg.pth").write_text(sys.argv[-1] + "\\n")
"""


def small_checkout(place: Path) -> Path:
    """A checkout whose `provision` prints its arguments and ends with exit code 7."""
    (place / "atlantis_netcfg").mkdir(parents=True)
    shutil.copytree(ROOT / "tools", place / "tools", ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copy2(ROOT / "provision", place)
    (place / "pyproject.toml").write_text(PROJECT)
    (place / "requirements").mkdir()
    (place / "requirements" / "run.txt").write_text(LOCK)
    (place / "atlantis_netcfg" / "__init__.py").write_text("")
    (place / "atlantis_netcfg" / "__main__.py").write_text(MAIN)
    return place


def quick_python(place: Path, real: str | None = None, *, has_pip: bool = True) -> Path:
    """A Python whose `venv` copies pip: ensurepip would install and compile it, 6 s of work for each environment.

    Without `has_pip` it is one that only links the checkout, for tests in which nothing is fetched. Of the real one
    there is a test in test_launcher.py, one in test_launcher_python.py, and the first start of the real checkout.
    """
    where = Path(pip.__file__).parent
    real = real or str(Path(sys.base_prefix) / "bin" / f"python3.{sys.version_info.minor}")
    library = f"lib/python3.{sys.version_info.minor}/site-packages"
    copied = place / "pip"
    if has_pip:
        shutil.copytree(where, copied / where.name)
        for beside in where.parent.glob("pip-*.dist-info"):
            shutil.copytree(beside, copied / beside.name)
    else:
        (copied / "pip").mkdir(parents=True)
        (copied / "pip" / "__init__.py").touch()
        (copied / "pip" / "__main__.py").write_text(PIP)
    script = place / "quick-python"
    make = f'"{real}" -I -m venv --without-pip "$4" && exec cp -R "{copied}/." "$4/{library}/"'
    script.write_text(f'#!/bin/sh\ncase "$*" in "-I -m venv "*) {make} ;; *) exec "{real}" "$@" ;; esac\n')
    script.chmod(0o755)
    return script


def folder_of_wheels(place: Path) -> Path:
    """What PIP_FIND_LINKS points at where there is no index."""
    place.mkdir()
    (place / "setuptools-999-py3-none-any.whl").write_bytes(SETUPTOOLS)
    return place


def _wheel() -> bytes:
    """A `setuptools` that can only do what pip asks of it, the same bytes each time."""
    info = "setuptools-999.dist-info"
    files = {
        "setuptools/__init__.py": "",
        "setuptools/build_meta.py": BACKEND,
        f"{info}/METADATA": "Metadata-Version: 2.1\nName: setuptools\nVersion: 999\n",
        f"{info}/WHEEL": "Wheel-Version: 1.0\nGenerator: x\nRoot-Is-Purelib: true\nTag: py3-none-any\n",
    }
    files[f"{info}/RECORD"] = "".join(f"{name},sha256={_digest(text)},{len(text)}\n" for name, text in files.items())
    made = io.BytesIO()
    with zipfile.ZipFile(made, "w") as wheel:
        for name, text in files.items():
            wheel.writestr(zipfile.ZipInfo(name), text)
    return made.getvalue()


def _digest(text: str) -> str:
    return base64.urlsafe_b64encode(hashlib.sha256(text.encode()).digest()).rstrip(b"=").decode()


SETUPTOOLS = _wheel()
LOCK = f"setuptools==999 --hash=sha256:{hashlib.sha256(SETUPTOOLS).hexdigest()}\n"
