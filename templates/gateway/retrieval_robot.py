"""atlantis: collects the recordings of a robot on this gateway, by rsync over SSH in the LAN; `retrieval.py` uses it.

The owner of the robot admits the gateway's key to one folder, to read it and nothing else (`rrsync -ro`). A file gets
its name here after the robot has read it again, and rsync has found the same checksum at both ends. Nothing is changed
or removed on the robot; what is here of a file stays when the robot goes, and is not fetched again.
"""

# ruff: noqa: INP001, PTH100, PTH103, PTH105, PTH108, PTH118, PTH120, S603 - a program of the gateway; its paths are text

import calendar
import contextlib
import os
import re
import selectors
import signal
import stat
import subprocess
import tempfile
import time
from pathlib import Path

ROOT = os.path.normpath(os.path.join(os.path.dirname(os.path.abspath(__file__)), "../../../.."))
"""Of the tree in which this was laid down; a rehearsal has one of its own."""
KNOWN_HOSTS = os.path.join(ROOT, "etc/atlantis/retrieval.known_hosts")
LINK_LOST = frozenset({10, 12, 20, 30, 35, 255})
"""Of rsync(1) and ssh(1): socket, protocol stream, signal, timeouts, ssh itself."""
SOME_LEFT = frozenset({23, 24})
"""Of rsync(1): some files were not sent, or have gone."""
SILENCE_S = 30
OUTPUT_BYTES = 16_000_000
"""So much a program may print: a list of 100,000 files."""
ERRORS_BYTES = 65536
"""So much of its errors is kept."""
LIST_S = 600
LEAST_BPS = 50_000
"""Bytes a second; who sends less in the LAN of a site holds up all others, and is left out."""
RESERVE = 500_000_000
"""Bytes of this disk that recordings of robots leave to all else."""
BATCH_FILES, BATCH_BYTES = 50, 250_000_000
"""After so much the checksums are compared, and files get their names."""
ROW = re.compile(r"(.)\S{9,10} +([0-9]+) ([0-9/]{10} [0-9:]{8}) (.*)")
"""Of `rsync --list-only`: mode, size, time of the last change, path."""
ESCAPED = re.compile(r"\\#[0-7]{3}")
"""In a path that rsync prints: a sign that no printable name has."""
PERMANENT = {
    "opendir ": ("unread", "does not let its account read all of the folder"),
    "Permission denied": ("key", "does not admit the SSH host key of this gateway"),
    "Host key verification failed": ("host_key", "has not its declared SSH host key"),
    "IDENTIFICATION HAS CHANGED": ("host_key", "has not its declared SSH host key"),
    "host key is known": ("host_key", "has not its declared SSH host key"),
    "rrsync: ": ("program", "has no rrsync, or no such folder"),
    "rrsync error": ("program", "has no rrsync, or no such folder"),
    "rsync: command not found": ("program", "has no rsync"),
    "No space left on device": ("disk", "is not asked for more: the disk of this gateway is full"),
}
"""What ssh or rsync says where no second try helps: what is at fault, and what the robot does."""


class Away(Exception):
    """The other end was not reached, or no more: what has arrived stays, and is not sent again."""


class Refused(Exception):
    """What no second try would change."""

    kind = ""


def ssh_words(alias: str, key: str, user: str, **more: str) -> "list[str]":
    """Program and options of ssh, without the host; whoever answers has the declared host key."""
    options = {
        "BatchMode": "yes",
        "IdentitiesOnly": "yes",
        "IdentityAgent": "none",
        "StrictHostKeyChecking": "yes",
        "UserKnownHostsFile": KNOWN_HOSTS,
        "GlobalKnownHostsFile": "/dev/null",
        "HostKeyAlias": alias,
        "UpdateHostKeys": "no",
        **more,
    }
    words = [word for name, value in options.items() for word in ("-o", f"{name}={value}")]
    return ["ssh", "-F", "none", "-T", "-i", key, "-l", user, *words]


def quoted(words: "list[str]") -> str:
    """For `rsync -e`."""
    return " ".join(f"'{word}'" if " " in word else word for word in words)


class TooMuch(Exception):
    """A program printed more, or took longer, than it may; it was ended."""


def bounded(
    words: "list[str]", data: bytes = b"", within_s: "float | None" = None, **more: "object"
) -> "tuple[int, bytes, bytes]":
    """Run a program; give its code, its output, and the first of its errors. Raises TooMuch."""
    pipe = subprocess.PIPE
    with tempfile.TemporaryFile() as asked:
        asked.write(data)
        asked.seek(0)
        with subprocess.Popen(words, stdin=asked, stdout=pipe, stderr=pipe, start_new_session=True, **more) as program:
            try:
                out, errors = _printed(program, within_s)
            except BaseException:
                with contextlib.suppress(ProcessLookupError):
                    os.killpg(program.pid, signal.SIGKILL)
                raise
    return program.returncode, bytes(out), bytes(errors[:ERRORS_BYTES])


def _printed(program: "subprocess.Popen[bytes]", within_s: "float | None") -> "list[bytearray]":
    """Output and errors of a program until it closes both. Raises TooMuch."""
    ends = None if within_s is None else time.monotonic() + within_s
    kept = [bytearray(), bytearray()]
    with selectors.DefaultSelector() as waiting:
        for number, pipe in enumerate((program.stdout, program.stderr)):
            waiting.register(pipe, selectors.EVENT_READ, number)
        while waiting.get_map():
            left = None if ends is None else ends - time.monotonic()
            if left is not None and left <= 0:
                raise TooMuch(f"has not ended within {within_s:.0f} s")
            for key, _ in waiting.select(left):
                chunk = os.read(key.fd, 65536)
                if not chunk:
                    waiting.unregister(key.fileobj)
                kept[key.data] += chunk
                if len(kept[key.data]) > OUTPUT_BYTES:
                    raise TooMuch(f"tells more than {OUTPUT_BYTES // 1_000_000} MB")
    return kept


def regular(folder: str) -> "list[tuple[str, os.stat_result]]":
    """Regular files below a folder, by their paths in it; links are not followed."""
    found = []
    for place, folders, files in os.walk(folder):
        folders.sort()
        for name in sorted(files):
            path = os.path.join(place, name)
            with contextlib.suppress(OSError):
                state = os.lstat(path)
                if stat.S_ISREG(state.st_mode):
                    found.append((os.path.relpath(path, folder), state))
    return found


class Robot:
    """A folder on a robot, and what is here of it: whole files in `folder`, others in `partial`."""

    def __init__(self, settings: "dict", silence_s: int = SILENCE_S) -> None:
        self.name, self.folder, self.budget = settings["source"], settings["folder"], settings["budget"]
        self.partial = os.path.join(os.path.dirname(self.folder), ".partial", self.name)
        shell = ssh_words(
            self.name,
            settings["key"],
            settings["robot_user"],
            Port=str(settings["robot_port"]),
            ConnectTimeout=str(max(2, silence_s // 3)),
            ServerAliveInterval=str(max(1, silence_s // 3)),
            ServerAliveCountMax="3",
        )
        self._words = ["rsync", "--times", "--no-human-readable", "--8-bit-output", "--timeout", str(max(2, silence_s))]
        self._words += ["-e", quoted(shell)]
        self._remote = settings["robot_address"] + ":."
        for place in (self.folder, self.partial):
            os.makedirs(place, mode=0o700, exist_ok=True)

    def list(self) -> "list":
        """Rows of path, size and time of the last change of all files there. Raises Away, Refused."""
        words = ("--recursive", "--list-only", "--exclude=/lost+found", self._remote)
        text, _ = self._rsync(*words, partly=False)
        rows = []
        for line in text.split("\n"):
            found = ROW.fullmatch(line)
            if found is None or found[1] != "-":
                continue
            if {"", ".", ".."} & set(found[4].split("/")):
                # Its computer is not ours: by such a path this gateway's own files would be moved.
                raise Refused(f"{self.name} names a file outside of its folder: {found[4]!r}")
            path = found[4] if ESCAPED.search(found[4]) is None else "\udcff" + found[4]
            when = calendar.timegm(time.strptime(found[3], "%Y/%m/%d %H:%M:%S"))
            rows.append([path, int(found[2]), when * 1_000_000_000])
        return rows

    def here(self, row: "list") -> bool:
        """Whether a file of there is here, whole."""
        with contextlib.suppress(OSError):
            state = os.lstat(os.path.join(self.folder, row[0]))
            return [state.st_size, state.st_mtime_ns] == row[1:3]
        return False

    def begun(self) -> int:
        """Bytes of files that are not whole yet."""
        return sum(state.st_size for _, state in regular(self.partial))

    def lacking(self, rows: "list") -> int:
        """Bytes that are missing here for these files of there: of the budget, or of the disk."""
        due = {row[0]: row[1] for row in rows if not self.here(row)}
        begun = {path: state.st_size for path, state in regular(self.partial)}
        new = sum(max(0, size - begun.get(path, 0)) for path, size in due.items())
        used = sum(begun.values()) + sum(state.st_size for path, state in regular(self.folder) if path not in due)
        disk = os.statvfs(self.folder)
        return max(0, used + new - self.budget, new - max(0, disk.f_bavail * disk.f_frsize - RESERVE))

    def forget(self, paths: "set[str]") -> None:
        """Remove what was begun of files that are on the robot no more."""
        for path, _ in regular(self.partial):
            if path not in paths:
                os.unlink(os.path.join(self.partial, path))

    def collect(self, rows: "list") -> "dict":
        """Bring some files here; give the paths of those that were not, by the reason. Raises Away, Refused."""
        left = {"changed": [], "unread": [], "differ": []}
        due = [row for row in rows if not self.here(row)]
        self._fetch(due, "--append-verify")
        differing = self._differing(due)
        if differing:
            self._fetch([row for row in due if row[0] in differing], "--ignore-times")
            differing = self._differing(due)
        for row in due:
            place = os.path.join(self.partial, row[0])
            try:
                state = os.lstat(place)
            except OSError:
                left["unread"].append(row[0])
                continue
            if [state.st_size, int(state.st_mtime)] != [row[1], row[2] // 1_000_000_000]:
                left["changed"].append(row[0])
            elif row[0] in differing:
                left["differ"].append(row[0])
            else:
                self._name(row)
        return left

    def _fetch(self, rows: "list", how: str) -> None:
        self._rsync("--inplace", how, *self._listed(), self._remote, self.partial, rows=rows)

    def _differing(self, rows: "list") -> "set[str]":
        """Which of them are not the same there: both ends read them for that."""
        rows = [row for row in rows if os.path.lexists(os.path.join(self.partial, row[0]))]
        words = ("--checksum", "--dry-run", "--out-format=%n", *self._listed(), self._remote, self.partial)
        text, code = self._rsync(*words, rows=rows)
        # What could not be read there was not compared.
        return set(filter(None, text.split("\n"))) if code == 0 else {row[0] for row in rows}

    def _listed(self) -> "tuple[str, ...]":
        return ("--no-implied-dirs", "--from0", "--files-from=-")

    def _name(self, row: "list") -> None:
        """Let a file that was compared have its name; its time is what the list says, in whole seconds."""
        place, whole = Path(self.partial, row[0]), Path(self.folder, row[0])
        with place.open("rb") as file:
            os.fsync(file.fileno())
        os.utime(str(place), ns=(row[2], row[2]))
        whole.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        os.replace(str(place), str(whole))

    def _rsync(self, *words: str, rows: "list | None" = None, partly: bool = True) -> "tuple[str, int]":
        """Text and code of one rsync. Raises Away, Refused."""
        data = b"".join(row[0].encode() + b"\0" for row in rows or ())
        if rows is not None and not data:
            return "", 0
        clock = dict(os.environ, TZ="UTC", LC_ALL="C")
        within_s = LIST_S + sum(row[1] for row in rows or ()) / LEAST_BPS
        try:
            code, out, errors = bounded([*self._words, *words], data, within_s, env=clock)
        except TooMuch as error:
            raise Refused(f"{self.name} {error}, and is left out") from None
        if code and not (partly and code in SOME_LEFT):
            raise meaning(self.name, code, errors)
        return out.decode("utf-8", "surrogateescape"), code


def meaning(name: str, code: int, data: bytes) -> Exception:
    """What the end of an rsync from a robot means, with the first that it has said."""
    text = data.decode(errors="replace").strip()
    for words, (kind, does) in PERMANENT.items():
        if words in text:
            line = next(line for line in text.splitlines() if words in line)
            error = Refused(f"{name} {does} ({line.strip()})")
            error.kind = kind
            return error
    first = text.splitlines()[0] if text else f"a program ended with {code}"
    return Away(f"{name} does not answer: {first}") if code in LINK_LOST else Refused(f"{name}: {first}")


def batches(rows: "list") -> "list[list]":
    """As many as are compared at once."""
    made, size = [], 0
    for row in rows:
        if not made or (len(made[-1]) == BATCH_FILES or size + row[1] > BATCH_BYTES):
            made.append([])
            size = 0
        made[-1].append(row)
        size += row[1]
    return made
