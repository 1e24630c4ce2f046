"""Plan of a build, and the layout on disk: the build's folder, its completion marker, and the links to builds.

Below the prefix, `/opt/atlantis/interop`:

    builds/KEY/library/           the library's sources, with `install/` of colcon in them, as in the report
    builds/KEY/examples/build/    the examples, built by cmake and make
    builds/KEY/build.json         written last: without it the build was interrupted
    current, previous             links to the build in use, and to the one before it
    tags.json                     the commit that each tag pointed to when it was last built
"""

# ruff: noqa: PTH108, PTH112, PTH113, PTH114, PTH118, PTH119
# ruff: noqa: PTH123, PTH208 - paths are text on the gateways' side, where all modules share it

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import re
import shutil
from dataclasses import asdict, dataclass
from typing import Any, Collection, Mapping

from atlantis_netcfg.core.messages import arg, join
from atlantis_netcfg.core.stored_messages import pack, unpack

from .errors import ModuleError, as_module_error
from .filesystem import FileSystem

MARKER = "build.json"
_KEY_DIGITS = 12
_TREE = FileSystem()


def is_commit(revision: str) -> bool:
    """Return whether a revision is a full commit hash, which never changes its meaning."""
    return re.fullmatch(r"[0-9a-f]{40}|[0-9a-f]{64}", revision) is not None


@dataclass(frozen=True)
class Repository:
    """A git repository at a revision: a tag or a full commit hash."""

    url: str
    revision: str

    @property
    def identity(self) -> str:
        """Input that decides what is built: a commit is the same on every server, a tag is not."""
        return self.revision if is_commit(self.revision) else f"{self.url} {self.revision}"


@dataclass(frozen=True)
class BuildPlan:
    """All inputs that decide the result of a build; contains no secret."""

    library: Repository
    examples: Repository | None
    ros_setup: str
    """File that is sourced before building, `/opt/ros/DISTRIBUTION/setup.sh`."""
    compiler: str
    """Version and target of the compiler."""

    @classmethod
    def of(cls, values: Mapping[str, Any]) -> BuildPlan:
        """Parse the result of `as_dict`."""
        examples = values["examples"]
        return cls(
            Repository(**values["library"]),
            Repository(**examples) if examples is not None else None,
            values["ros_setup"],
            values["compiler"],
        )

    def as_dict(self) -> dict[str, Any]:
        """Return the plan as JSON-serialisable data."""
        return asdict(self)

    @property
    def repositories(self) -> dict[str, Repository]:
        """Repositories by the name of their folder."""
        both = {"library": self.library, "examples": self.examples}
        return {name: repository for name, repository in both.items() if repository is not None}

    @property
    def key(self) -> str:
        """Name of the build: the same inputs have the same key."""
        inputs = [self.library.identity, self.examples.identity if self.examples is not None else "", self.ros_setup]
        return hashlib.sha256("\n".join([*inputs, self.compiler]).encode()).hexdigest()[:_KEY_DIGITS]

    @property
    def words(self) -> str:
        """Description of the plan for a person."""
        return join(
            " and ",
            (f"{name} {_shorten_revision(repository.revision)}" for name, repository in self.repositories.items()),
        )


def _shorten_revision(revision: str) -> str:
    return revision[:_KEY_DIGITS] if is_commit(revision) else revision


class BuildStore:
    """The builds below a prefix."""

    def __init__(self, prefix: str) -> None:
        self.prefix = prefix

    def at(self, key: str) -> str:
        """Return the folder of a build."""
        return os.path.join(self.prefix, "builds", key)

    def marker(self, key: str) -> dict[str, Any] | None:
        """Return the marker data of a complete build; None for a build that is incomplete or missing."""
        path = os.path.join(self.at(key), MARKER)
        try:
            with open(path, "rb") as file:
                result = json.loads(file.read())
        except (OSError, ValueError):
            return None
        is_marker = isinstance(result, dict) and result.get("key") == key
        return (
            unpack(result)
            if is_marker and os.path.isfile(os.path.join(self.at(key), "library", "install", "setup.sh"))
            else None
        )

    def complete(self, key: str, marker: Mapping[str, Any]) -> None:
        """Mark a build as complete, once all its files are synced to the card."""
        os.sync()
        _TREE.write(os.path.join(self.at(key), MARKER), _json(pack({**marker, "key": key})))

    def link_target(self, name: str) -> str | None:
        """Return the key of the build that a link points to; None if there is no such link."""
        try:
            return os.path.basename(os.readlink(os.path.join(self.prefix, name)))
        except OSError:
            return None

    def use(self, key: str) -> None:
        """Make a complete build the current one; the current one becomes the previous one.

        `previous` is written first: an interruption between the two leaves one extra link, and `current` untouched.
        """
        current = self.link_target("current")
        if current == key:
            return
        if current is not None and self.marker(current) is not None:
            self._link("previous", current)
        self._link("current", key)

    def prune(self, busy: Collection[str] = ()) -> list[str]:
        """Remove builds that are neither current, nor previous, nor in `busy`; return their keys."""
        needed_keys = {self.link_target("current"), self.link_target("previous"), *busy}
        try:
            keys = sorted(os.listdir(os.path.join(self.prefix, "builds")))
        except FileNotFoundError:
            return []
        stale = [key for key in keys if key not in needed_keys]
        for key in stale:
            self.discard(key)
        return stale

    def discard(self, key: str) -> None:
        """Remove a build, its marker first, so that a half-removed build is never mistaken for a complete one."""
        path = self.at(key)
        try:
            with contextlib.suppress(FileNotFoundError):
                os.unlink(os.path.join(path, MARKER))
            shutil.rmtree(path)
        except FileNotFoundError:
            return
        except OSError as error:
            raise as_module_error(error, path) from error

    def tags(self) -> dict[str, dict[str, str]]:
        """Return the commit of each tag as last built (URL -> tag -> commit); a damaged file counts as empty."""
        try:
            with open(os.path.join(self.prefix, "tags.json"), "rb") as file:
                result = json.loads(file.read())
        except (OSError, ValueError):
            return {}
        return result if isinstance(result, dict) and all(isinstance(item, dict) for item in result.values()) else {}

    def note_tags(self, plan: BuildPlan, commits: Mapping[str, str]) -> None:
        """Record the commit that each tag pointed to."""
        tags = self.tags()
        for name, repository in plan.repositories.items():
            if not is_commit(repository.revision):
                tags.setdefault(repository.url, {})[repository.revision] = commits[name]
        if tags != self.tags():
            _TREE.write(os.path.join(self.prefix, "tags.json"), _json(tags))

    def _link(self, name: str, key: str) -> None:
        path = os.path.join(self.prefix, name)
        if os.path.isdir(path) and not os.path.islink(path):
            raise ModuleError(
                f"{arg(path)} is a folder, but must be a symbolic link to a build",
                f"move it away: mv {arg(path)} {arg(path)}.old",
            )
        _TREE.link(path, os.path.join("builds", key))
        _TREE.sync(path)


def _json(data: Mapping[str, Any]) -> bytes:
    return (json.dumps(data, indent=1, sort_keys=True) + "\n").encode()
