"""Measures one cell after the other from within a namespace: `stamp_cells.py PLAN`, a JSON file; samples go to a file.

PLAN: `far_end` (address and port), `key` (a file), `samples` (a file), `idle_s`, `cells` (kind, label, octets, messages
a second, seconds). The first train, `idle`, is for the round trip without load.
"""

from __future__ import annotations

import json
import sys
import time
from pathlib import Path

from atlantis_netcfg.qualify.budget import Budget, BudgetGuard
from atlantis_netcfg.qualify.grids import telemetry_plan
from atlantis_netcfg.qualify.messages import MessagePlan, MessageStream
from atlantis_netcfg.qualify.samples import SampleWriter
from atlantis_netcfg.qualify.session import PacketStream, ReflectorPeer, Train, TrainPlan, run
from atlantis_netcfg.qualify.transport import UdpTransport

_DRAIN_S = 2.0
"""Until the queue of the cell before is empty."""
_TIMEOUT_S = 3.0


def main(plan: Path) -> None:
    """Measure every cell of the plan."""
    told = json.loads(plan.read_text(encoding="utf-8"))
    peer = ReflectorPeer(Path(told["key"]).read_bytes().strip())
    far_end = (told["far_end"][0], told["far_end"][1])
    with UdpTransport(far_end) as transport, Path(told["samples"]).open("a", encoding="utf-8") as file:
        guard, write = BudgetGuard(Budget(), time.monotonic), SampleWriter(file)
        idle = TrainPlan(172, 0.25, told["idle_s"], timeout_s=_TIMEOUT_S)
        run(transport, peer, [Train("idle", idle, peer, transport, write)], guard)
        for kind, label, octets, rate_hz, seconds in told["cells"]:
            time.sleep(_DRAIN_S)
            name = f"{kind} {label} {rate_hz:g}"
            stream: PacketStream
            if kind == "telemetry":
                train = telemetry_plan(octets, rate_hz, seconds)
                stream = Train(name, train, peer, transport, write)
            else:
                message = MessagePlan(octets, rate_hz, seconds, timeout_s=_TIMEOUT_S)
                stream = MessageStream(name, message, peer, transport, write)
            run(transport, peer, [stream], guard)
            sys.stdout.write(f"{name}\n")
            sys.stdout.flush()


if __name__ == "__main__":
    main(Path(sys.argv[1]))
