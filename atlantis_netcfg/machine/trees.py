"""Unpacked Debian roots that machines are started from: each is built once and never written to again."""

from __future__ import annotations

import fcntl
import hashlib
import json
import shlex
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING

from atlantis_netcfg.machine._errors import MachineFailed
from atlantis_netcfg.machine._keeper import remove, unmount
from atlantis_netcfg.machine._programs import asked, program
from atlantis_netcfg.paths import cache_dir

if TYPE_CHECKING:
    import subprocess
    from collections.abc import Iterator
    from pathlib import Path

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
# Each package of dpkg's would wait for the disk by itself; the tree is written out once, before it gets its name.
_QUICK = ("--dpkgopt=force-unsafe-io", '--customize-hook=rm -f "$1/etc/dpkg/dpkg.cfg.d/99mmdebstrap"')
_TOLD = 6
"""How many of mmdebstrap's last lines are told when it fails; those of its own progress are not."""


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

    `cache`: where trees are kept, and the packages that they were made from; `trees` in the user's cache if left out.
    All of it may be deleted while no machine runs. Processes that want the same tree wait for the one that builds it;
    what a killed build has left is thrown away by the next one. A proxy is taken from the environment (`http_proxy`).
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
        _remove(half)
        said = [line for line in done.stderr.splitlines() if line.strip() and not line.startswith("I: ")][-_TOLD:]
        raise MachineFailed(
            f"no Debian {spec.release} for machines could be built: mmdebstrap ended with {done.returncode}:\n"
            + "\n".join(f"  {line}" for line in said),
            hint=f"check that this computer reaches {spec.mirror or 'http://deb.debian.org/debian'}, then try again",
        )
    program("sync", "--file-system", str(half))
    half.rename(made)


def _mmdebstrap(spec: TreeSpec, half: Path, lock: int) -> subprocess.CompletedProcess[str]:
    """Run it with the lock in its hands: it may outlive us, and the next builder has to wait for its end."""
    hooks = [f"--customize-hook={hook}" for hook in _HOOKS]
    mirror = [] if spec.mirror is None else [spec.mirror]
    include = f"--include={','.join(spec.wanted)}"
    kind = ("--mode=root", "--format=directory", "--variant=minbase")
    debs = _kept_debs(half.parent / "debs")
    return asked(("mmdebstrap", *kind, include, *_QUICK, *debs, *hooks, spec.release, str(half), *mirror), keep=(lock,))


def _kept_debs(debs: Path) -> tuple[str, ...]:
    """How mmdebstrap is told to fetch a package once for all trees; apt fetches again what does not fit its list."""
    debs.mkdir(exist_ok=True)
    place, inside = shlex.quote(str(debs)), "/var/cache/apt/archives"
    return (
        *("--skip=download/empty", "--skip=essential/unlink"),
        *(f'--setup-hook=mkdir -p "$1"{inside}', f"--setup-hook=sync-in {place} {inside}"),
        f"--customize-hook=sync-out {inside} {place}",
    )


def _remove(half: Path) -> None:
    """Throw away what a killed build has left; its mounts first, which show this computer's own /proc and /sys."""
    unmount(half)
    remove(half)
    if half.exists():
        raise MachineFailed(
            f"what a build that was killed has left cannot be removed: {half}", hint="restart the computer"
        )
