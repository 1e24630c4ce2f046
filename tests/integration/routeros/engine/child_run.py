"""A run in a process of its own, which may kill itself or run out of disk; its result is one line of JSON.

python child_run.py {"host": ..., "port": ..., "pin": ..., "state": ..., "text": ..., "mode": ..., ...}
"""

import asyncio
import json
import os
import resource
import signal
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from atlantis_netcfg.core.secret import Secret
from atlantis_netcfg.routeros import DeviceJob, Endpoint, JobMode, Patience, converge, desired
from atlantis_netcfg.routeros.apply import SshEndpoint
from atlantis_netcfg.runs import Journal, Record, RunResume, RunStart, Store
from atlantis_netcfg.runs.log import LogEntry, line

STARTED = RunStart(site="coastal", revision="", tool="", hosts=("router",), rehearsed=False, command="provision")


class Deadly(Journal):
    """A journal whose process dies at its n-th record: before it, in the middle of it, or when it is on disk."""

    left = 0
    moment = ""

    def write(self, record: Record) -> None:
        self.left -= 1
        if self.left == 0 and self.moment == "torn":
            os.write(self._descriptor, line(LogEntry(self._now(), record))[:20])
        if self.left == 0 and self.moment != "after":
            os.kill(os.getpid(), signal.SIGKILL)
        super().write(record)
        if self.left == 0:
            os.kill(os.getpid(), signal.SIGKILL)


def journal(asked: Mapping[str, Any]) -> Journal:
    store = Store(Path(asked["state"]))
    if asked["mode"] == JobMode.RESUME:
        (run,) = store.unfinished_runs("coastal")
        return store.resume("coastal", run.id, RunResume(revision="", tool="", command="provision recover resume"))
    with store.start(STARTED) as started:
        deadly = Deadly(started.directory)
    deadly.left, deadly.moment = asked.get("record", 0), asked.get("moment", "")
    return deadly


def _console(asked: Mapping[str, Any]) -> SshEndpoint | None:
    if "ssh" not in asked:
        return None
    return SshEndpoint(asked["host"], asked["ssh"], "provision", Secret(asked["password"]), asked["host_key"])


def main(asked: Mapping[str, Any]) -> None:
    opened = journal(asked)
    job = DeviceJob(
        name="router",
        site="coastal",
        address="10.64.101.1",
        endpoint=Endpoint(asked["host"], asked["port"], "provision", Secret(asked["password"]), asked["pin"]),
        desired_state=desired.read(Path(asked["text"]).read_text(encoding="utf-8")),
        journal=opened,
        patience=Patience(**{"first_poll_s": 0.05, "last_poll_s": 0.2, **asked.get("patience", {})}),
        ssh=_console(asked),
        run=opened.run,
        history=Store(Path(asked["state"])).history("coastal", "router"),
    )
    if "bytes" in asked:
        resource.setrlimit(resource.RLIMIT_FSIZE, (asked["bytes"], asked["bytes"]))
    result = asyncio.run(converge(job, mode=JobMode(asked["mode"])))
    sys.stdout.write(json.dumps({**result.as_dict(), "notes": result.notes}) + "\n")


if __name__ == "__main__":
    main(json.loads(sys.argv[1]))
