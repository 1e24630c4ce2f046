"""A stand-in for the partners' interoperability library and examples, which are not public: small projects of ours.

They have what the toolkit has to deal with: a colcon workspace of two packages, one of them a submodule with the
message definitions, and examples by cmake that find the library and yaml-cpp. They exchange nothing with anybody: what
the partners' library does on a network is not rehearsed by them.
"""

from __future__ import annotations

import os
import subprocess
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

NOT_THEIRS = "a stand-in of the ATLANTIS toolkit, not the partners' library"
"""Said by its programs and sources."""

NOT_REHEARSED = ("the interoperability library: small projects of ours are built in its place, and talk to nobody",)
"""What a run against stand-ins says nothing about."""

LIBRARY, EXAMPLES, MESSAGES = "uv-interoperability", "uv-interoperability-example", "c4i-asset-msgs"
_PACKAGE = """\
# {about}
cmake_minimum_required(VERSION 3.16)
project({name} CXX)
{body}
"""
_MESSAGES = {
    "CMakeLists.txt": _PACKAGE.format(
        about=NOT_THEIRS,
        name="c4i_asset_msgs",
        body="""\
add_library(c4i_asset_msgs INTERFACE)
target_include_directories(c4i_asset_msgs INTERFACE $<INSTALL_INTERFACE:include>)
install(DIRECTORY include/ DESTINATION include)
install(TARGETS c4i_asset_msgs EXPORT c4i_asset_msgsConfig)
install(EXPORT c4i_asset_msgsConfig DESTINATION lib/cmake/c4i_asset_msgs)""",
    ),
    "include/c4i_asset_msgs/stamped.hpp": """\
#pragma once
struct Stamped { double time_s; double value; };
""",
}
_LIBRARY = {
    "uv_interoperability/CMakeLists.txt": _PACKAGE.format(
        about=NOT_THEIRS,
        name="uv_interoperability",
        body="""\
find_package(c4i_asset_msgs REQUIRED)
add_library(uv_interoperability SHARED src/asset.cpp)
target_include_directories(uv_interoperability PUBLIC
  $<BUILD_INTERFACE:${CMAKE_CURRENT_SOURCE_DIR}/include> $<INSTALL_INTERFACE:include>)
target_link_libraries(uv_interoperability PUBLIC c4i_asset_msgs)
install(DIRECTORY include/ DESTINATION include)
install(TARGETS uv_interoperability EXPORT targets DESTINATION lib)
install(EXPORT targets DESTINATION lib/cmake/uv_interoperability)
install(FILES uv_interoperabilityConfig.cmake DESTINATION lib/cmake/uv_interoperability)""",
    ),
    "uv_interoperability/uv_interoperabilityConfig.cmake": """\
include(CMakeFindDependencyMacro)
find_dependency(c4i_asset_msgs)
include(${CMAKE_CURRENT_LIST_DIR}/targets.cmake)
""",
    "uv_interoperability/include/uv_interoperability/asset.hpp": """\
#pragma once
#include <c4i_asset_msgs/stamped.hpp>
const char *library_words();
Stamped telemetry(double value);
""",
}
_EXAMPLES = {
    "CMakeLists.txt": _PACKAGE.format(
        about=NOT_THEIRS,
        name="uv_interoperability_example",
        body="""\
include(more.cmake OPTIONAL)
find_package(uv_interoperability REQUIRED)
find_package(yaml-cpp REQUIRED)
add_executable(example-robot src/robot.cpp)
target_link_libraries(example-robot uv_interoperability yaml-cpp)""",
    ),
    "config/robot-config.yml": f"# {NOT_THEIRS}\nnamespace: TEST_ROBOT\nseconds: 3600\n",
    "src/robot.cpp": """\
#include <uv_interoperability/asset.hpp>
#include <yaml-cpp/yaml.h>
#include <cstdio>
#include <unistd.h>
int main(int count, char **words) {
  if (count < 2) { std::fprintf(stderr, "no configuration was named\\n"); return 2; }
  YAML::Node config = YAML::LoadFile(words[1]);
  std::printf("%s: %s\\n", config["namespace"].as<std::string>().c_str(), library_words());
  std::fflush(stdout);
  sleep(config["seconds"].as<unsigned>());
  return 0;
}
""",
}


def _asset(words: str) -> str:
    return f"""\
#include <uv_interoperability/asset.hpp>
const char *library_words() {{ return "{NOT_THEIRS}, {words}"; }}
Stamped telemetry(double value) {{ return {{0.0, value}}; }}
"""


@dataclass(frozen=True)
class InteropProjects:
    """The repositories in a folder that a git server may serve, by the partners' own names."""

    folder: Path

    def release(self, tag: str, words: str | None = None, *, submodule_at: str = "../c4i-asset-msgs.git") -> str:
        """Commit a release of the library under `tag`, moving it where it is there; gives the commit.

        `words` stand in the library and are said by its programs: another text is another commit.
        """
        messages = self._commit(MESSAGES, _MESSAGES, None)
        modules = f'[submodule "c4i-asset-msgs"]\n\tpath = c4i-asset-msgs\n\turl = {submodule_at}\n'
        files = {**_LIBRARY, "uv_interoperability/src/asset.cpp": _asset(words or tag), ".gitmodules": modules}
        return self._commit(LIBRARY, files, tag, {"c4i-asset-msgs": messages})

    def release_examples(self, tag: str, files: Mapping[str, str] | None = None) -> str:
        """Commit a release of the examples under `tag`; `files` replace or join theirs, `more.cmake` is included."""
        return self._commit(EXAMPLES, {**_EXAMPLES, **(files or {})}, tag)

    def branch(self, name: str) -> None:
        """Let a branch of the library lead to its last release."""
        self._git(LIBRARY, "branch", "--force", name, "main")

    def _commit(
        self, name: str, files: Mapping[str, str], tag: str | None, submodules: Mapping[str, str] | None = None
    ) -> str:
        """Write objects into the bare repository directly, as a push would; the same files are the same commit."""
        repository = self.folder / f"{name}.git"
        if not repository.is_dir():
            repository.mkdir(parents=True)
            self._git(name, "init", "--quiet", "--bare", "-b", "main")
        index = repository / "index.new"
        entries = [
            f"100644 {self._git(name, 'hash-object', '-w', '--stdin', text=text)}\t{path}"
            for path, text in files.items()
        ]
        entries += [f"160000 {commit}\t{path}" for path, commit in (submodules or {}).items()]
        self._git(name, "update-index", "--index-info", text="\n".join([*entries, ""]), index=index)
        tree = self._git(name, "write-tree", index=index)
        index.unlink()
        before = self._git(name, "for-each-ref", "--format=%(objectname)", "refs/heads/main")
        if before and self._git(name, "rev-parse", f"{before}^{{tree}}") == tree:
            commit = before
        else:
            commit = self._git(name, "commit-tree", tree, *(("-p", before) if before else ()), "-m", NOT_THEIRS)
        self._git(name, "update-ref", "refs/heads/main", commit)
        if tag is not None:
            self._git(name, "tag", "--force", tag, commit)
        return commit

    def _git(self, name: str, *words: str, text: str = "", index: Path | None = None) -> str:
        who = {"GIT_AUTHOR_NAME": "stand-in", "GIT_AUTHOR_EMAIL": "stand-in@example.org"}
        who |= {key.replace("AUTHOR", "COMMITTER"): value for key, value in who.items()}
        where = {"GIT_DIR": str(self.folder / f"{name}.git"), **({"GIT_INDEX_FILE": str(index)} if index else {})}
        done = subprocess.run(  # noqa: S603 - git, with words of ours
            ("git", *words),  # noqa: S607
            input=text,
            env={**os.environ, **who, **where},
            capture_output=True,
            text=True,
            check=True,
        )
        return done.stdout.strip()


def make_interop(folder: Path, tag: str) -> InteropProjects:
    """Make the repositories below `folder`, each with one release."""
    projects = InteropProjects(folder)
    projects.release(tag)
    projects.release_examples(tag)
    return projects
