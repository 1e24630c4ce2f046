"""Every line that first contact types is in the command tree of the router's version."""

from pathlib import Path

import pytest
from carton import carton
from heard import listening
from trees import Tree

pytestmark = pytest.mark.slow


@pytest.mark.parametrize("version", ["7.18.2", "7.21.5"])
def test_first_contact_commands_exist_in_the_command_tree(version: str, tmp_path: Path) -> None:
    with carton(tmp_path, version=version) as box, listening() as heard:
        assert box.adopt().status == "changed"
        assert box.adopt().status == "unchanged"
    tree = Tree(version)
    assert heard.unknown(tree) == {}
    assert {("/user", "add"), ("/certificate", "sign"), ("/ip/service", "set")} <= {
        (one.menu, one.command) for one in heard.said(tree)
    }
