"""The build itself: a program of its own on the gateway, which no SSH session holds on to.

It is started by `build_start` as a transient unit of systemd with the name of its job file, and leaves behind a
complete build, or nothing that could be taken for one, and in either case its outcome in a file in memory.
"""

# ruff: noqa: PTH103, PTH105, PTH108, PTH110, PTH118, PTH120
# ruff: noqa: PTH123 - paths are text on the gateways' side, where all modules share it

from __future__ import annotations

import errno
import fcntl
import json
import os
import signal
import sys
import time
from typing import TYPE_CHECKING, Any

from .build_git import Git, configure
from .build_make import Make, jobs_within
from .build_plan import Plan, Shelf, is_commit
from .build_words import CardFull
from .refused import Refused, in_words

if TYPE_CHECKING:
    from typing import Callable

__all__ = ["main", "work"]


def main(job_file: str) -> int:
    """Do the job; 1: it failed, as its outcome tells."""
    signal.signal(signal.SIGTERM, _stop)
    with open(job_file, encoding="utf-8") as file:
        job = json.load(file)
    began = time.monotonic()
    try:
        notes = work(job, os.path.dirname(job_file))
        outcome = {"run": job["run"], "ok": True, "notes": notes}
        _say(f"complete after {time.monotonic() - began:.0f} s")
    except Refused as refused:
        outcome = {"run": job["run"], "ok": False, "message": refused.message, "hint": refused.hint}
        _say(f"failed after {time.monotonic() - began:.0f} s: {refused.message}")
    with open(f"{job['outcome']}.new", "w", encoding="utf-8") as file:
        json.dump(outcome, file)
    os.replace(f"{job['outcome']}.new", job["outcome"])
    return 0 if outcome["ok"] else 1


def work(job: dict[str, Any], home: str, sleep: Callable[[float], None] = time.sleep) -> list[str]:
    """Fetch, build, check, complete; gives notes for a person. Raises Refused. Tokens in `home` are gone afterwards."""
    plan = Plan.of(job["plan"])
    shelf = Shelf(job["prefix"])
    folder = shelf.at(plan.key)
    try:
        os.makedirs(folder, exist_ok=True)
        with open(os.path.join(job["prefix"], ".lock"), "w", encoding="utf-8") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            return _build(job, plan, shelf, home, sleep)
    except CardFull:
        shelf.discard(plan.key)
        raise
    except OSError as error:
        if error.errno in (errno.ENOSPC, errno.EDQUOT):
            shelf.discard(plan.key)
        raise in_words(error, folder) from error
    finally:
        _forget(home, plan)


def _build(job: dict[str, Any], plan: Plan, shelf: Shelf, home: str, sleep: Callable[[float], None]) -> list[str]:
    if shelf.marker(plan.key) is not None:
        return []
    folder = shelf.at(plan.key)
    with open("/proc/meminfo", encoding="ascii") as meminfo:
        jobs = jobs_within(meminfo.read(), os.cpu_count() or 1, job["jobs"])
    make = Make(folder, plan.ros_setup, jobs, job["log"], _say)
    make.clean()
    configure(home, job["offline"], [repository.url for repository in plan.repositories.values()])
    commits, current = {}, shelf.linked("current")
    for name, item in plan.repositories.items():
        _say(f"fetching the {name}, revision {item.revision}, from {item.url}" + _place(job["offline"]))
        seed = os.path.join(shelf.at(current), name) if current is not None else None
        commits[name] = Git(item, name, os.path.join(folder, name), home, job["offline"], _say, sleep).fetch(seed)
        _say(f"the {name} is at commit {commits[name]}")
    _forget(home, plan)
    notes = _moved(plan, shelf, commits)
    make.library()
    if plan.examples is not None:
        make.examples()
    make.tidy()  # what leans on something that goes with it does not pass the check
    make.check()
    shelf.complete(plan.key, {**plan.as_dict(), "commits": commits, "notes": notes})
    return notes


def _moved(plan: Plan, shelf: Shelf, commits: dict[str, str]) -> list[str]:
    """Tell of tags that lead elsewhere than when they were last built."""
    tags = shelf.tags()
    notes = []
    for name, repository in plan.repositories.items():
        before = tags.get(repository.url, {}).get(repository.revision, commits[name])
        if not is_commit(repository.revision) and before != commits[name]:
            notes.append(
                f"the tag {repository.revision} of the {name} has moved: it led to commit {before} when it was last"
                f" built, and leads to {commits[name]} now; ask the partner whether that is meant"
            )
    for note in notes:
        _say(note)
    return notes


def _forget(home: str, plan: Plan) -> None:
    for name in plan.repositories:
        for path in (os.path.join(home, name), os.path.join(home, f"{name}.askpass")):
            if os.path.exists(path):
                os.unlink(path)


def _place(offline: str | None) -> str:
    return f", as {offline} holds it" if offline is not None else ""


def _say(line: str) -> None:
    print(f"== {line}", flush=True)  # noqa: T201 - the log of the build


def _stop(*_: object) -> None:
    raise Refused("the build was stopped before it was complete", "type the same again: what was fetched is kept")


if __name__ == "__main__":
    sys.exit(main(sys.argv[1]))
