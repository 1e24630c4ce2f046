"""atlantis: sends the recordings of this gateway to the control centre; nothing here is ever changed or removed.

`look`, `start`, `status` and `stop` are asked by the toolkit: JSON on the standard input, JSON on the standard output.
`run` is the unit: it sends what the job lists by rsync over SSH, goes on where it was whenever the link is back, and
ends when the control centre has read every file again and found the same SHA-256. `connect` is the way of its ssh to
the control centre: it keeps to the rate, counts every byte, and ends at the job's cap.

A source is the gateway itself, or a robot: what is on the robot is collected here first (`retrieval_robot.py`), and
the copy is removed when the control centre has it. What is known of a source stands in a folder of its own, which is
the working directory. There is one job at a time.
"""

# ruff: noqa: INP001, PTH100, PTH108, PTH112, PTH118, PTH120, PTH123 - a program of the gateway; its paths are text

import contextlib
import fcntl
import fnmatch
import hashlib
import json
import os
import signal
import socket
import struct
import sys
import threading
import time
from pathlib import Path

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
from retrieval_robot import (
    LINK_LOST,
    ROOT,
    SOME_LEFT,
    Away,
    Refused,
    Robot,
    TooMuch,
    batches,
    bounded,
    quoted,
    regular,
    ssh_words,
)

SETTINGS = Path(ROOT, "etc/atlantis/retrieval.json")
STATE = Path(ROOT, "var/lib/atlantis/retrieval")
JOB, LOCK = STATE / "job.json", STATE / "lock"
STATUS, COUNTS, KEPT, HASHES = (Path(name) for name in ("status.json", "counts.json", "kept.json", "hashes.json"))
"""Of the source."""
UNIT = "atlantis-retrieval.service"
QUIET_S = 60
"""A file that was written to later than this is still being written."""
WIRE = 1.2
"""Bytes on the link for each byte of the connection: headers of TCP, IP and the VPN, acknowledgements, some losses."""
PAUSES_S = (5, 10, 20, 30)
ROUNDS = 3
"""How often a file that arrived otherwise is sent again."""
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


def found(settings: "dict") -> "tuple[list, dict | None]":
    """Rows of path, size and time of all files of the source, and what is known of its robot."""
    here = [[path, state.st_size, state.st_mtime_ns] for path, state in regular(settings["folder"])]
    if "robot_user" not in settings:
        return here, None
    try:
        there = Robot(settings).list()
    except (Away, Refused) as error:
        state = "away" if isinstance(error, Away) else "refused"
        return here, {"state": state, "kind": getattr(error, "kind", ""), "why": str(error)}
    rows = {row[0]: row for row in (*here, *there)}
    return [rows[path] for path in sorted(rows)], {"state": "answers", "paths": [row[0] for row in there]}


def listed(settings: "dict", request: "dict") -> "dict":
    """What would be sent: files that match, are written to no more, and are not at the control centre yet."""
    kept, rows, writing, before = read(KEPT, {}), [], 0, request["before"]
    already = unnamed = 0
    files, robot = found(settings)
    for path, size, when in files:
        if not fnmatch.fnmatchcase(path, request["pattern"]):
            continue
        try:
            path.encode("utf-8")
        except UnicodeEncodeError:
            unnamed += 1
            continue
        if not path.isprintable():
            unnamed += 1
        elif when > (before - QUIET_S) * 1e9:
            writing += 1
        elif not request["again"] and kept.get(path, [])[:2] == [size, when]:
            already += 1
        else:
            rows.append([path, size, when])
    known = [path in kept and kept[path][:2] == [size, when] for path, size, when in rows]
    return {
        "rows": rows,
        "files": len(rows),
        "bytes": sum(row[1] for row, there in zip(rows, known) if not there),
        "compared": sum(known),
        "kept": already,
        "writing": writing,
        "unnamed": unnamed,
        "robot": robot,
    }


def look(settings: "dict", request: "dict") -> "dict":
    """Say what would be sent; the control centre is not contacted, a robot is."""
    request.setdefault("before", time.time())
    seen = listed(settings, request)
    rows, robot = seen.pop("rows"), seen["robot"]
    if robot is not None:
        here = Robot(settings)
        due = [row for row in rows if not here.here(row)]
        robot.pop("paths", None)
        robot.update(files=len(due), bytes=sum(row[1] for row in due), lacking=here.lacking(rows))
    there = os.path.isdir(settings["folder"])
    return dict(seen, before=request["before"], folder=there, place=settings["folder"], running=runs())


def runs() -> bool:
    """Whether the unit runs."""
    words = ["systemctl", "show", "--property=ActiveState", "--value", UNIT]
    _, printed, _ = bounded(words)
    return printed.strip() in (b"active", b"activating", b"reloading", b"deactivating")


def start(settings: "dict", request: "dict") -> "dict":
    """Take a job, if there is none, and let the unit begin."""
    if runs():
        return {"error": "running"}
    seen = listed(settings, request)
    robot = seen["robot"] or {"state": "none"}
    if robot["state"] != request.get("robot", "none"):
        return {"error": "robot", "why": robot.get("why", "")}
    if seen["bytes"] > request["agreed_bytes"]:
        return {"error": "more", "bytes": seen["bytes"]}
    if not seen["rows"]:
        return {"error": "nothing"}
    if robot["state"] == "answers":
        Robot(settings).forget(set(robot["paths"]))
        write(KEPT, {path: row for path, row in read(KEPT, {}).items() if path in set(robot["paths"])})
    limits = {name: request[name] for name in ("id", "link", "rate_bps", "cap_bytes", "silence_s", "rtt_max_s")}
    with contextlib.suppress(OSError):
        COUNTS.unlink()
    totals = {name: seen[name] for name in ("files", "bytes")}
    if robot["state"] == "away":
        totals["unseen"] = robot["why"]
    write(STATUS, {"state": "sending", "id": request["id"], "link": request["link"], "since": time.time(), **totals})
    write(JOB, dict(limits, source=settings["source"], files=seen["rows"]))
    bounded(["systemctl", "reset-failed", UNIT])
    code, _, errors = bounded(["systemctl", "start", "--no-block", UNIT])
    if code:
        JOB.unlink()
        return {"error": "unit", "why": errors.decode(errors="replace").strip()}
    return {"started": True}


def others(settings: "dict") -> bool:
    """Whether the job is that of another source."""
    job = read(JOB)
    return job is not None and job.get("source", settings["source"]) != settings["source"]


def status(settings: "dict", _request: "dict") -> "dict":
    """Say how it stands."""
    other = others(settings)
    on = {"running": not other and runs(), "job": not other and JOB.exists()}
    # Read after that: what ends meanwhile has told its end before.
    told = dict(read(STATUS, {"state": "none"}), wire_bytes=read(COUNTS, {}).get("wire", 0), **on)
    if told["state"] == "collecting":
        robot = Robot(settings)
        told["collected_bytes"] = robot.begun() + sum(state.st_size for _, state in regular(robot.folder))
    return told


def stop(settings: "dict", request: "dict") -> "dict":
    """End it for good; what has arrived stays there, and is not sent again by the next job."""
    if others(settings):
        return dict(status(settings, request), stopped=False)
    there = JOB.exists()
    with contextlib.suppress(FileNotFoundError):
        JOB.unlink()
    code, _, errors = bounded(["systemctl", "stop", UNIT])
    if code:
        return {"error": "unit", "why": errors.decode(errors="replace").strip()}
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
    left = {"changed": [], "gone": [], "differ": [], "unread": [], "robot": []}
    due = digested(settings, {"files": collected(settings, job, left)}, left)
    note(state="sending")
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


def collected(settings: "dict", job: "dict", left: "dict") -> "list":
    """Rows of the job that are here to be sent, after all that the robot gives was brought here. Raises Refused."""
    rows = [row for row in job["files"] if row[0] not in job.get("arrived", [])]
    if "robot_user" not in settings:
        return rows
    robot, tries = Robot(settings, job["silence_s"] // 4), 0
    due = [row for row in rows if not robot.here(row)]
    waiting = [] if job.get("robot_gone") else batches(due)
    lacking = robot.lacking(due) if waiting else 0
    if lacking > 0:
        raise Refused(f"no room: {lacking} bytes are missing for {robot.name} on this gateway")
    while waiting:
        note(state="collecting", collected=len(due) - sum(map(len, waiting)), collect=len(due))
        begun = robot.begun()
        try:
            for reason, paths in robot.collect(waiting[0]).items():
                left[reason] += paths
        except (Away, Refused) as error:
            note(why=str(error))
            tries = 0 if robot.begun() > begun else tries
            if isinstance(error, Refused) or tries == len(PAUSES_S):
                write(JOB, dict(job, robot_gone=True))
                break
            time.sleep(min(job["silence_s"] / 4, PAUSES_S[tries]))
            tries += 1
        else:
            del waiting[0]
            tries = 0
            note(why="")
    told = {path for paths in left.values() for path in paths}
    left["robot"] += [row[0] for row in due if not robot.here(row) and row[0] not in told]
    return [row for row in rows if robot.here(row)]


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
    kept, robot = read(KEPT, {}), "robot_user" in settings
    kept.update((path, [size, when, sha256]) for path, size, sha256, when in rows)
    there = {path for path in kept if robot or os.path.lexists(os.path.join(settings["folder"], path))}
    write(KEPT, {path: row for path, row in kept.items() if path in there})
    if robot:
        discard(settings, [row[0] for row in rows])


def discard(settings: "dict", paths: "list[str]") -> None:
    """Remove what was collected of a robot, and is at the control centre; the robot has it all the same."""
    job = read(JOB)
    if job is not None:
        write(JOB, dict(job, arrived=[*job.get("arrived", []), *paths]))
    for path in paths:
        place = os.path.join(settings["folder"], path)
        with contextlib.suppress(OSError):
            os.unlink(place)
            os.removedirs(os.path.dirname(place))


def forget(rows: "list") -> None:
    """Tell, and note, that what was at the control centre is there no more, or is otherwise."""
    kept = read(KEPT, {})
    lost = [row[0] for row in rows if kept.pop(row[0], None) is not None]
    if lost:
        write(KEPT, kept)
        note(lost=[*read(STATUS, {}).get("lost", []), *lost])


def ssh(settings: "dict", job: "dict") -> "list[str]":
    """Program and options of ssh, without the host; the silence that it bears is the job's."""
    return ssh_words(
        settings["to"],
        settings["key"],
        settings["user"],
        ServerAliveInterval=str(max(1, job["silence_s"] // 4)),
        ServerAliveCountMax="4",
        ProxyCommand=f"/usr/bin/python3 -I {os.path.abspath(__file__)} connect",
    )


def call(settings: "dict", job: "dict", verb: str, rows: "list") -> "dict":
    """Ask the control centre about files. Raises Away, Refused."""
    words = [*ssh(settings, job), "-C", settings["address"], "atlantis", verb, settings["source"]]
    try:
        code, printed, errors = bounded(words, json.dumps(rows).encode())
    except TooMuch as error:
        raise Refused(f"the control centre {error}") from None
    if code:
        raise failure(code, errors)
    try:
        answer = json.loads(printed)
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
    words = ["rsync", "--times", "--inplace", *how, "--timeout", silence, "--from0", "--files-from=-"]
    words += [
        "-e",
        quoted(ssh(settings, job)),
        settings["folder"] + "/",
        settings["address"] + ":" + settings["source"],
    ]
    data = b"".join(path.encode() + b"\0" for path in paths)
    try:
        code, _, errors = bounded(words, data)
    except TooMuch as error:
        raise Refused(f"the control centre {error}") from None
    if code and code not in SOME_LEFT:
        raise failure(code, errors)


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
    try:
        return carry(settings, job, meter)
    except OSError as error:
        sys.stderr.write("{}: {}\n".format(settings["to"], error.strerror or error))
        return 1
    finally:
        meter.save()


def carry(settings: "dict", job: "dict", meter: Meter) -> int:
    """Until an end of the connection is closed. Raises OSError."""
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


def chosen(settings: "dict | None", name: "str | None") -> "dict | None":
    """What is declared of a source, by its name, of the gateway itself if left out; its folder is that of this work."""
    if settings is None:
        return None
    name = name or settings["from_host"]
    if name not in settings["sources"]:
        return None
    place = STATE if name == settings["from_host"] else STATE / "robots" / name
    place.mkdir(mode=0o700, parents=True, exist_ok=True)
    os.chdir(str(place))
    return dict(settings, **settings["sources"][name], source=name)


def main(verb: str) -> int:
    """Do what is asked."""
    work = verb in ("connect", "run")
    request = read(JOB, {}) if work else json.load(sys.stdin)
    settings = chosen(read(SETTINGS), request.get("source"))
    if settings is None:
        sys.stderr.write("no recordings of {} are declared\n".format(request.get("source", "this computer")))
        return 1
    if verb == "connect":
        return connect(settings)
    if verb == "run":
        return run(settings)
    with LOCK.open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        answer = dict(ASKED[verb](settings, request), source=settings["source"])
    sys.stdout.write(json.dumps(answer) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1]))
