"""A process that measures a load through a relay as `provision measure link` does, for a test that stops it meanwhile.

Typed: the relay's port, and the rate in bits a second that the link is declared with, both ways. It says `ready` on a
line, waits for a line, says `load` when the load begins, and prints the record's load and judgements as JSON.
"""

import json
import sys
import time
from dataclasses import asdict, replace
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[3] / "unit" / "links" / "qualify"))

from example_runs import measured_run

from atlantis_netcfg.inventory import load
from atlantis_netcfg.links.qualify.budget import Budget, BudgetGuard
from atlantis_netcfg.links.qualify.judgement import profile
from atlantis_netcfg.links.qualify.measured_run import Selection
from atlantis_netcfg.links.qualify.record import make_record
from atlantis_netcfg.links.qualify.session import ReflectorPeer, TrainPlan
from atlantis_netcfg.links.qualify.transport import UdpTransport
from atlantis_netcfg.operations.qualify.measure import CountedTransport, Measurement
from atlantis_netcfg.operations.qualify.plan import build_plan

KEY = b"an example key, 32 octets long.."
INVENTORY = Path(__file__).parents[4] / "inventory"
LOAD_S = 5.0


def main(port: int, rate_bps: int) -> None:
    """Send the round trips without load in peace, then the load each way."""
    bearer = next(each for each in load(INVENTORY).sites["coastal"].bearers if each.name == "4g")
    rate = bearer.rate.model_copy(update={"up_kbps": rate_bps // 1000, "down_kbps": rate_bps // 1000})
    plan = build_plan(bearer.model_copy(update={"rate": rate}), Selection.THROUGHPUT)
    assert plan.load is not None
    assert plan.load_down is not None
    plan = replace(
        plan,
        times=replace(plan.times, load_s=LOAD_S),
        idle=TrainPlan(112, 0.1, 6.2),
        load=replace(plan.load, duration_s=LOAD_S),
        load_down=replace(plan.load_down, duration_s=LOAD_S),
    )
    guard = BudgetGuard(Budget(), time.monotonic)
    with UdpTransport(("127.0.0.1", port)) as transport:
        counted = CountedTransport(transport)
        measurement = Measurement(plan, ReflectorPeer(KEY), counted, guard, lambda _sample: None)
        sys.stdout.write("ready\n")
        sys.stdout.flush()
        sys.stdin.readline()
        measurement._measure_idle()
        sys.stdout.write("load\n")
        sys.stdout.flush()
        measurement._measure_load()
        measurement._measure_load_down()
    run = measured_run(link="4g", kind="lte", thresholds_name="lte", thresholds=profile("lte"))
    record = make_record(run, measurement.samples)
    rows, judged = ([asdict(each) for each in items] for items in (record.load, record.judgements))
    sys.stdout.write(json.dumps({"verdict": record.verdict, "load": rows, "judgements": judged}, default=str) + "\n")


if __name__ == "__main__":
    main(int(sys.argv[1]), int(sys.argv[2]))
