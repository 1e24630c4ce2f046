"""Measures one cell after the other from within a namespace: `stamp_cells.py PLAN`, a JSON file; samples go to a file.

PLAN: `far_end` (address and port), `key` (a file), `samples` (a file), `idle_s`, `cells` (kind, label, octets, messages
a second, seconds), `patience_s`: how long answers are awaited, and how long nothing is sent between two cells. The
first train, `idle`, is for the round trip without load.
"""

from __future__ import annotations

import json
import sys
import time
from dataclasses import replace
from pathlib import Path

from atlantis_netcfg.links.qualify.budget import Budget, BudgetGuard
from atlantis_netcfg.links.qualify.grids import telemetry_plan
from atlantis_netcfg.links.qualify.messages import MessagePlan, MessageStream
from atlantis_netcfg.links.qualify.samples import SampleWriter
from atlantis_netcfg.links.qualify.session import PacketStream, ReflectorPeer, Train, TrainPlan, run
from atlantis_netcfg.links.qualify.transport import UdpTransport


def main(plan: Path) -> None:
    """Measure every cell of the plan."""
    told = json.loads(plan.read_text(encoding="utf-8"))
    patience_s = told["patience_s"]
    peer = ReflectorPeer(Path(told["key"]).read_bytes().strip())
    far_end = (told["far_end"][0], told["far_end"][1])
    with UdpTransport(far_end) as transport, Path(told["samples"]).open("a", encoding="utf-8") as file:
        guard, write = BudgetGuard(Budget(), time.monotonic), SampleWriter(file)
        idle = TrainPlan(172, 0.25, told["idle_s"], timeout_s=patience_s)
        run(transport, peer, [Train("idle", idle, peer, transport, write)], guard)
        for kind, label, octets, rate_hz, seconds in told["cells"]:
            time.sleep(patience_s)  # until the queue is empty
            name = f"{kind} {label} {rate_hz:g}"
            stream: PacketStream
            if kind == "telemetry":
                train = replace(telemetry_plan(octets, rate_hz, seconds), timeout_s=patience_s)
                stream = Train(name, train, peer, transport, write)
            else:
                message = MessagePlan(octets, rate_hz, seconds, timeout_s=patience_s)
                stream = MessageStream(name, message, peer, transport, write)
            run(transport, peer, [stream], guard)
            sys.stdout.write(f"{name}\n")
            sys.stdout.flush()


if __name__ == "__main__":
    main(Path(sys.argv[1]))
