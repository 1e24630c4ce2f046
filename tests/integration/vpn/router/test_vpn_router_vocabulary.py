"""Every sentence of an installation is in the command tree of the version that hears it."""

from pathlib import Path

from heard import listening
from router_stand import router
from trees import Tree

from atlantis_netcfg.core.errors import ExitCode


def test_installation_commands_exist_in_both_versions(tmp_path: Path) -> None:
    with router(tmp_path, "7.18.2", certificates=("atlantis-api", "atlantis-vpn")) as stand, listening() as heard:
        assert stand.install().exit is ExitCode.DONE
    for version in ("7.18.2", "7.21.5"):
        assert heard.unknown(Tree(version)) == {}
    said = {(one.menu, one.command) for one in heard.said(Tree("7.18.2"))}
    assert {("/interface/ovpn-client", "import-ovpn-configuration"), ("/certificate", "import")} <= said
