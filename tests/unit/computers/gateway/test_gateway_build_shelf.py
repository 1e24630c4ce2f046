"""Builds on a shelf: which inputs make another one, which one is complete, and which ones are kept."""

from dataclasses import replace
from pathlib import Path

import pytest

from atlantis_netcfg.ansible_collections.atlantis.netcfg.plugins.module_utils import build_plan
from atlantis_netcfg.ansible_collections.atlantis.netcfg.plugins.module_utils.errors import ModuleError

COMMIT = "0123456789abcdef0123456789abcdef01234567"
PLAN = build_plan.BuildPlan(
    build_plan.Repository("https://git.example.org/c4i/library.git", "v1.0.0"),
    build_plan.Repository("https://git.example.org/c4i/examples.git", COMMIT),
    "/opt/ros/foxy/setup.sh",
    "9 aarch64-linux-gnu",
)


def made(shelf: build_plan.BuildStore, key: str) -> str:
    install = Path(shelf.at(key), "library", "install")
    install.mkdir(parents=True)
    (install / "setup.sh").touch()
    shelf.complete(key, {"notes": [], "commits": {}})
    return key


@pytest.mark.parametrize(
    "other",
    [
        replace(PLAN, library=build_plan.Repository(PLAN.library.url, "v1.0.1")),
        replace(PLAN, library=build_plan.Repository("https://mirror.example.org/library.git", "v1.0.0")),
        replace(PLAN, examples=None),
        replace(PLAN, ros_setup="/opt/ros/humble/setup.sh"),
        replace(PLAN, compiler="11 aarch64-linux-gnu"),
    ],
)
def test_every_build_input_changes_the_key(other: build_plan.BuildPlan) -> None:
    assert other.key != PLAN.key
    assert len(PLAN.key) == 12
    assert build_plan.BuildPlan.of(PLAN.as_dict()).key == PLAN.key


def test_commit_has_the_same_key_on_every_server() -> None:
    moved = replace(PLAN, examples=build_plan.Repository("https://mirror.example.org/examples.git", COMMIT))
    assert moved.key == PLAN.key
    assert PLAN.words == "library v1.0.0 and examples 0123456789ab"


def test_current_and_previous_builds_are_kept(tmp_path: Path) -> None:
    shelf = build_plan.BuildStore(str(tmp_path))
    for key in ("one", "two", "three"):
        shelf.use(made(shelf, key))
    assert (shelf.link_target("current"), shelf.link_target("previous")) == ("three", "two")
    made(shelf, "new")
    assert shelf.prune(busy=["new"]) == ["one"]
    assert (tmp_path / "current/build.json").exists()
    shelf.use("two")
    assert (shelf.link_target("current"), shelf.link_target("previous")) == ("two", "three")
    assert shelf.prune() == ["new"]
    shelf.use("two")
    assert (shelf.link_target("current"), shelf.link_target("previous")) == ("two", "three")


def test_build_without_its_marker_is_invalid(tmp_path: Path) -> None:
    shelf = build_plan.BuildStore(str(tmp_path))
    made(shelf, "one")
    marker = tmp_path / "builds/one/build.json"
    whole = marker.read_text()
    for cut in ("", whole[:20], "[]", whole.replace('"one"', '"two"')):
        marker.write_text(cut)
        assert shelf.marker("one") is None
    marker.write_text(whole)
    assert shelf.marker("one") is not None
    (tmp_path / "builds/one/library/install/setup.sh").unlink()
    assert shelf.marker("one") is None


def test_interruption_between_links_loses_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    shelf = build_plan.BuildStore(str(tmp_path))
    shelf.use(made(shelf, "one"))
    made(shelf, "two")
    link = shelf._link

    def cut(name: str, key: str) -> None:
        if name == "current":
            raise KeyboardInterrupt
        link(name, key)

    with monkeypatch.context() as patch:
        patch.setattr(shelf, "_link", cut)
        with pytest.raises(KeyboardInterrupt):
            shelf.use("two")
    assert shelf.link_target("current") == "one"
    shelf.use("two")
    assert (shelf.link_target("current"), shelf.link_target("previous")) == ("two", "one")


def test_interrupted_removal_leaves_no_build(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    shelf = build_plan.BuildStore(str(tmp_path))
    made(shelf, "one")

    def cut(*_: object) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr("shutil.rmtree", cut)
        with pytest.raises(KeyboardInterrupt):
            shelf.discard("one")
    assert shelf.marker("one") is None
    shelf.discard("one")
    shelf.discard("one")
    assert not (tmp_path / "builds/one").exists()


def test_folder_in_place_of_a_symlink_is_left_alone(tmp_path: Path) -> None:
    shelf = build_plan.BuildStore(str(tmp_path))
    (tmp_path / "current").mkdir()
    with pytest.raises(ModuleError, match="but must be a symbolic link to a build"):
        shelf.use(made(shelf, "one"))


def test_tags_are_stored_and_damage_is_survived(tmp_path: Path) -> None:
    shelf = build_plan.BuildStore(str(tmp_path))
    shelf.note_tags(PLAN, {"library": "a" * 40, "examples": COMMIT})
    assert shelf.tags() == {PLAN.library.url: {"v1.0.0": "a" * 40}}
    (tmp_path / "tags.json").write_text("{")
    assert shelf.tags() == {}
