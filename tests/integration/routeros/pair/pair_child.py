"""A pair's run in a process of its own, which may kill itself at a record of its journal; prints one line of JSON.

python pair_child.py {"near": {"host": ..., "port": ..., "pin": ..., "text": ...}, "far": ..., "state": ..., ...}
"""

import asyncio
import json
import os
import signal
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from atlantis_netcfg.core.secret import Secret
from atlantis_netcfg.routeros import DeviceJob, Endpoint, JobMode, Patience, desired
from atlantis_netcfg.routeros.pair import Pair, converge_pair
from atlantis_netcfg.runs import Journal, Record, RunResume, RunStart, Store

STARTED = RunStart(
    site="quay", revision="", tool="", hosts=("near", "far"), rehearsed=False, command="provision site=quay"
)


class Deadly(Journal):
    """A journal whose process dies when its n-th record is on disk."""

    left = 0

    def write(self, record: Record) -> None:
        super().write(record)
        self.left -= 1
        if self.left == 0:
            os.kill(os.getpid(), signal.SIGKILL)


def journal(asked: Mapping[str, Any]) -> Journal:
    store = Store(Path(asked["state"]))
    if asked["mode"] == JobMode.RESUME:
        (run,) = store.unfinished_runs("quay")
        return store.resume("quay", run.id, RunResume(revision="", tool="", command="provision recover resume"))
    with store.start(STARTED) as started:
        deadly = Deadly(started.directory)
    deadly.left = asked.get("record", 0)
    return deadly


def job(name: str, asked: Mapping[str, Any], log: Journal) -> DeviceJob:
    end = asked[name]
    return DeviceJob(
        name=name,
        site="quay",
        address=end["address"],
        endpoint=Endpoint(end["host"], end["port"], "provision", Secret(asked["password"]), end["pin"]),
        desired_state=desired.read(end["text"]),
        journal=log,
        patience=Patience(reach_s=20.0, undo_s=20.0, first_poll_s=0.05, last_poll_s=0.2),
    )


def main(asked: Mapping[str, Any]) -> None:
    log = journal(asked)
    pair = Pair(
        job("near", asked, log), job("far", asked, log), link_timeout_s=asked["timeout_s"], reserve_s=1.0, grace_s=0.5
    )
    results = asyncio.run(converge_pair(pair, mode=JobMode(asked["mode"])))
    sys.stdout.write(json.dumps([dict(result.as_dict()) for result in results]) + "\n")


if __name__ == "__main__":
    main(json.loads(sys.argv[1]))
