"""atlantis: what a gateway may do here by its key, and nothing else: lay recordings down in its own folders.

Takes NAMES FOLDER BUDGET_MB; sshd starts it in place of whatever the gateway has asked for (SSH_ORIGINAL_COMMAND). The
names are those of the gateway and of the robots whose recordings it sends, with commas; the request ends with one.

- `rsync --server … . NAME`: write into FOLDER/.incoming/NAME; the options are held against a list, the place is ours.
- `atlantis have NAME`: rows of path, size, SHA-256 on the standard input; answers for each `kept` (read again, the
  same), `differs`, `partial` or `missing`, and how much room is left.
- `atlantis keep NAME`: the same rows; what has arrived is read again, and gets its name in FOLDER/NAME if it is the
  same.
"""

# ruff: noqa: INP001, PTH105, PTH106, PTH118, S603 - a program of the control centre, which starts rsync

import contextlib
import fcntl
import hashlib
import json
import os
import re
import resource
import shlex
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

SHORT = re.compile(r"-[vtRIc]*(e[0-9]*\.[A-Za-z]*)?")
LONG = re.compile(r"--(timeout=[0-9]{1,5}|append|inplace|log-format=[%A-Za-z]*)")
END_S = 10
LOOK_S = 0.2
"""How often the folder is measured while rsync writes: what one file may add is limited by the kernel."""
ROWS_BYTES = 64_000_000


class Receiver:
    """The folders of one gateway, or of one robot."""

    def __init__(self, name: str, folder: Path, budget: int) -> None:
        self.folder, self.budget = folder, budget
        self.kept, self.incoming = folder / name, folder / ".incoming" / name
        for place in (self.kept, self.incoming):
            place.mkdir(mode=0o750, parents=True, exist_ok=True)

    def room(self) -> int:
        """Bytes that may still be written: of the budget, and of the disk."""
        disk = os.statvfs(str(self.folder))
        return max(0, min(self.budget - self.used(), disk.f_bavail * disk.f_frsize))

    def used(self) -> int:
        """Bytes in all folders of the gateway."""
        used = 0
        for place, _, files in os.walk(str(self.folder)):
            for name in files:
                with contextlib.suppress(OSError):
                    used += os.lstat(os.path.join(place, name)).st_size
        return used

    def write(self, command: "list[str]") -> int:
        """Let rsync write here, and end it once the budget is used up; its code."""
        largest = max((file.stat().st_size for file in self.incoming.rglob("*") if file.is_file()), default=0)
        most = max(0, self.budget - self.used()) + largest
        resource.setrlimit(resource.RLIMIT_FSIZE, (most, most))  # of rsync, and of nothing that this program writes
        with subprocess.Popen(command, cwd=str(self.incoming)) as program:
            while self.used() <= self.budget:
                with contextlib.suppress(subprocess.TimeoutExpired):
                    code = program.wait(LOOK_S)
                    return self.full() if code == -signal.SIGXFSZ else abs(code)
            signal.signal(signal.SIGTERM, signal.SIG_IGN)
            os.killpg(os.getpgid(0), signal.SIGTERM)  # rsync, and the one that it has started
        return self.full()

    def full(self) -> int:
        """Say that nothing more is taken."""
        sys.stderr.write(f"atlantis: the budget of {self.budget // 1000000} MB is used up\n")
        return 3

    def have(self, rows: "list") -> "dict":
        """Say what is here; of a file that differs a copy is made to be mended."""
        return {"answers": [self._have(*row) for row in rows], "room": self.room()}

    def _have(self, path: str, size: int, sha256: str) -> str:
        kept, coming = self.kept / inside(path), self.incoming / inside(path)
        if kept.is_file():
            if same(kept, size, sha256):
                return "kept"
            if not coming.exists():
                if kept.stat().st_size > self.room():
                    msg = f"no room to mend {path}"
                    raise OSError(msg)
                coming.parent.mkdir(mode=0o750, parents=True, exist_ok=True)
                shutil.copyfile(str(kept), str(coming))
            return "differs"
        if not coming.is_file():
            return "missing"
        if coming.stat().st_size < size:
            return "partial"
        return "partial" if same(coming, size, sha256) else "differs"

    def keep(self, rows: "list") -> "dict":
        """Read again what has arrived; what is right gets its name."""
        answers = [self._keep(*row) for row in rows]
        for place, _, _ in os.walk(str(self.incoming), topdown=False):
            if place != str(self.incoming):
                with contextlib.suppress(OSError):
                    os.rmdir(place)
        return {"answers": answers, "room": self.room()}

    def _keep(self, path: str, size: int, sha256: str) -> str:
        kept, coming = self.kept / inside(path), self.incoming / inside(path)
        if not coming.is_file():
            return "kept" if kept.is_file() and same(kept, size, sha256) else "missing"
        if not same(coming, size, sha256):
            return "differs"
        with coming.open("rb") as file:
            os.fsync(file.fileno())
        kept.parent.mkdir(mode=0o750, parents=True, exist_ok=True)
        os.replace(str(coming), str(kept))
        descriptor = os.open(str(kept.parent), os.O_RDONLY)
        os.fsync(descriptor)
        os.close(descriptor)
        return "kept"

    def alone(self) -> None:
        """End whoever still writes here: a connection that has died here is not noticed for minutes."""
        lock = os.open(str(self.incoming) + ".lock", os.O_RDWR | os.O_CREAT, 0o600)
        os.set_inheritable(lock, True)
        ends = time.monotonic() + END_S
        while True:
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
                break
            except BlockingIOError:
                holder = os.pread(lock, 20, 0).decode() or "0"
                with contextlib.suppress(ProcessLookupError, PermissionError):
                    if int(holder) > 1:
                        os.killpg(int(holder), signal.SIGTERM if time.monotonic() < ends else signal.SIGKILL)
                time.sleep(0.1)
        with contextlib.suppress(PermissionError):
            os.setpgid(0, 0)
        os.ftruncate(lock, 0)
        os.pwrite(lock, str(os.getpgid(0)).encode(), 0)


def asked() -> "list":
    """The rows that the gateway asks about. Raises ValueError."""
    rows = sys.stdin.read(ROWS_BYTES + 1)
    if len(rows) > ROWS_BYTES:
        msg = f"asked about files in more than {ROWS_BYTES} bytes"
        raise ValueError(msg)
    return json.loads(rows)


def inside(path: str) -> str:
    """A path that stays in its folder. Raises ValueError."""
    parts = path.split("/")
    if not path or not path.isprintable() or any(part in ("", ".", "..") for part in parts):
        msg = f"no path of a recording: {path!r}"
        raise ValueError(msg)
    return path


def same(path: Path, size: int, sha256: str) -> bool:
    """Whether a file is this one; it is read for that."""
    if path.stat().st_size != size:
        return False
    found = hashlib.sha256()
    with path.open("rb") as file:
        for block in iter(lambda: file.read(1 << 20), b""):
            found.update(block)
    return found.hexdigest() == sha256


def server(words: "list[str]") -> "list[str]":
    """The command of rsync that is run: it may only write, and only here. Raises ValueError."""
    if words[:2] != ["rsync", "--server"] or words[2:][-2:] != [".", "."]:
        msg = "not admitted: {}".format(" ".join(words))
        raise ValueError(msg)
    for word in words[2:-2]:
        if not (LONG if word.startswith("--") else SHORT).fullmatch(word):
            msg = f"option not admitted: {word}"
            raise ValueError(msg)
    return words


def main(names: str, folder: str, budget_mb: str) -> int:
    """Do the one thing that was asked for, if it is among those above."""
    os.umask(0o027)
    words = shlex.split(os.environ.get("SSH_ORIGINAL_COMMAND", ""))
    name = words[-1] if words else ""
    if name not in names.split(","):
        sys.stderr.write("atlantis: not admitted: {}\n".format(" ".join(words)))
        return 3
    receiver = Receiver(inside(name), Path(folder), int(budget_mb) * 1000000)
    receiver.alone()
    try:
        if words[:-1] in (["atlantis", "have"], ["atlantis", "keep"]):
            answer = getattr(receiver, words[1])(asked())
            sys.stdout.write(json.dumps(answer) + "\n")
            return 0
        return receiver.write(server([*words[:-1], "."]))
    except (ValueError, TypeError, OSError) as error:
        sys.stderr.write(f"atlantis: {error}\n")
        return 3


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:4]))
