"""Where a bundle is made: nobody who may write to the folder above can have it made elsewhere."""

import os
from pathlib import Path

import pytest

from atlantis_netcfg.computers.bundle.build import open_staging
from atlantis_netcfg.computers.bundle.requirements import BundleError
from atlantis_netcfg.core.errors import UsageError


def test_symlinked_staging_folder_is_refused(tmp_path: Path) -> None:
    victim = tmp_path / "victim"
    victim.mkdir()
    (tmp_path / ".bundle.part").symlink_to(victim)
    with pytest.raises(BundleError, match="cannot be made"), open_staging(tmp_path / "bundle"):
        pass
    assert [*victim.iterdir()] == []


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can give a folder away")
def test_staging_folder_of_another_user_is_refused(tmp_path: Path) -> None:
    (tmp_path / ".bundle.part").mkdir()
    os.chown(tmp_path / ".bundle.part", 65534, 65534)
    with pytest.raises(UsageError, match="belongs to nobody"), open_staging(tmp_path / "bundle"):
        pass
    assert [*(tmp_path / ".bundle.part").iterdir()] == []
