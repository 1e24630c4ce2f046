"""Unpacked Debian roots for machines: each is built once and never modified.

Each use of one removes the others if an older release of the toolkit used them last, or if they were not used for
`KEPT_DAYS` days; never one that a machine is using.
"""

from __future__ import annotations

import fcntl
import hashlib
import json
import os
import re
import shlex
import time
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from atlantis_netcfg import __version__
from atlantis_netcfg.core.paths import cache_dir
from atlantis_netcfg.emulator.lab import hosts
from atlantis_netcfg.emulator.lab.reaper import remove, unmount

if TYPE_CHECKING:
    import subprocess
    from collections.abc import Iterator

BASE = ("systemd", "systemd-sysv", "dbus", "udev", "openssh-server", "python3", "iproute2", "sudo")
"""Packages of every machine: it boots, accepts SSH, and has a Python for Ansible."""
KEPT_DAYS = 30
"""Days until an unused root file system tree is removed."""
_DAY_S = 86_400.0
_MOUNTS = Path("/proc/self/mountinfo")
_RECIPE = 1
"""Recipe version; increase it when the contents of a tree change for reasons other than its packages."""
# A card that `provision gateway image` has written lets nobody in by a password; its keys and its name are its own.
_HOOKS = (
    'rm -f "$1"/etc/ssh/ssh_host_* "$1/etc/hostname" "$1/etc/machine-id"',
    ': > "$1/etc/resolv.conf"',
    'echo "PasswordAuthentication no" > "$1/etc/ssh/sshd_config.d/atlantis.conf"',
)
# Each package of dpkg's would wait for the disk by itself; the tree is written out once, before it gets its name.
_QUICK = ("--dpkgopt=force-unsafe-io", '--customize-hook=rm -f "$1/etc/dpkg/dpkg.cfg.d/99mmdebstrap"')
_MESSAGES = 6
"""Number of last lines of mmdebstrap shown on failure, not counting its progress output."""


@dataclass(frozen=True)
class TreeSpec:
    """A Debian root: extra packages, and their sources."""

    packages: tuple[str, ...] = ()
    release: str = "bookworm"
    mirror: str | None = None
    """URL of the mirror; None: the default of mmdebstrap, http://deb.debian.org/debian with updates and security."""

    @property
    def all_packages(self) -> tuple[str, ...]:
        """All packages, sorted."""
        return tuple(sorted({*BASE, *self.packages}))

    def key(self) -> str:
        """Return the tree's name in the cache, derived from everything that determines its contents."""
        text = json.dumps(asdict(self) | {"packages": self.all_packages, "recipe": _RECIPE, "hooks": _HOOKS})
        return f"{self.release}-{hashlib.sha256(text.encode()).hexdigest()[:16]}"


def build_rootfs(spec: TreeSpec, cache: Path | None = None) -> Path:
    """Return the unpacked root, building it if missing: 25 s for the minimum, about 300 MB. Raises MachineError.

    `cache`: where trees and downloaded packages are kept; default: `trees` in the user's cache. It may be deleted while
    no machine runs. Processes that need the same tree wait for the one that builds it; leftovers of a killed build are
    removed by the next one. A proxy is taken from the environment (`http_proxy`).
    """
    place = cache_dir() / "trees" if cache is None else cache
    place.mkdir(parents=True, exist_ok=True)
    result = place / spec.key()
    with _alone(place / f"{spec.key()}.lock") as lock:
        if not result.is_dir():
            _build(spec, place / f"{spec.key()}.half", result, lock)
        _note_use(lock)
    _prune(place, keep=result)
    return result


@contextmanager
def in_use(tree: Path) -> Iterator[None]:
    """Mark a tree as used by machines, for other processes, until the block or the process ends."""
    with _lock(tree, os.O_RDONLY | os.O_DIRECTORY, fcntl.LOCK_SH):
        yield


@contextmanager
def _alone(lock: Path, *, wait: bool = True) -> Iterator[int]:
    """Lock a tree for building or removal. Raises BlockingIOError if it is locked and `wait` is False."""
    with _lock(lock, os.O_RDWR | os.O_CREAT, fcntl.LOCK_EX | (0 if wait else fcntl.LOCK_NB)) as descriptor:
        yield descriptor


@contextmanager
def _lock(path: Path, flags: int, how: int) -> Iterator[int]:
    descriptor = os.open(path, flags | os.O_CLOEXEC, 0o644)
    try:
        fcntl.flock(descriptor, how)
        yield descriptor
    finally:
        os.close(descriptor)


def _note_use(lock: int) -> None:
    """Store the release that uses the tree; the file's time is the time of use."""
    os.truncate(lock, 0)
    os.pwrite(lock, __version__.encode(), 0)


def _prune(place: Path, keep: Path) -> None:
    """Remove other trees that are no longer needed; failures are ignored."""
    for lock in sorted(place.glob("*.lock")):
        tree = lock.with_suffix("")
        if tree == keep or not (_is_outdated(lock) or lock.with_suffix(".half").exists()):
            continue
        with suppress(OSError, hosts.MachineError), _alone(lock, wait=False):
            _remove(lock.with_suffix(".half"))
            if tree.is_dir() and _is_outdated(lock) and not _is_in_use(tree):
                tree.rename(lock.with_suffix(".half"))
                _remove(lock.with_suffix(".half"))


def _is_outdated(lock: Path) -> bool:
    """Return whether a tree was last used by an older or unknown release, or too long ago."""
    unused_s = time.time() - lock.stat().st_mtime
    return (
        _version_numbers(lock.read_text(encoding="utf-8")) < _version_numbers(__version__)
        or unused_s > KEPT_DAYS * _DAY_S
    )


def _version_numbers(version: str) -> list[int]:
    return [int(number) for number in re.findall(r"\d+", version)]


def _is_in_use(tree: Path) -> bool:
    """Return whether a machine uses a tree, or a killed process left it mounted."""
    try:
        with _lock(tree, os.O_RDONLY | os.O_DIRECTORY, fcntl.LOCK_EX | fcntl.LOCK_NB):
            return f"lowerdir={tree.resolve()}," in _MOUNTS.read_text(encoding="utf-8")
    except BlockingIOError:
        return True


def _build(spec: TreeSpec, half: Path, tree: Path, lock: int) -> None:
    _remove(half)
    result = _mmdebstrap(spec, half, lock)
    if result.returncode:
        _remove(half)
        lines = [line for line in result.stderr.splitlines() if line.strip() and not line.startswith("I: ")][
            -_MESSAGES:
        ]
        raise hosts.MachineError(
            f"no Debian {spec.release} for machines could be built: mmdebstrap ended with {result.returncode}:\n"
            + "\n".join(f"  {line}" for line in lines),
            hint=f"check that this computer reaches {spec.mirror or 'http://deb.debian.org/debian'}, then try again",
        )
    hosts.program("sync", "--file-system", str(half))
    half.rename(tree)


def _mmdebstrap(spec: TreeSpec, half: Path, lock: int) -> subprocess.CompletedProcess[str]:
    """Run mmdebstrap; it inherits the locks, because it may outlive this process.

    Trees are built one after another: a build fails if another one changes the shared packages while it copies them.
    """
    hooks = [f"--customize-hook={hook}" for hook in _HOOKS]
    mirror = [] if spec.mirror is None else [spec.mirror]
    include = f"--include={','.join(spec.all_packages)}"
    kind = ("--mode=root", "--format=directory", "--variant=minbase")
    debs = half.parent / "debs"
    debs.mkdir(exist_ok=True)
    command = ("mmdebstrap", *kind, include, *_QUICK, *_kept_debs(debs), *hooks, spec.release, str(half), *mirror)
    with _lock(debs, os.O_RDONLY | os.O_DIRECTORY, fcntl.LOCK_EX) as packages:
        return hosts.output_of(command, keep=(lock, packages))


def _kept_debs(debs: Path) -> tuple[str, ...]:
    """Return mmdebstrap options that cache packages for all trees; apt fetches outdated ones again."""
    place, inside = shlex.quote(str(debs)), "/var/cache/apt/archives"
    return (
        *("--skip=download/empty", "--skip=essential/unlink"),
        *(f'--setup-hook=mkdir -p "$1"{inside}', f"--setup-hook=sync-in {place} {inside}"),
        f"--customize-hook=sync-out {inside} {place}",
    )


def _remove(half: Path) -> None:
    """Remove a killed build; first its mounts, which include this computer's /proc and /sys."""
    unmount(half)
    remove(half)
    if half.exists():
        raise hosts.MachineError(
            f"what a build that was killed has left cannot be removed: {half}", hint="restart the computer"
        )
