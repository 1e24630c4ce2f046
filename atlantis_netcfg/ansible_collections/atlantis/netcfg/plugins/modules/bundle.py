"""Module `atlantis.netcfg.bundle`: the gateway's side of a bundle transfer; `atlantis.netcfg.bundle_copy` calls it.

Below `/var/lib/atlantis/bundle`:

    ID/                 a complete bundle: its files as links into the store, and `.held.json`, which lists them
    .store/SHA256       content verified against its SHA-256; content shared with a later bundle is not sent again
    .incoming/ID.tar    upload in progress: files named by their SHA-256; whole files of an interrupted one are kept

Everything is written beside its destination and renamed, so that work continues after a power cut at any moment.
"""

# ruff: noqa: E402, TID252 - a module begins with its documentation, and Ansible ships what is imported relatively
# ruff: noqa: PTH101, PTH102, PTH103, PTH104, PTH105, PTH108, PTH112, PTH118, PTH120, PTH123, PTH208 - paths are text here

from __future__ import annotations

DOCUMENTATION = r"""
module: bundle
short_description: Say what of a bundle is missing on a computer, and put it together when nothing is
description:
  - Takes in what was uploaded, also of an upload that was cut off, compares each file with its SHA-256, and puts the
    bundle together in C(/var/lib/atlantis/bundle/ID) once it is whole. Older bundles are removed then.
  - Content that the computer has from an earlier bundle is not missing.
options:
  id: {description: The bundle., type: str, required: true}
  files:
    description: What it consists of here. Left out, what was told when it was put together is compared.
    type: list
    elements: dict
    suboptions:
      path: {description: Below the folder of the bundle., type: str, required: true}
      size: {description: In bytes., type: int, required: true}
      sha256: {description: Of its content., type: str, required: true}
author: ATLANTIS pilot team
"""

EXAMPLES = r"""
- name: Ask whether a bundle is on the computer
  atlantis.netcfg.bundle:
    id: 0123456789abcdef
"""

RETURN = r"""
ready: {description: Whether it is whole., type: bool, returned: success}
known: {description: Whether the computer was told what it consists of., type: bool, returned: success}
missing: {description: SHA-256 of what is missing., type: list, elements: str, returned: success}
path: {description: The folder of the bundle., type: str, returned: success}
upload: {description: Where a tar archive of what is missing goes to., type: str, returned: success}
changes: {description: One line a change., type: list, elements: str, returned: success}
"""

import contextlib
import hashlib
import json
import os
import re
import shutil
import tarfile
from dataclasses import dataclass
from typing import IO, Any, Iterator, Mapping

from ansible.module_utils.basic import AnsibleModule

from atlantis_netcfg.core.messages import arg, msg

from ..module_utils.errors import ModuleError, as_module_error

FOLDER = "/var/lib/atlantis/bundle"
_LIST = ".held.json"
_STORE = ".store"
_INCOMING = ".incoming"
_PRIVATE = "sources"
"""Folder of a bundle that only root can read, as it holds a partner's sources."""
_CHUNK = 1 << 20
_ROOM = 16 * 10**6
"""Bytes to keep free on the disk."""


@dataclass(frozen=True)
class StoredFile:
    """One file of a bundle; `path` below the bundle's folder, `size` in bytes."""

    path: str
    size: int
    sha256: str


@dataclass(frozen=True)
class BundleStatus:
    """State of a bundle: `ready` if it is complete, otherwise the `missing` content, by SHA-256."""

    ready: bool
    is_known: bool
    """Whether the file list of the bundle was given, in this call or earlier."""
    missing: tuple[str, ...]
    changes: tuple[str, ...]


class BundleStore:
    """The bundles below `folder`; uploads belong to the account with number `owner`."""

    def __init__(self, folder: str = FOLDER, owner: int | None = None) -> None:
        self.folder = folder
        self.owner = os.geteuid() if owner is None else owner
        self._store = os.path.join(folder, _STORE)
        self._incoming = os.path.join(folder, _INCOMING)

    def upload(self, name: str) -> str:
        """Return the path of the upload archive for missing files."""
        return os.path.join(self._incoming, f"{name}.tar")

    def settle(self, name: str, files: tuple[StoredFile, ...] | None, *, check: bool) -> BundleStatus:
        """Import uploaded files, and assemble the bundle once nothing is missing. Raises ModuleError.

        `files` None: the list stored when the bundle was assembled. `check`: change nothing.
        """
        with _translate_errors(self.folder):
            result = files if files is not None else self._listed_files(name)
            if result is None:
                return BundleStatus(False, False, (), ())
            if self._is_complete(name, result):
                return BundleStatus(True, True, (), () if check else tuple(self._prune(name, result)))
            if not check:
                self._prepare_folders()
                self._take_in({entry.sha256: entry for entry in result})
            missing = tuple(sorted({entry.sha256 for entry in result if not self._has(entry, check=check)}))
            if missing or check:
                self._refuse_if_full({item.sha256: item.size for item in result if item.sha256 in missing})
                return BundleStatus(False, True, missing, ())
            self._assemble_folder(name, result)
            return BundleStatus(True, True, (), (msg(f"bundle {arg(name)} assembled"), *self._prune(name, result)))

    def _listed_files(self, name: str) -> tuple[StoredFile, ...] | None:
        try:
            with open(os.path.join(self.folder, name, _LIST), "rb") as file:
                return tuple(StoredFile(**load) for load in json.loads(file.read()))
        except (FileNotFoundError, ValueError, TypeError):
            return None

    def _is_complete(self, name: str, result: tuple[StoredFile, ...]) -> bool:
        if self._listed_files(name) != result:
            return False
        return all(_has_content(os.path.join(self.folder, name, item.path), item) for item in result)

    def _prepare_folders(self) -> None:
        os.makedirs(self.folder, mode=0o755, exist_ok=True)
        for place, owner in ((self._store, os.geteuid()), (self._incoming, self.owner)):
            with contextlib.suppress(FileExistsError):
                os.mkdir(place, 0o700)
            if os.lstat(place).st_uid != owner:
                os.chown(place, owner, -1, follow_symlinks=False)

    def _take_in(self, files_by_hash: Mapping[str, StoredFile]) -> None:
        """Move uploaded files into the store, one by one; then remove the archives."""
        for entry in sorted(os.listdir(self._incoming)):
            path = os.path.join(self._incoming, entry)
            with contextlib.suppress(tarfile.TarError, EOFError), open(
                os.open(path, os.O_RDONLY | os.O_NOFOLLOW), "rb"
            ) as file, tarfile.open(fileobj=file, mode="r|") as archive:
                for member in archive:
                    item = files_by_hash.get(member.name)
                    content = archive.extractfile(member) if item is not None else None
                    if item is not None and content is not None and not self._has(item, check=False):
                        self._store_file(item, content)
            os.unlink(path)

    def _store_file(self, item: StoredFile, content: IO[bytes]) -> None:
        scratch = os.path.join(self._store, ".new")
        digest = hashlib.sha256()
        with contextlib.suppress(FileNotFoundError):
            os.unlink(scratch)
        try:
            with open(scratch, "xb") as file:
                for chunk in iter(lambda: content.read(_CHUNK), b""):
                    digest.update(chunk)
                    file.write(chunk)
                file.flush()
                os.fchmod(file.fileno(), 0o644)
                os.fsync(file.fileno())
            if digest.hexdigest() == item.sha256:
                os.replace(scratch, os.path.join(self._store, item.sha256))
        finally:
            with contextlib.suppress(FileNotFoundError):
                os.unlink(scratch)

    def _has(self, item: StoredFile, *, check: bool) -> bool:
        """Return whether the store has the content; remove a damaged copy."""
        path = os.path.join(self._store, item.sha256)
        if _has_content(path, item):
            return True
        if not check:
            with contextlib.suppress(FileNotFoundError):
                os.unlink(path)
        return False

    def _refuse_if_full(self, missing: Mapping[str, int]) -> None:
        """Raise ModuleError if disk space is short: missing files exist twice for a moment, as archive and as files."""
        place = self.folder
        while not os.path.isdir(place):
            place = os.path.dirname(place)
        needed_bytes, free = 2 * sum(missing.values()) + _ROOM, shutil.disk_usage(place).free
        if missing and free < needed_bytes:
            raise ModuleError(
                f"the bundle needs {arg(needed_bytes / 1000000.0):.0f} MB on the computer, but "
                f"{arg(free / 1000000.0):.0f} MB are free",
                "free some space, for example with `apt-get clean` and `journalctl --vacuum-size=50M`; `df -h` "
                "shows where",
            )

    def _assemble_folder(self, name: str, result: tuple[StoredFile, ...]) -> None:
        new, place = os.path.join(self.folder, f".{name}.new"), os.path.join(self.folder, name)
        shutil.rmtree(new, ignore_errors=True)
        os.mkdir(new, 0o755)
        for entry in result:
            os.makedirs(os.path.dirname(os.path.join(new, entry.path)), mode=0o755, exist_ok=True)
            os.link(os.path.join(self._store, entry.sha256), os.path.join(new, entry.path))
        if os.path.isdir(os.path.join(new, _PRIVATE)):
            os.chmod(os.path.join(new, _PRIVATE), 0o700)
        with open(os.path.join(new, _LIST), "w", encoding="utf-8") as file:
            json.dump([vars(item) for item in result], file)
        os.sync()
        shutil.rmtree(place, ignore_errors=True)
        os.rename(new, place)
        os.sync()

    def _prune(self, name: str, result: tuple[StoredFile, ...]) -> Iterator[str]:
        """Remove older bundles and content that belongs to no bundle."""
        needed_hashes = {item.sha256 for item in result}
        for entry in sorted(os.listdir(self.folder)):
            path = os.path.join(self.folder, entry)
            if entry in (name, _STORE, _INCOMING):
                continue
            shutil.rmtree(path)
            if not entry.startswith("."):
                yield msg(f"bundle {arg(entry)} removed")
        for place, stays in ((self._store, needed_hashes), (self._incoming, set())):
            for entry in os.listdir(place):
                if entry not in stays:
                    os.unlink(os.path.join(place, entry))


def _has_content(path: str, item: StoredFile) -> bool:
    """Return whether the file at a path has that content."""
    try:
        if os.lstat(path).st_size != item.size:
            return False
        digest = hashlib.sha256()
        with open(path, "rb") as file:
            for chunk in iter(lambda: file.read(_CHUNK), b""):
                digest.update(chunk)
    except (FileNotFoundError, NotADirectoryError):
        return False
    return digest.hexdigest() == item.sha256


@contextlib.contextmanager
def _translate_errors(folder: str) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise as_module_error(error, error.filename or folder) from error


ARGUMENTS: dict[str, Any] = {
    "id": {"type": "str", "required": True},
    "files": {
        "type": "list",
        "elements": "dict",
        "options": {
            "path": {"type": "str", "required": True},
            "size": {"type": "int", "required": True},
            "sha256": {"type": "str", "required": True},
        },
    },
}


def main() -> None:
    """Run the module."""
    module = AnsibleModule(argument_spec=ARGUMENTS, supports_check_mode=True)
    name, result = module.params["id"], module.params["files"]
    files = tuple(StoredFile(**entry) for entry in result) if result is not None else None
    if not re.fullmatch(r"[0-9a-f]{16}", name) or any(".." in item.path.split("/") for item in files or ()):
        module.fail_json(msg="not a bundle", hint="", changes=[])
    owner = os.environ.get("SUDO_UID", "")
    store = BundleStore(FOLDER, int(owner) if owner.isdigit() else None)
    try:
        status = store.settle(name, files, check=module.check_mode)
    except ModuleError as why:
        module.fail_json(msg=why.message, hint=why.hint, changes=[])
        return
    module.exit_json(
        changed=bool(status.changes),
        changes=list(status.changes),
        ready=status.ready,
        known=status.is_known,
        missing=list(status.missing),
        path=f"{FOLDER}/{name}",
        upload=store.upload(name),
    )


if __name__ == "__main__":
    main()
