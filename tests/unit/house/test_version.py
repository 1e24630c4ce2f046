"""One version, in `atlantis_netcfg/__init__.py`: package, collection, change log and `provision help version` agree."""

import re
import tomllib
from pathlib import Path

import pytest
import yaml

import atlantis_netcfg
from atlantis_netcfg import cli

ROOT = Path(__file__).parents[3]


def test_the_package_takes_its_version_from_the_module() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    assert project["tool"]["setuptools"]["dynamic"]["version"] == {"attr": "atlantis_netcfg.__version__"}
    assert project["project"]["dynamic"] == ["version"]


def test_change_log_and_collection_have_the_version_of_the_package() -> None:
    versions = re.findall(r"^## \[(.*?)\]", (ROOT / "CHANGELOG.md").read_text(encoding="utf-8"), re.MULTILINE)
    collection = yaml.safe_load((ROOT / "atlantis_netcfg/ansible_collections/atlantis/netcfg/galaxy.yml").read_text())
    assert (versions[0], collection["version"]) == (atlantis_netcfg.__version__,) * 2


def test_help_version_prints_it(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["help", "version"]) == 0
    assert f"provision {atlantis_netcfg.__version__}\n" in capsys.readouterr().out
