"""Building: the steps of the report with a colcon that is played here, and a look at what came of them."""

import subprocess
from pathlib import Path

import pytest

from atlantis_netcfg.ansible_collections.atlantis.netcfg.plugins.module_utils.build_make import BuildTools
from atlantis_netcfg.ansible_collections.atlantis.netcfg.plugins.module_utils.build_messages import CardFull
from atlantis_netcfg.ansible_collections.atlantis.netcfg.plugins.module_utils.errors import ModuleError

MODULE = "atlantis_netcfg.ansible_collections.atlantis.netcfg.plugins.module_utils.build_make"
BUILDS = "mkdir -p install/package build log; echo 'export SOURCED=yes' >install/setup.sh"


@pytest.fixture
def make(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> BuildTools:
    for name in ("bin", "library", "examples/build"):
        (tmp_path / name).mkdir(parents=True)
    (tmp_path / "log").touch()
    (tmp_path / "ros.sh").write_text("export ROS_DISTRO=foxy\n")
    monkeypatch.setattr(f"{MODULE}._PATH", f"{tmp_path}/bin:/usr/bin:/bin")
    return BuildTools(str(tmp_path), str(tmp_path / "ros.sh"), 2, str(tmp_path / "log"), lambda _: None)


def colcon(folder: Path, script: str) -> None:
    program = folder / "bin/colcon"
    program.write_text(f"#!/bin/sh\n{script}\n")
    program.chmod(0o755)


def test_library_is_built_in_the_ros_environment(make: BuildTools, tmp_path: Path) -> None:
    colcon(tmp_path, f"{BUILDS}; echo $ROS_DISTRO $MAKEFLAGS $TMPDIR $*")
    make.library()
    assert f"foxy -j2 {tmp_path}/{'tmp'} build --executor sequential" in (tmp_path / "log").read_text()
    make.tidy()
    assert [path.name for path in (tmp_path / "library").iterdir()] == ["install"]
    assert not (tmp_path / "tmp").exists()


def test_remains_of_an_attempt_are_removed(make: BuildTools, tmp_path: Path) -> None:
    colcon(tmp_path, BUILDS)
    make.library()
    (tmp_path / "library/CMakeLists.txt").touch()
    make.clean()
    assert [path.name for path in (tmp_path / "library").iterdir()] == ["CMakeLists.txt"]
    assert not (tmp_path / "examples/build").exists()


@pytest.mark.parametrize(
    ("script", "words"),
    [
        ("mkdir install; touch install/setup.sh", "colcon found no package"),
        ("echo 'x.cpp:1: error: no'; exit 2", "the library could not be built:\nx.cpp:1: error: no"),
        ("echo 'fatal error: cannot write: No space left on device'; exit 1", "became full"),
    ],
)
def test_failure_is_explained_from_this_attempt_only(make: BuildTools, tmp_path: Path, script: str, words: str) -> None:
    (tmp_path / "log").write_text("y.cpp:9: error: of the attempt before\n")
    colcon(tmp_path, script)
    with pytest.raises(ModuleError, match=words) as caught:
        make.library()
    assert "attempt before" not in caught.value.message
    assert isinstance(caught.value, CardFull) == ("full" in words)


def test_program_without_its_library_is_no_valid_build(make: BuildTools, tmp_path: Path) -> None:
    install = tmp_path / "library/install"
    (install / "lib").mkdir(parents=True)
    (install / "setup.sh").touch()
    for source, words in (
        ("int one() { return 0; }", ("-shared", "-fPIC", "-o", "library/install/lib/libone.so")),
        ("int one(); int main() { return one(); }", ("-o", "examples/build/robot", "library/install/lib/libone.so")),
    ):
        (tmp_path / "source.cpp").write_text(source)
        subprocess.run(["c++", "source.cpp", *words], cwd=tmp_path, check=True)
    (install / "setup.sh").write_text(f"export LD_LIBRARY_PATH={tmp_path}\n")
    make.check()
    (install / "lib/libone.so").unlink()
    with pytest.raises(ModuleError, match=r"examples/build/robot does not find library/install/lib/libone.so"):
        make.check()
