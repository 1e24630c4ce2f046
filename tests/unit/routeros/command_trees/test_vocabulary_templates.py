"""Every menu, command and argument that the templates can emit is in the tree of every version that we claim."""

import pytest
from spoken import lines
from templates_said import NEWER, bare, left_out, rendered, sources, unknown, words
from trees import TREES, VERSIONS, Tree

from atlantis_netcfg.core.versions import Version


@pytest.mark.parametrize("tree", TREES, ids=VERSIONS)
def test_all_that_templates_render_is_in_the_tree(tree: Tree) -> None:
    """Of 7.16, too: the templates' own minimum is higher, for the meaning of values, not for names."""
    said = [one for text in rendered() for one in lines(text, tree)]
    assert {(one.text, name) for one in said for name in unknown(one, tree)} == set()
    assert len(said) > 1000


@pytest.mark.parametrize("tree", TREES, ids=VERSIONS)
@pytest.mark.parametrize("name", sources())
def test_everything_written_in_a_template_is_in_the_tree(name: str, tree: Tree) -> None:
    said = list(lines(bare(sources()[name]), tree))
    assert [one.text for one in said if unknown(one, tree)] == []
    assert said


def test_arguments_listed_as_newer_are_newer() -> None:
    rows = [(menu, name, since) for (menu, name), since in NEWER.items()]
    for tree in TREES:
        for menu, name, since in rows:
            text = f"{menu.replace('/interface/', '/interface ')} set {name}=x"
            lacks = any(one.unknown(tree) for one in lines(text, tree))
            assert lacks is (Version.parse(tree.version) < Version.parse(since)), (tree.version, name)


def test_rendered_text_covers_everything_in_the_templates() -> None:
    """No branch is left out, or the tests above would say nothing of it; and nothing comes from anywhere else."""
    written = words(tuple(bare(source) for source in sources().values()))
    said = words(rendered())
    assert written - said == frozenset()
    assert said - written == frozenset()
    assert len(said) > 150
    assert left_out() == set()


@pytest.mark.parametrize("tree", TREES, ids=VERSIONS)
def test_misspelt_argument_in_a_template_would_be_detected(tree: Tree) -> None:
    text = bare("/ip route\nadd {% if x %} distanse={{ y }}{% endif %} gateway={{ z }}@main\n")
    assert [said.unknown(tree) for said in lines(text, tree)] == [frozenset({"distanse"})]
