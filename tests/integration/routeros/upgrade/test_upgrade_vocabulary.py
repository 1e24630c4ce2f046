"""Every sentence and line of an upgrade is in the command tree of the version that hears it."""

from pathlib import Path

from heard import listening
from test_upgrade import router, run
from trees import Tree


def test_upgrade_commands_exist_in_both_versions(tmp_path: Path) -> None:
    with router(tmp_path) as (_, upgrading), listening() as heard:
        run(upgrading)
    for version in ("7.18.2", "7.21.5"):
        assert heard.unknown(Tree(version)) == {}
    assert ("/system/package", "print") in {(one.menu, one.command) for one in heard.said(Tree("7.18.2"))}
