"""Unpacked Debian roots that machines are started from: each is built once and never written to again."""

from __future__ import annotations

import fcntl
import hashlib
import json
import os
import shutil
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from atlantis_netcfg.machine._errors import MachineFailed
from atlantis_netcfg.machine._keeper import mounted, unmount
from atlantis_netcfg.machine._programs import asked
from atlantis_netcfg.paths import cache_dir

if TYPE_CHECKING:
    import subprocess
    from collections.abc import Iterator

__all__ = ["TreeSpec", "tree"]

BASE = ("systemd", "systemd-sysv", "dbus", "udev", "openssh-server", "python3", "iproute2", "sudo")
"""What every machine has: it boots, answers SSH, and Ansible finds a Python."""
_RECIPE = 1
"""Raise it when what a tree holds changes otherwise than by its packages."""
# A card that `provision image` has written lets nobody in by a password; its keys and its name are its own.
_HOOKS = (
    'rm -f "$1"/etc/ssh/ssh_host_* "$1/etc/hostname" "$1/etc/machine-id"',
    ': > "$1/etc/resolv.conf"',
    'echo "PasswordAuthentication no" > "$1/etc/ssh/sshd_config.d/atlantis.conf"',
)
_TOLD = 6
"""How many of mmdebstrap's last lines are told when it fails."""


@dataclass(frozen=True)
class TreeSpec:
    """A Debian root: what is installed beyond the base, and from where."""

    packages: tuple[str, ...] = ()
    release: str = "bookworm"
    mirror: str | None = None
    """None: mmdebstrap's own choice, http://deb.debian.org/debian with updates and security."""

    @property
    def wanted(self) -> tuple[str, ...]:
        """All packages that are asked for, in one order whatever order they were named in."""
        return tuple(sorted({*BASE, *self.packages}))

    def key(self) -> str:
        """The name of the tree in the cache: another one for whatever makes another tree."""
        told = json.dumps(asdict(self) | {"packages": self.wanted, "recipe": _RECIPE, "hooks": _HOOKS})
        return f"{self.release}-{hashlib.sha256(told.encode()).hexdigest()[:16]}"


def tree(spec: TreeSpec, cache: Path | None = None) -> Path:
    """The unpacked root, built if it is missing: 25 s for the bare one, about 300 MB; MachineFailed if that fails.

    `cache`: where trees are kept, `trees` in the user's cache if left out. Processes that want the same tree wait
    for the one that builds it; what a killed build has left is thrown away by the next one.
    """
    place = cache_dir() / "trees" if cache is None else cache
    place.mkdir(parents=True, exist_ok=True)
    made = place / spec.key()
    with _alone(place / f"{spec.key()}.lock") as lock:
        if not made.is_dir():
            _build(spec, place / f"{spec.key()}.half", made, lock)
    return made


@contextmanager
def _alone(lock: Path) -> Iterator[int]:
    with lock.open("w") as held:
        fcntl.flock(held, fcntl.LOCK_EX)
        yield held.fileno()


def _build(spec: TreeSpec, half: Path, made: Path, lock: int) -> None:
    _remove(half)
    done = _mmdebstrap(spec, half, lock)
    if done.returncode:
        said = done.stderr.strip().splitlines()[-_TOLD:]
        raise MachineFailed(
            f"no Debian {spec.release} for machines could be built: mmdebstrap ended with {done.returncode}:\n"
            + "\n".join(f"  {line}" for line in said),
            hint=f"check that this computer reaches {spec.mirror or 'http://deb.debian.org/debian'}, then try again",
        )
    os.sync()
    half.rename(made)


def _mmdebstrap(spec: TreeSpec, half: Path, lock: int) -> subprocess.CompletedProcess[str]:
    """Run it with the lock in its hands: it may outlive us, and the next builder has to wait for its end."""
    hooks = [f"--customize-hook={hook}" for hook in _HOOKS]
    mirror = [] if spec.mirror is None else [spec.mirror]
    include = f"--include={','.join(spec.wanted)}"
    kind = ("--mode=root", "--format=directory", "--variant=minbase")
    return asked(("mmdebstrap", *kind, include, *hooks, spec.release, str(half), *mirror), keep=(lock,))


def _remove(half: Path) -> None:
    """Throw away what a killed build has left; its mounts first, which lead into this computer's own /dev."""
    unmount(half)
    if any(Path(place).is_relative_to(half) for place in mounted()):
        raise MachineFailed(f"a build that was killed has left mounts: {half}", hint=f"umount --recursive {half}/*")
    if half.exists():
        shutil.rmtree(half)
