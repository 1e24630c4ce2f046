"""Paths: the shipped files, the cache, and the state that outlives a run (journals, backups, certificates, logs)."""

from __future__ import annotations

import os
import pwd
import stat
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

from atlantis_netcfg.core.atomic_files import write_atomically
from atlantis_netcfg.core.errors import UsageError
from atlantis_netcfg.core.messages import arg, msg

if TYPE_CHECKING:
    from collections.abc import Mapping

_HINT = "use your own directory: ATLANTIS_STATE=/some/directory provision …"
_CACHE_HINT = "use your own directory: XDG_CACHE_HOME=/some/directory provision …"


INVOCATION = "ATLANTIS_INVOCATION"
"""Environment variable with the id of the command that a person has typed, for the runs that it starts."""
COMMANDS = "commands"
"""Folder with a file for each command that had runs: its exit code, or empty if it is active or was killed."""


_PACKAGE = Path(__file__).resolve().parents[1]
_SHARE = _PACKAGE / "share"
"""Copy of the shipped files in an installed package (setup.py); a checkout has none."""


def checkout() -> Path:
    """Return the folder of this package: the checkout, or `site-packages` where it is installed."""
    return _PACKAGE.parent


def is_installed() -> bool:
    """Return whether this package was installed from a wheel, without a checkout."""
    return _SHARE.is_dir()


def resource(name: str) -> Path:
    """Return a shipped folder or file: `ansible.cfg`, `inventory`, `playbooks`, `roles` or `templates`."""
    return (_SHARE if is_installed() else checkout()) / name


def collections() -> Path:
    """Return the folder that Ansible's collections_path names: it holds `ansible_collections`."""
    return _PACKAGE


def inventory_folder(name: str | None) -> Path:
    """Return the inventory named on the command line; without a name, the checkout's own.

    An installed program takes `inventory` in the current folder: commands write to inventories.
    """
    if name:
        return Path(name)
    return Path.cwd() / "inventory" if is_installed() else resource("inventory")


def state_dir(environ: Mapping[str, str] | None = None) -> Path:
    """Return the state directory, creating it with mode 0700. Raises UsageError if that is impossible.

    `$ATLANTIS_STATE`, else `atlantis` under `$XDG_STATE_HOME` (absolute paths only, as the XDG Base Directory
    Specification has it), else under `~/.local/state`.
    """
    return private_directory(state_place(environ))


def state_place(environ: Mapping[str, str] | None = None) -> Path:
    """Return the path of the state directory without creating it. Raises UsageError if there is none."""
    return _state_path(os.environ if environ is None else environ)


def start_command() -> bool:
    """Give the command that starts an id, which its runs record; False within a command that has one."""
    is_outer = INVOCATION not in os.environ
    os.environ.setdefault(INVOCATION, os.urandom(8).hex())
    return is_outer


def finish_command(code: int) -> None:
    """Write the exit code of the command into the files of its runs; if that fails, they show no result for it."""
    invocation = os.environ.pop(INVOCATION)
    with suppress(OSError, UsageError):
        for place in state_place().glob(f"*/{COMMANDS}/{invocation}"):
            write_atomically(place, str(code).encode())


def cache_dir(environ: Mapping[str, str] | None = None) -> Path:
    """Return the cache directory, creating it if missing. Raises UsageError if that is impossible.

    `atlantis` under `$XDG_CACHE_HOME` (absolute paths only), else under `~/.cache`.
    """
    place = cache_place(environ)
    try:
        place.mkdir(mode=0o700, parents=True, exist_ok=True)
    except OSError as error:
        raise UsageError(
            f"cannot store the cache: {arg(place.parent)}: {arg(error.strerror)}", hint=_CACHE_HINT
        ) from error
    return place


def cache_place(environ: Mapping[str, str] | None = None) -> Path:
    """Return the path of the cache without creating it. Raises UsageError if there is none."""
    environment = os.environ if environ is None else environ
    cache_home = Path(environment.get("XDG_CACHE_HOME", ""))
    home = cache_home if cache_home.is_absolute() else _home(environment, "the cache", _CACHE_HINT) / ".cache"
    return home / "atlantis"


def private_cache(name: str) -> Path | None:
    """Return a cache folder that only this user can write to, for code that is executed from it.

    None if there is no such folder (a foreign HOME under `sudo`, a full disk): then nothing is cached.
    """
    try:
        folder = cache_dir() / name
        folder.mkdir(mode=0o700, exist_ok=True)
        place_stats = [place.lstat() for place in (folder.parent, folder)]
    except (OSError, UsageError):
        return None
    ours = all(
        stat.S_ISDIR(place.st_mode) and place.st_uid == os.geteuid() and not place.st_mode & 0o022
        for place in place_stats
    )
    return folder if ours else None


def shorten_home(path: Path) -> str:
    """Shorten a path below the home directory to `~/…`."""
    home = os.environ.get("HOME")
    return f"~/{path.relative_to(home)}" if home and path.is_relative_to(home) else str(path)


def private_directory(path: Path) -> Path:
    """Create a directory readable only by its owner, or correct the mode of an existing one."""
    try:
        path.mkdir(mode=0o700, parents=True, exist_ok=True)
        require_own(path, _HINT)
        if path.stat().st_mode & 0o077:
            path.chmod(0o700)
    except OSError as error:
        raise UsageError(f"cannot store the journal: {arg(path)}: {arg(error.strerror)}", hint=_HINT) from error
    if not os.access(path, os.W_OK | os.X_OK):
        raise UsageError(f"cannot store the journal: {arg(path)} is not writable by {arg(_user())}", hint=_HINT)
    return path


def write_private(path: Path, data: bytes) -> None:
    """Write a reproducible file atomically, creating its folder if needed."""
    path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
    write_atomically(path, data, durable=False)


def require_own(folder: Path, hint: str) -> None:
    """Raise UsageError if a folder, or the link to it, belongs to another user; OSError if it cannot be read.

    Its owner could exchange the contents: pins, journals, the signing key. A link may also belong to root.
    """
    me = os.geteuid()
    for owner, allowed_owners in ((folder.lstat().st_uid, (me, 0)), (folder.stat().st_uid, (me,))):
        if owner not in allowed_owners:
            raise UsageError(
                f"{arg(folder)} belongs to {arg(_name(owner))}, who could change its contents, not to {arg(_user())}",
                hint=hint,
            )


def _state_path(environ: Mapping[str, str]) -> Path:
    """Return the path of the state directory. Raises UsageError if there is none."""
    if local := environ.get("ATLANTIS_STATE"):
        return Path(local).absolute()
    state_home = environ.get("XDG_STATE_HOME", "")
    if Path(state_home).is_absolute():
        return Path(state_home) / "atlantis"
    return _home(environ, "the journal", _HINT) / ".local" / "state" / "atlantis"


def _home(environ: Mapping[str, str], what: str, hint: str) -> Path:
    home = environ.get("HOME") or _home_on_record()
    if not home or not Path(home).is_dir():
        missing = msg(f"the home directory {arg(home)} does not exist" if home else "no home directory found")
        raise UsageError(f"cannot store {arg(what)}: {arg(missing)}", hint=hint)
    return Path(home)


def _home_on_record() -> str:
    try:
        return pwd.getpwuid(os.geteuid()).pw_dir
    except KeyError:
        return ""


def _user() -> str:
    return _name(os.geteuid())


def _name(user: int) -> str:
    try:
        return pwd.getpwuid(user).pw_name
    except KeyError:
        return msg(f"user {arg(user)}")
