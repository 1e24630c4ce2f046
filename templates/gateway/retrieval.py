"""atlantis: sends the recordings of this gateway to the control centre; nothing here is ever changed or removed.

`look`, `start`, `status` and `stop` are asked by the toolkit: JSON on the standard input, JSON on the standard output.
`run` is the unit: it sends what the job lists by rsync over SSH, goes on where it was whenever the link is back, and
ends when the control centre has read every file again and found the same SHA-256. `connect` is the way of its ssh to
the control centre: it keeps to the rate, counts every byte, and ends at the job's cap.
"""

# ruff: noqa: INP001, PTH100, PTH112, PTH118, PTH123, S603, S607 - a program of the gateway; its paths are text

import contextlib
import fcntl
import fnmatch
import hashlib
import json
import os
import signal
import socket
import stat
import struct
import subprocess
import sys
import threading
import time
from pathlib import Path

SETTINGS = Path("/etc/atlantis/retrieval.json")
KNOWN_HOSTS = "/etc/atlantis/retrieval.known_hosts"
STATE = Path("/var/lib/atlantis/retrieval")
JOB, STATUS, COUNTS, KEPT, HASHES, LOCK = (
    STATE / name for name in ("job.json", "status.json", "counts.json", "kept.json", "hashes.json", "lock")
)
UNIT = "atlantis-retrieval.service"
QUIET_S = 60
"""A file that was written to later than this is still being written."""
WIRE = 1.2
"""Bytes on the link for each byte of the connection: headers of TCP, IP and the VPN, acknowledgements, some losses."""
PAUSES_S = (5, 10, 20, 30)
ROUNDS = 3
"""How often a file that arrived otherwise is sent again."""
LINK_LOST = frozenset({10, 12, 20, 30, 35, 255})
"""Of rsync(1) and ssh(1): socket, protocol stream, signal, timeouts, ssh itself."""
SOME_LEFT = frozenset({23, 24})
"""Of rsync(1): some files were not sent, or have gone; what arrived is read again all the same."""
_OTHER_KEY = "whoever answers for the control centre has not its declared SSH host key, so nothing was sent"
PERMANENT = {
    "Permission denied": "the control centre does not admit this gateway: another key, or another address in the VPN",
    "Host key verification failed": _OTHER_KEY,
    "IDENTIFICATION HAS CHANGED": _OTHER_KEY,
    "host key is known": _OTHER_KEY,
    "No space left on device": "the disk of the control centre is full",
    "atlantis: ": "the control centre refuses it",
}
"""What ssh, or the other end, says where no second try helps, and what it means."""
SPENT = 75
NOTED_S = 0.25
"""How often what was sent is noted; a power cut may cost the count of some seconds."""
SLOW_S = 10
RTT_AT = 68
"""In `struct tcp_info` of Linux (tcp.h): `tcpi_rtt`, in microseconds."""


class Away(Exception):
    """The control centre was not reached, or no more: what has arrived stays, and is not sent again."""


class Refused(Exception):
    """What no second try would change."""


def read(path: Path, default: "object" = None) -> "object":
    """JSON of a file; what is missing or torn is the default."""
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return default


def write(path: Path, value: "object", *, sync: bool = True) -> None:
    """Write JSON, whole or not at all."""
    beside = path.with_suffix(".new")
    with beside.open("w", encoding="utf-8") as file:
        json.dump(value, file)
        file.flush()
        if sync:
            os.fsync(file.fileno())
    beside.rename(path)


def note(**values: "object") -> None:
    """Change what `status` tells."""
    now = read(STATUS, {})
    now.update(values, at=time.time())
    write(STATUS, now)


def names(folder: str) -> "list[tuple[str, os.stat_result]]":
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


def listed(settings: "dict", request: "dict") -> "dict":
    """What would be sent: files that match, are written to no more, and are not at the control centre yet."""
    kept, rows, writing, before = read(KEPT, {}), [], 0, request["before"]
    already = unnamed = 0
    for path, state in names(settings["folder"]):
        if not fnmatch.fnmatchcase(path, request["pattern"]):
            continue
        try:
            path.encode("utf-8")
        except UnicodeEncodeError:
            unnamed += 1
            continue
        if not path.isprintable():
            unnamed += 1
        elif state.st_mtime > before - QUIET_S:
            writing += 1
        elif not request["again"] and kept.get(path, [])[:2] == [state.st_size, state.st_mtime_ns]:
            already += 1
        else:
            rows.append([path, state.st_size, state.st_mtime_ns])
    known = [path in kept and kept[path][:2] == [size, when] for path, size, when in rows]
    return {
        "rows": rows,
        "files": len(rows),
        "bytes": sum(row[1] for row, there in zip(rows, known) if not there),
        "compared": sum(known),
        "kept": already,
        "writing": writing,
        "unnamed": unnamed,
    }


def look(settings: "dict", request: "dict") -> "dict":
    """Say what would be sent; nothing is contacted."""
    request.setdefault("before", time.time())
    found = listed(settings, request)
    del found["rows"]
    there = os.path.isdir(settings["folder"])
    return dict(found, before=request["before"], folder=there, place=settings["folder"], running=runs())


def runs() -> bool:
    """Whether the unit runs."""
    words = ["systemctl", "show", "--property=ActiveState", "--value", UNIT]
    done = subprocess.run(words, stdout=subprocess.PIPE, check=False)
    return done.stdout.strip() in (b"active", b"activating", b"reloading", b"deactivating")


def start(settings: "dict", request: "dict") -> "dict":
    """Take a job, if there is none, and let the unit begin."""
    if runs():
        return {"error": "running"}
    found = listed(settings, request)
    if found["bytes"] > request["agreed_bytes"]:
        return {"error": "more", "bytes": found["bytes"]}
    if not found["rows"]:
        return {"error": "nothing"}
    limits = {name: request[name] for name in ("id", "link", "rate_bps", "cap_bytes", "silence_s", "rtt_max_s")}
    with contextlib.suppress(OSError):
        COUNTS.unlink()
    totals = {name: found[name] for name in ("files", "bytes")}
    write(STATUS, {"state": "sending", "id": request["id"], "link": request["link"], "since": time.time(), **totals})
    write(JOB, dict(limits, files=found["rows"]))
    subprocess.run(["systemctl", "reset-failed", UNIT], stderr=subprocess.DEVNULL, check=False)
    done = subprocess.run(["systemctl", "start", "--no-block", UNIT], stderr=subprocess.PIPE, check=False)
    if done.returncode:
        JOB.unlink()
        return {"error": "unit", "why": done.stderr.decode(errors="replace").strip()}
    return {"started": True}


def status(_settings: "dict", _request: "dict") -> "dict":
    """Say how it stands."""
    counts = read(COUNTS, {})
    return dict(read(STATUS, {"state": "none"}), running=runs(), job=JOB.exists(), wire_bytes=counts.get("wire", 0))


def stop(settings: "dict", request: "dict") -> "dict":
    """End it for good; what has arrived stays there, and is not sent again by the next job."""
    there = JOB.exists()
    with contextlib.suppress(FileNotFoundError):
        JOB.unlink()
    done = subprocess.run(["systemctl", "stop", UNIT], stderr=subprocess.PIPE, check=False)
    if done.returncode:
        return {"error": "unit", "why": done.stderr.decode(errors="replace").strip()}
    if there:
        note(state="stopped")
    return dict(status(settings, request), stopped=there)


def run(settings: "dict") -> int:
    """Send until all has arrived, nothing more can be done, or nothing more may be sent."""
    tries = 0
    while True:
        job = read(JOB)
        if job is None:
            return 0
        note(state="sending")
        try:
            left = attempt(settings, job)
        except Away as error:
            if read(COUNTS, {}).get("spent"):
                return end(state="spent")
            note(state="waiting", why=str(error), tries=tries + 1)
            time.sleep(min(job["silence_s"] / 4, PAUSES_S[min(tries, len(PAUSES_S) - 1)]))
            tries += 1
        except Refused as error:
            return end(state="failed", why=str(error))
        else:
            return end(state="failed" if left["differ"] else "done", left=left, why="")


def end(**values: "object") -> int:
    """Tell how it has ended; the job goes last, so that one that was killed before is taken up again."""
    note(**values)
    with contextlib.suppress(FileNotFoundError):
        JOB.unlink()
    return 0


def attempt(settings: "dict", job: "dict") -> "dict":
    """Bring all files of the job there; give those that were not, by the reason. Raises Away, Refused."""
    left = {"changed": [], "gone": [], "differ": []}
    due = digested(settings, job, left)
    for _ in range(ROUNDS):
        if not due:
            break
        answers = call(settings, job, "have", [row[:3] for row in due])
        sort = {name: [row for row, word in zip(due, answers["answers"]) if word == name] for name in WORDS}
        keep(settings, sort["kept"])
        forget([*sort["missing"], *sort["differs"]])
        due = [row for row in due if row not in sort["kept"]]
        note(arrived=job_files(job) - len(due) - sum(map(len, left.values())))
        lacking = sum(row[1] for row in sort["missing"]) - answers["room"]
        if lacking > 0:
            raise Refused(f"no room: {lacking} bytes are missing in the folder at the control centre")
        send(settings, job, [row[0] for row in (*sort["missing"], *sort["partial"])], repair=False)
        send(settings, job, [row[0] for row in sort["differs"]], repair=True)
        due = unchanged(settings, due, left)
        if not due:
            break
        answers = call(settings, job, "keep", [row[:3] for row in due])
        arrived = [row for row, word in zip(due, answers["answers"]) if word == "kept"]
        keep(settings, arrived)
        due = [row for row in due if row not in arrived]
    left["differ"] = [row[0] for row in due]
    note(arrived=job_files(job) - sum(map(len, left.values())))
    return left


WORDS = ("kept", "missing", "partial", "differs")
"""What the control centre answers about a file."""


def job_files(job: "dict") -> int:
    """How many files a job has."""
    return len(job["files"])


def digested(settings: "dict", job: "dict", left: "dict") -> "list":
    """Rows of path, size, SHA-256 and time of the last change; read once, also after a new start."""
    known, rows = read(HASHES, {}), []
    for path, size, when in job["files"]:
        place = os.path.join(settings["folder"], path)
        try:
            if known.get(path, [])[:2] != [size, when]:
                known[path] = [size, when, digest(place)]
            state = os.lstat(place)
        except OSError:
            left["gone"].append(path)
            continue
        if [state.st_size, state.st_mtime_ns] != [size, when]:
            left["changed"].append(path)
            continue
        rows.append([path, size, known[path][2], when])
    write(HASHES, {path: known[path] for path, _, _ in job["files"] if path in known})
    return rows


def digest(path: str) -> str:
    """SHA-256 of a file."""
    found = hashlib.sha256()
    with open(path, "rb") as file:
        for block in iter(lambda: file.read(1 << 20), b""):
            found.update(block)
    return found.hexdigest()


def unchanged(settings: "dict", rows: "list", left: "dict") -> "list":
    """Those that are what they were when they were read."""
    good = []
    for path, size, sha256, when in rows:
        try:
            state = os.lstat(os.path.join(settings["folder"], path))
        except OSError:
            left["gone"].append(path)
            continue
        if [state.st_size, state.st_mtime_ns] == [size, when]:
            good.append([path, size, sha256, when])
        else:
            left["changed"].append(path)
    return good


def keep(settings: "dict", rows: "list") -> None:
    """Note what the control centre has read again, so that it is not sent by the next job; forget what is gone here."""
    if not rows:
        return
    kept = read(KEPT, {})
    kept.update((path, [size, when, sha256]) for path, size, sha256, when in rows)
    write(KEPT, {path: row for path, row in kept.items() if os.path.lexists(os.path.join(settings["folder"], path))})


def forget(rows: "list") -> None:
    """Tell, and note, that what was at the control centre is there no more, or is otherwise."""
    kept = read(KEPT, {})
    lost = [row[0] for row in rows if kept.pop(row[0], None) is not None]
    if lost:
        write(KEPT, kept)
        note(lost=[*read(STATUS, {}).get("lost", []), *lost])


def ssh(settings: "dict", job: "dict") -> "list[str]":
    """Program and options of ssh, without the host; the silence that it bears is the job's."""
    options = {
        "BatchMode": "yes",
        "IdentitiesOnly": "yes",
        "IdentityAgent": "none",
        "StrictHostKeyChecking": "yes",
        "UserKnownHostsFile": KNOWN_HOSTS,
        "GlobalKnownHostsFile": "/dev/null",
        "HostKeyAlias": settings["to"],
        "UpdateHostKeys": "no",
        "ServerAliveInterval": str(max(1, job["silence_s"] // 4)),
        "ServerAliveCountMax": "4",
        "ProxyCommand": f"/usr/bin/python3 -I {os.path.abspath(__file__)} connect",
    }
    words = [word for name, value in options.items() for word in ("-o", f"{name}={value}")]
    return ["ssh", "-F", "none", "-T", "-i", settings["key"], "-l", settings["user"], *words]


def call(settings: "dict", job: "dict", verb: str, rows: "list") -> "dict":
    """Ask the control centre about files. Raises Away, Refused."""
    words = [*ssh(settings, job), "-C", settings["address"], "atlantis", verb]
    done = subprocess.run(words, input=json.dumps(rows).encode(), capture_output=True, check=False)
    if done.returncode:
        raise failure(done.returncode, done.stderr)
    try:
        answer = json.loads(done.stdout)
        if len(answer["answers"]) == len(rows):
            return answer
    except (ValueError, KeyError, TypeError):
        pass
    raise Away("the answer of the control centre did not come whole")


def send(settings: "dict", job: "dict", paths: "list[str]", *, repair: bool) -> None:
    """Send files by rsync: what arrived before is kept, or in a repair compared by blocks. Raises Away, Refused."""
    if not paths:
        return
    silence = str(max(2, job["silence_s"]))
    how = ["--ignore-times"] if repair else ["--append-verify"]
    shell = " ".join(f"'{word}'" if " " in word else word for word in ssh(settings, job))
    words = ["rsync", "--times", "--inplace", *how, "--timeout", silence, "--from0", "--files-from=-", "-e", shell]
    words += [settings["folder"] + "/", settings["address"] + ":."]
    data = b"".join(path.encode() + b"\0" for path in paths)
    done = subprocess.run(words, input=data, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, check=False)
    if done.returncode and done.returncode not in SOME_LEFT:
        raise failure(done.returncode, done.stderr)


def failure(code: int, data: bytes) -> Exception:
    """What a program's end means, with the last that it has said."""
    text = data.decode(errors="replace").strip()
    for words, meaning in PERMANENT.items():
        if words in text:
            line = next(line for line in text.splitlines() if words in line)
            return Refused(f"{meaning} ({line.strip()})")
    first = text.splitlines()[0] if text else f"a program ended with {code}"
    return Away(first) if code in LINK_LOST else Refused(first)


class Meter:
    """Counts what goes over the connection, here and in connections before; ends everything at the cap."""

    def __init__(self, job: "dict") -> None:
        self._cap, self._rate = job["cap_bytes"], job["rate_bps"] / 8 / WIRE
        self._lock = threading.RLock()
        self._wire = read(COUNTS, {}).get("wire", 0)
        self._free_at = self._noted = time.monotonic()

    @property
    def portion(self) -> int:
        """How much is sent at once: a quarter of a second, and neither a crumb nor more than 16 kB."""
        return max(512, min(16384, int(self._rate / 4)))

    def pace(self, count: int) -> None:
        """Wait until so many bytes may go."""
        now = time.monotonic()
        wait = self._free_at - now
        self._free_at = max(now, self._free_at) + count / self._rate
        if wait > 0:
            time.sleep(wait)

    def count(self, count: int) -> None:
        """Count bytes of either direction."""
        with self._lock:
            self._wire += int(count * WIRE)
            over = self._cap is not None and self._wire > self._cap
            if over or time.monotonic() > self._noted + NOTED_S:
                self.save(spent=over)
        if over:
            os._exit(SPENT)

    def save(self, *, spent: bool = False) -> None:
        """Note it for `status` and for the next connection."""
        with self._lock:
            self._noted = time.monotonic()
            write(COUNTS, {"wire": self._wire, "spent": spent}, sync=spent)


def connect(settings: "dict") -> int:
    """Carry bytes between ssh and the control centre."""
    job = read(JOB)
    if job is None or read(COUNTS, {}).get("spent"):
        return 1
    meter = Meter(job)
    for number in (signal.SIGHUP, signal.SIGTERM, signal.SIGPIPE):
        signal.signal(number, lambda *_: (meter.save(), os._exit(1)))
    here, began = (settings["from"], 0), time.monotonic()
    with socket.create_connection((settings["address"], settings["port"]), job["silence_s"], here) as peer:
        if too_slow(job, time.monotonic() - began):
            return 1
        peer.settimeout(None)
        peer.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, job["silence_s"] * 1000)
        threading.Thread(target=_watch, args=(peer, job, meter), daemon=True).start()
        # What waits in the kernel has been counted, and has not been sent: let it be little.
        peer.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 65536)
        threading.Thread(target=_up, args=(peer, meter), daemon=True).start()
        while True:
            data = peer.recv(65536)
            if not data:
                break
            meter.count(len(data))
            view = memoryview(data)
            while view:
                view = view[os.write(1, view) :]
    meter.save()
    return 0


def too_slow(job: "dict", rtt_s: float) -> bool:
    """Whether an answer comes over another link than the job's, one that is paid by the byte; ssh's error tells it."""
    limit = job["rtt_max_s"]
    if limit is None or rtt_s <= limit:
        return False
    sys.stderr.write("an answer takes {:.1f} s: the traffic does not go over {} now\n".format(rtt_s, job["link"]))
    sys.stderr.flush()
    return True


def _watch(peer: socket.socket, job: "dict", meter: Meter) -> None:
    """End with the ssh that this serves, which may die while nothing can be sent; and when answers get too slow."""
    ssh_process, slow, rtt_s = os.getppid(), 0, 0.0
    while os.getppid() == ssh_process and slow < SLOW_S:
        time.sleep(1)
        with contextlib.suppress(OSError):
            told = peer.getsockopt(socket.IPPROTO_TCP, socket.TCP_INFO, RTT_AT + 4)
            rtt_s = struct.unpack_from("I", told, RTT_AT)[0] / 1e6
        slow = slow + 1 if job["rtt_max_s"] is not None and rtt_s > job["rtt_max_s"] else 0
    too_slow(job, rtt_s)
    meter.save()
    os._exit(1)


def _up(peer: socket.socket, meter: Meter) -> None:
    with contextlib.suppress(OSError):
        while True:
            data = os.read(0, meter.portion)
            if not data:
                break
            meter.pace(len(data))
            meter.count(len(data))
            peer.sendall(data)
        peer.shutdown(socket.SHUT_WR)


ASKED = {"look": look, "start": start, "status": status, "stop": stop}


def main(verb: str) -> int:
    """Do what is asked."""
    settings = read(SETTINGS)
    if settings is None:
        sys.stderr.write("no recordings of this computer are declared\n")
        return 1
    if verb == "connect":
        return connect(settings)
    STATE.mkdir(mode=0o700, parents=True, exist_ok=True)
    if verb == "run":
        return run(settings)
    with LOCK.open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        answer = ASKED[verb](settings, json.load(sys.stdin))
    sys.stdout.write(json.dumps(answer) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1]))
