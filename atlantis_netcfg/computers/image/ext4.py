"""An ext4 file system inside an image file, read and edited by debugfs at its offset, without mount or root.

debugfs(8) always ends with 0: after editing, the file system is checked, and every edit is read back. Paths come from
this package; a path that debugfs could split is refused.

Layouts of board images are data, one row a board. A new board is a row.
"""

from __future__ import annotations

import re
import shutil
import struct
import subprocess
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING

from atlantis_netcfg.computers.image import facts
from atlantis_netcfg.core import processes, temporary
from atlantis_netcfg.core.messages import arg, conjunction, join, msg

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping, Sequence


PROGRAMS = {"e2fsck": "e2fsprogs", "debugfs": "e2fsprogs", "mcopy": "mtools"}
"""Programs that edit an image -> Debian packages that hold them."""
_NOT_EDITED = frozenset({"inline_data"})
"""File system features that debugfs(8) can read but not edit."""
_OTHER_IMAGE = "use an image from the vendor that was made without it"

_PATH = re.compile(r"(/[A-Za-z0-9._@+~-]+)+|/")
_KINDS = {"regular": 0o100000, "directory": 0o040000, "symlink": 0o120000}
_ERRORS_FIXED = 1
"""Exit code of e2fsck(8): errors were corrected, such as a journal that was replayed."""


def require_tools(*names: str) -> None:
    """Raise ImageError with all programs that are not installed."""
    missing = [name for name in names if _find_program(name) is None]
    if missing:
        tools = conjunction(f"`{name}`" for name in missing)
        packages = " ".join(dict.fromkeys(PROGRAMS[name] for name in missing))
        raise facts.ImageError(
            f"{arg(tools)} {'is' if len(missing) == 1 else 'are'} not installed on this computer",
            hint=f"sudo apt install {arg(packages)}",
        )


def tool(name: str) -> str:
    """Return the path of a system program. Raises ImageError if it is not installed."""
    require_tools(name)
    return _find_program(name) or name


def _find_program(name: str) -> str | None:
    return shutil.which(name, path=processes.program_path())


@dataclass(frozen=True, slots=True)
class FileStatus:
    """Type, mode, owner and link target of a path."""

    kind: str
    """`regular`, `directory`, `symlink`, or another type as debugfs names it."""
    mode: int
    """Permission bits."""
    owner: tuple[int, int]
    target: str
    """Target of a short symbolic link."""


@dataclass(frozen=True, slots=True)
class Ext4:
    """One ext4 file system; `image` is a working copy whose path has no blanks."""

    image: Path
    offset: int

    @property
    def _image_at_offset(self) -> str:
        return f"{self.image}?offset={self.offset}"

    def recover(self) -> None:
        """Replay an open journal. Raises ImageError if the file system is damaged."""
        process = self._run([tool("e2fsck"), "-p", self._image_at_offset])
        if unknown := re.search(r"unsupported feature\(s\): ([\w ,]*\w)", process.stdout):
            raise facts.ImageError(
                "the image's file system has features that e2fsprogs of this computer does not know: "
                f"{arg(unknown[1])}",
                hint="use a computer with a newer e2fsprogs, or an older image from the vendor",
            )
        if process.returncode not in {0, _ERRORS_FIXED}:
            raise facts.ImageError(
                f"the image's file system is damaged: {arg(_last_line(process.stdout))}", hint="download it again"
            )

    def require_editable(self) -> None:
        """Raise ImageError if the file system has features that debugfs cannot edit."""
        result = re.search(r"^Filesystem features:(.*)", self._query_debugfs("features"), re.MULTILINE)
        if features := sorted(_NOT_EDITED & {*(result[1].split() if result else ())}):
            raise facts.ImageError(
                f"the image's file system has the feature `{arg(features[0])}`, which debugfs cannot edit",
                hint=_OTHER_IMAGE,
            )

    def check(self) -> None:
        """Raise ImageError if the file system is not clean."""
        process = self._run([tool("e2fsck"), "-fn", self._image_at_offset])
        if process.returncode:
            raise facts.ImageError(
                f"the image's file system is damaged after customising: {arg(_last_line(process.stdout))}"
            )

    def status(self, path: str) -> FileStatus | None:
        """Return the status of a path, None if nothing is there; links in the path are not followed."""
        text = self._query_debugfs(f"stat {_safe_path(path)}")
        head = re.search(r"Type: (\w+).*?Mode:\s+(\d+).*?User:\s+(\d+)\s+Group:\s+(\d+)", text, re.DOTALL)
        if head is None:
            return None
        target = re.search(r'Fast link dest: "(.*)"', text)
        owner = (int(head[3]), int(head[4]))
        return FileStatus(head[1], int(head[2], 8), owner, target[1] if target else "")

    def read(self, path: str) -> bytes | None:
        """Return a file's bytes, or None if there is no regular file."""
        status = self.status(path)
        if status is None or status.kind != "regular":
            return None
        with temporary.folder("ext4", self.image.parent) as scratch:
            out = scratch / "file"
            self._query_debugfs(f"dump {_safe_path(path)} {out}")
            return out.read_bytes() if out.exists() else None

    def names(self, path: str) -> tuple[str, ...]:
        """Return the names in a directory; empty if it does not exist."""
        text = self._query_debugfs(f"ls -p {_safe_path(path)}")
        entries = (line.split("/")[5] for line in text.splitlines() if line.count("/") >= 6)  # noqa: PLR2004
        return tuple(sorted(name for name in entries if name not in {"", ".", ".."}))

    def exists(self, path: str) -> bool:
        """Return whether a path exists, also through links such as /sbin -> usr/sbin."""
        return self.status(path) is not None

    def require_no_symlink(self, paths: Iterable[str]) -> None:
        """Raise ImageError if a path is a symbolic link: debugfs would edit the link itself."""
        for path in paths:
            status = self.status(path)
            if status is not None and status.kind == "symlink":
                to = msg(f" to {arg(status.target)}" if re.fullmatch(r"[A-Za-z0-9._@+~/-]+", status.target) else "")
                raise facts.ImageError(
                    f"{arg(path)} of the image is a symbolic link{arg(to)}; files behind a link are not edited",
                    hint="use an image from the vendor in which it is a file or directory",
                )

    def apply(self, edits: Sequence[facts.Edit]) -> None:
        """Apply the edits, check the file system, and read each edit back. Raises ImageError."""
        above = [edit.path for edit in edits if isinstance(edit, facts.ImageDirectory)] + [
            _parent(edit.path) for edit in edits
        ]
        self.require_no_symlink(dict.fromkeys(above))
        with temporary.folder("ext4", self.image.parent) as scratch:
            commands = [line for number, edit in enumerate(edits) for line in self._commands(edit, number, scratch)]
            batch = scratch / "commands"
            batch.write_text("".join(f"{line}\n" for line in commands))
            process = self._run([tool("debugfs"), "-w", "-f", str(batch), self._image_at_offset])
        self.check()
        for edit in edits:
            self._verify(edit, _complaint(process.stdout))

    def _commands(self, edit: facts.Edit, number: int, scratch: Path) -> Iterator[str]:
        path = _safe_path(edit.path)
        there = self.status(path)
        if isinstance(edit, facts.ImageDirectory):
            if there is None:
                yield f"mkdir {path}"
            yield from _attributes(path, _KINDS["directory"] | edit.mode, edit.owner)
            return
        if there is not None:
            if there.kind == "directory":
                raise facts.ImageError(f"the image has a directory at {arg(path)}, where a file is expected")
            yield f"rm {path}"
        if isinstance(edit, facts.ImageFile):
            (scratch / str(number)).write_bytes(edit.content)
            yield f"write {scratch / str(number)} {path}"
            yield from _attributes(path, _KINDS["regular"] | edit.mode, edit.owner)
        elif isinstance(edit, facts.ImageLink):
            yield f"symlink {path} {_safe_target(edit.target)}"

    def _verify(self, edit: facts.Edit, complaint: str) -> None:
        status = self.status(edit.path)
        if isinstance(edit, facts.Remove):
            current = status is None
        elif status is None:
            current = False
        elif isinstance(edit, facts.ImageFile):
            current = self.read(edit.path) == edit.content and (status.mode, status.owner) == (edit.mode, edit.owner)
        elif isinstance(edit, facts.ImageDirectory):
            current = status.kind == "directory" and (status.mode, status.owner) == (edit.mode, edit.owner)
        else:
            current = status.kind == "symlink" and status.target == edit.target
        if not current:
            raise facts.ImageError(
                f"{arg(edit.path)} of the image could not be written: {arg(complaint or 'the data read back differs')}",
                hint="the image's file system may be full; nothing was written to a card",
            )

    def _query_debugfs(self, request: str) -> str:
        return self._run([tool("debugfs"), "-R", request, self._image_at_offset]).stdout

    @staticmethod
    def _run(command: list[str]) -> subprocess.CompletedProcess[str]:
        return subprocess.run(  # noqa: S603 - a program of the system, and arguments that are ours
            command,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            errors="replace",
            check=False,
            env={"LC_ALL": "C", "DEBUGFS_PAGER": "cat", "PAGER": "cat"},
        )


def _attributes(path: str, mode: int, owner: tuple[int, int]) -> Iterator[str]:
    yield f"set_inode_field {path} mode 0{mode:o}"
    yield f"set_inode_field {path} uid {owner[0]}"
    yield f"set_inode_field {path} gid {owner[1]}"


def _safe_path(path: str) -> str:
    if not _PATH.fullmatch(path) or ".." in PurePosixPath(path).parts:
        raise facts.ImageError(f"`{arg(path)}` cannot be the path of a file in an image")
    return path


def _safe_target(target: str) -> str:
    if not re.fullmatch(r"[A-Za-z0-9._@+~/-]{1,59}", target):  # 60 bytes and more are no fast link
        raise facts.ImageError(f"`{arg(target)}` cannot be the target of a link in an image")
    return target


def _parent(path: str) -> str:
    return str(PurePosixPath(path).parent)


def _complaint(text: str) -> str:
    """Return debugfs's first error line, without echoed commands and inode counts; it is nearest to the cause."""
    lines = (line.strip() for line in text.splitlines() if not line.startswith(("debugfs", "Allocated inode")))
    return next(filter(None, lines), "")


def _last_line(text: str) -> str:
    return next((line.strip() for line in reversed(text.splitlines()) if line.strip()), "no message")


_SECTOR = 512
_TABLE = 446
_ENTRY = struct.Struct("<B3sB3sII")
_GPT_PROTECTIVE = 0xEE
_EXT4_MAGIC = (1024 + 56, b"\x53\xef")
_BOOT_MAGIC = (510, b"\x55\xaa")


@dataclass(frozen=True, slots=True)
class DiskLayout:
    """Partition layout of one kind of image."""

    name: str
    root: int | None
    """Number of the partition with `/`; None: the only one that holds ext4."""
    root_at: int | None
    """First byte of that partition, if every image of this kind has the same; an image with another one is refused."""
    boot: int | None
    """Number of a FAT partition; None: there may be none."""
    marker: str
    """File in the FAT partition of every such image; empty: none is known."""
    interface: str
    """Interface of the LAN, if the board has one name for it; empty: the only wired card, whatever its name."""


LAYOUTS: Mapping[str, DiskLayout] = {
    layout.name: layout
    for layout in (
        # Hardkernel's minimal images: U-Boot in the gap from sector 1, FAT at sector 2048, ext4 at sector 264192
        # (facts of the project, from public code; not seen on a board). The N2 names its one Ethernet card eth0.
        DiskLayout("odroid-n2", root=2, root_at=264192 * _SECTOR, boot=1, marker="boot.ini", interface="eth0"),
        # Whatever boots by a partition table alone: x86, Raspberry-type boards.
        DiskLayout("plain", root=None, root_at=None, boot=None, marker="", interface=""),
    )
}


@dataclass(frozen=True, slots=True)
class FatLocation:
    """Position of the FAT partition."""

    offset: int


@dataclass(frozen=True, slots=True)
class FileSystemOffsets:
    """File systems of one image."""

    root: int
    """First byte of the ext4 file system with `/`."""
    boot: FatLocation | None


def find(image: Path, layout: DiskLayout) -> FileSystemOffsets:
    """Read an image's partition table. Raises ImageError if the image has another layout."""
    with image.open("rb") as file:
        starts = _partitions(file.read(_SECTOR * 34))
        ext4 = [number for number, at in starts.items() if _has_magic(file.seek(at) and file.read(2048), _EXT4_MAGIC)]
        fat = [number for number, at in starts.items() if _is_fat(file.seek(at) and file.read(_SECTOR))]
    root = layout.root if layout.root is not None else _only_partition(ext4)
    if root not in ext4:
        raise _layout_error(layout, msg(f"its partition {arg(root)} contains no ext4"))
    if layout.root_at is not None and starts[root] != layout.root_at:
        raise _layout_error(
            layout, msg(f"its partition {arg(root)} starts at byte {arg(starts[root])}, not at {arg(layout.root_at)}")
        )
    if layout.boot is not None and layout.boot not in fat:
        raise _layout_error(layout, msg(f"its partition {arg(layout.boot)} contains no FAT"))
    boot = layout.boot if layout.boot is not None else next(iter(fat), None)
    return FileSystemOffsets(starts[root], None if boot is None else FatLocation(starts[boot]))


def _layout_error(layout: DiskLayout, why: str) -> facts.ImageError:
    return facts.ImageError(
        f"the image does not have layout `{arg(layout.name)}`: {arg(why)}",
        hint=f"use the image of that board, or set another `layout`: {arg(join(', ', LAYOUTS))}",
    )


def _only_partition(ext4: list[int]) -> int:
    if len(ext4) != 1:
        finding = msg(f"partitions {arg(join(', ', map(str, ext4)))} do" if ext4 else "none does")
        raise facts.ImageError(
            f"one partition of the image must hold ext4, and {arg(finding)}", hint="set the `layout` of the board"
        )
    return ext4[0]


def _partitions(start: bytes) -> dict[int, int]:
    """Return the first byte of each partition, by number: MBR (primary) or GPT (UEFI 2.10, 5.3)."""
    if not _has_magic(start, _BOOT_MAGIC):
        raise facts.ImageError("the image contains no partition table", hint="is it an image of a whole card?")
    rows = [_ENTRY.unpack_from(start, _TABLE + _ENTRY.size * row) for row in range(4)]
    if not any(row[2] == _GPT_PROTECTIVE for row in rows):
        return {number: row[4] * _SECTOR for number, row in enumerate(rows, 1) if row[2] and row[4]}
    if start[_SECTOR : _SECTOR + 8] != b"EFI PART":
        raise facts.ImageError("the GPT of the image is damaged", hint="download it again")
    where, count, size = struct.unpack_from("<QII", start, _SECTOR + 72)
    result = {}
    for row in range(min(count, 128)):
        at = where * _SECTOR + row * size
        if any(start[at : at + 16]):
            result[row + 1] = struct.unpack_from("<Q", start, at + 32)[0] * _SECTOR
    return result


def _has_magic(data: bytes | int, magic: tuple[int, bytes]) -> bool:
    at, expected_bytes = magic
    return isinstance(data, bytes) and data[at : at + len(expected_bytes)] == expected_bytes


def _is_fat(sector: bytes | int) -> bool:
    return isinstance(sector, bytes) and (sector[54:57] == b"FAT" or sector[82:87] == b"FAT32")
