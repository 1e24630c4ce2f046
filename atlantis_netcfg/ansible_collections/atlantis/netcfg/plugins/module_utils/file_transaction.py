"""Write directories, files and links: all are validated and synced to disk before the first one is moved.

Also finds unknown files in folders that only the toolkit uses: leftovers of an earlier inventory.
"""

from __future__ import annotations

import os
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Callable, Iterator

from atlantis_netcfg.core.messages import arg, msg

from .desired_state import mode_of
from .errors import ModuleError
from .programs import ProgramResult, is_there, last_lines

if TYPE_CHECKING:
    from .desired_state import DesiredState, Directory, File
    from .filesystem import FileSystem, FoundFile


class FileTransaction:
    """First half of a call. The constructor reads and rejects what cannot be replaced; `place` writes."""

    def __init__(self, tree: FileSystem, wishes: DesiredState, run: Callable[[list[str]], ProgramResult]) -> None:
        self.tree = tree
        self.wishes = wishes
        self.run = run
        self.found = {
            **{directory.path: self._find_of_kind(directory.path, ("directory",)) for directory in wishes.directories},
            **{file.path: self._find_of_kind(file.path, ("file", "link")) for file in wishes.files},
            **{link.path: self._find_of_kind(link.path, ("file", "link")) for link in wishes.links},
            **{path: self._find_of_kind(path, ("file", "link")) for path in wishes.absent},
        }
        self.owned: tuple[Directory | File, ...] = (*wishes.directories, *wishes.files)
        self.owners = {entry.path: (tree.uid(entry.owner), tree.gid(entry.group)) for entry in self.owned}
        self.rewritten = [request for request in wishes.files if self._has_other_content(request)]
        self._made: list[str] = []
        self.left: dict[str, tuple[str, str]] = {}
        """Rejected files that do not stop the rest: path -> finding and hint."""

    def changes(self) -> list[str]:
        """List the changes that `place` makes, one line each."""
        lines: list[str] = []
        for directory in self.wishes.directories:
            current = self.found[directory.path]
            lines += (
                [msg(f"directory {arg(directory.path)}")]
                if current is None
                else self._list_mode_changes(directory, current)
            )
        for file in self._accepted_files:
            current = self.found[file.path]
            if file in self.rewritten or current is None:
                lines.append(msg(f"file {arg(file.path)}"))
            else:
                lines += self._list_mode_changes(file, current)
        lines += [
            msg(f"link {arg(link.path)} -> {arg(link.target)}")
            for link in self.wishes.links
            if not self._is_link_to(link.path, link.target)
        ]
        return lines + [msg(f"absent {arg(path)}") for path in self.wishes.absent if self.found[path] is not None]

    def differences(self) -> list[dict[str, str]]:
        """Return the text changes for Ansible's diff; secret and binary files are left out."""
        rows = []
        for file in self.rewritten:
            current = self.found[file.path]
            before = _text(b"" if current is None else current.content)
            after = _text(file.data)
            if not file.secret and before is not None and after is not None:
                rows.append(_difference(file.path, before, after))
        for path in self.wishes.absent:
            current = self.found[path]
            before = None if current is None else _text(current.content)
            if before:
                rows.append(_difference(path, before, ""))
        return rows

    @property
    def _accepted_files(self) -> list[File]:
        return [file for file in self.wishes.files if file.path not in self.left]

    def validate_aside(self) -> None:
        """Run the validators on copies, without touching the files; skip validators that are not installed yet."""
        with tempfile.TemporaryDirectory(prefix="atlantis-") as folder:
            for file in self._files_to_validate():
                if is_there(file.validate[0]):
                    aside = Path(folder) / Path(file.path).name
                    aside.write_bytes(file.data)
                    self._ask(file, str(aside))

    def _files_to_validate(self) -> list[File]:
        """Return the files to validate: those that change and, in every run, those that may be left out."""
        return [file for file in self.wishes.files if file.validate and (file.finding or file in self.rewritten)]

    def place(self) -> None:
        """Write, validate and move into place. A failure before the first move rolls everything back."""
        try:
            self._make_directories()
            for file in self.wishes.files:
                self.tree.unstage(file.path)
            beside = {
                file.path: self.tree.stage(file.path, file.data, mode_of(file), *self.owners[file.path])
                for file in self.rewritten
            }
            for file in self._files_to_validate():
                self._ask(file, beside.get(file.path, str(self.tree.at(file.path))))
            for path in self.left:
                self.tree.unstage(path)
        except BaseException:
            self._undo_staging()
            raise
        self._apply_changes()

    def _apply_changes(self) -> None:
        for file in self.rewritten:
            self.tree.put(file.path)
        for request in self.owned:
            current = self.found[request.path]
            is_unchanged = request.path not in self.left and request not in self.rewritten
            if current is not None and is_unchanged and self._list_mode_changes(request, current):
                self.tree.set_attributes(request.path, mode_of(request), *self.owners[request.path])
        for link in self.wishes.links:
            if not self._is_link_to(link.path, link.target):
                self.tree.link(link.path, link.target)
        for path in self.wishes.absent:
            if self.found[path] is not None:
                self.tree.remove(path)
        for path in {str(Path(path).parent): path for path in self.found}.values():
            if Path(self.tree.at(path)).parent.is_dir():
                self.tree.sync(path)

    def _make_directories(self) -> None:
        for directory in self.wishes.directories:
            if self.found[directory.path] is None:
                self._make_parents(directory.path)
                self.tree.make_directory(directory.path, mode_of(directory), *self.owners[directory.path])
                self._made.append(directory.path)
        for path in (*(file.path for file in self.wishes.files), *(link.path for link in self.wishes.links)):
            self._make_parents(path)

    def _make_parents(self, path: str) -> None:
        for above in self.tree.missing_above(path):
            self.tree.make_directory(above, 0o755, os.geteuid(), os.getegid())
            self._made.append(above)

    def _undo_staging(self) -> None:
        for file in self.wishes.files:
            self.tree.unstage(file.path)
        for directory in reversed(self._made):
            self.tree.remove_directory(directory)

    def _ask(self, file: File, beside: str) -> None:
        """Validate a file; if it is rejected, leave it out where that is allowed, otherwise raise `ModuleError`."""
        program, end = file.validate[0], "which is unchanged" if file.finding else "so nothing was changed"
        if not is_there(program):
            why = msg(f"`{arg(program)}`, which must accept {arg(file.path)}, is not installed, {arg(end)}")
            self._skip_file(file, why, "install the package that provides it")
            return
        result = self.run([word.replace("%s", beside) for word in file.validate])
        if result.code != 0:
            text = "" if file.secret else ":\n" + last_lines(result.output.replace(beside, file.path))
            self._skip_file(
                file, msg(f"{arg(program)} does not accept the new {arg(file.path)}, {arg(end)}{arg(text)}"), file.hint
            )

    def _skip_file(self, file: File, why: str, hint: str) -> None:
        if not file.finding:
            raise ModuleError(why, hint)
        self.left[file.path] = (msg(f"{arg(file.finding)}: {arg(why)}"), hint)
        self.rewritten = [each for each in self.rewritten if each.path != file.path]

    def _find_of_kind(self, path: str, kinds: tuple[str, ...]) -> FoundFile | None:
        result = self.tree.find(path)
        if result is None or result.kind in kinds:
            return result
        if "directory" in kinds and result.kind == "link" and Path(self.tree.at(path)).is_dir():
            raise ModuleError(
                f"{arg(path)} is a link to a directory, but must be a directory", f"check it: `ls -l {arg(path)}`"
            )
        what = {"directory": "a directory", "file": "a file", "link": "a link"}.get(result.kind, "a device or a socket")
        raise ModuleError(
            f"{arg(path)} is {arg(what)}, but must be {arg(_describe_kind(kinds))}. Nothing was changed",
            f"check it and move it away: `ls -ld {arg(path)}`",
        )

    def _has_other_content(self, file: File) -> bool:
        current = self.found[file.path]
        return current is None or current.kind != "file" or current.content != file.data

    def _is_link_to(self, path: str, target: str) -> bool:
        current = self.found[path]
        return current is not None and current.kind == "link" and current.target == target

    def _list_mode_changes(self, request: Directory | File, current: FoundFile) -> list[str]:
        is_directory = request in self.wishes.directories
        lines = []
        if current.mode != (mode := mode_of(request)):
            lines.append(
                msg(
                    f"{'directory' if is_directory else 'file'} {arg(request.path)} mode {arg(current.mode):04o} "
                    f"-> {arg(mode):04o}"
                )
            )
        if (current.uid, current.gid) != self.owners[request.path]:
            lines.append(
                msg(
                    f"{'directory' if is_directory else 'file'} {arg(request.path)} owner -> "
                    f"{arg(request.owner)}:{arg(request.group)}"
                )
            )
        return lines


def _describe_kind(kinds: tuple[str, ...]) -> str:
    return "a directory" if "directory" in kinds else "a file"


def _text(content: bytes) -> str | None:
    try:
        return content.decode()
    except UnicodeDecodeError:
        return None


def _difference(path: str, before: str, after: str) -> dict[str, str]:
    return {"before_header": path, "after_header": path, "before": before, "after": after}


def unknown_paths(tree: FileSystem, wishes: DesiredState) -> tuple[str, ...]:
    """Return unknown files and links, at any depth, below the folders `only`; links to directories are not followed."""
    kinds = (wishes.directories, wishes.files, wishes.links)
    declared_paths = {item.path for kind in kinds for item in kind} | {*wishes.absent}
    return tuple(
        path for folder in wishes.only for path in _list_files_below(tree, folder) if path not in declared_paths
    )


def clear(tree: FileSystem, wishes: DesiredState, removed_paths: tuple[str, ...]) -> None:
    """Remove the directories that have become empty, up to the folders `only`, which stay."""
    for folder in map(Path, wishes.only):
        below = {above for path in removed_paths for above in Path(path).parents if folder in above.parents}
        for empty in sorted(below, key=lambda path: len(path.parts), reverse=True):
            tree.remove_directory(str(empty))


def _list_files_below(tree: FileSystem, folder: str) -> Iterator[str]:
    root = Path(tree.root)
    for at, directories, files in os.walk(tree.at(folder)):
        links = [name for name in directories if Path(at, name).is_symlink()]
        yield from (f"/{Path(at, name).relative_to(root)}" for name in sorted(files + links))
