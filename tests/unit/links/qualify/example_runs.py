"""Runs to make figures of: measured over an emulated link on a simulated clock; names and addresses are examples."""

from datetime import UTC, datetime, timedelta
from decimal import Decimal
from functools import cache
from pathlib import Path
from typing import Any

from simulated_network import KEY, Recording, SimulatedNetwork, network, unlimited

from atlantis_netcfg.core.events import Verdict
from atlantis_netcfg.emulator.udp_link import LinkShape
from atlantis_netcfg.links.cost import Tariff
from atlantis_netcfg.links.qualify.grids import IMAGES, image_plan, telemetry_plan
from atlantis_netcfg.links.qualify.judgement import profile
from atlantis_netcfg.links.qualify.measured_run import (
    SAMPLES_FILE,
    BudgetLimits,
    FarEnd,
    LinkCount,
    MeasuredRun,
    Selection,
    write_run,
)
from atlantis_netcfg.links.qualify.messages import MessagePlan, MessageStream
from atlantis_netcfg.links.qualify.samples import Sample
from atlantis_netcfg.links.qualify.search import sustained_rate
from atlantis_netcfg.links.qualify.session import PacketStream, ReflectorPeer, Train, TrainPlan, run
from atlantis_netcfg.links.qualify.transfers import MessageFigures, message_figures

BEGUN = datetime(2026, 11, 20, 9, 30, tzinfo=UTC)
CERTUS_UP = LinkShape(rate_bps=352_000, delay_s=0.28, jitter_s=0.02)
CERTUS_DOWN = LinkShape(rate_bps=704_000, delay_s=0.28, jitter_s=0.02)
SMALL, LARGE = IMAGES[0], IMAGES[-1]
"""160x120 q30 and 640x480 q60."""


def measured_run(**changes: Any) -> MeasuredRun:  # noqa: ANN401 - fields of MeasuredRun
    fields: dict[str, Any] = {
        "id": "satellite-20261120T093000Z",
        "tool": "0.0.0",
        "site": "coastal",
        "link": "satellite",
        "kind": "satellite",
        "emulated": True,
        "selection": Selection.ALL,
        "far_end": FarEnd(
            name="example-control-centre",
            address="192.0.2.7",
            port=862,
            over_vpn=False,
            authenticated=True,
            source="192.0.2.1",
        ),
        "begun": BEGUN,
        "ended": BEGUN + timedelta(minutes=10),
        "reason": "done",
        "clock_synchronised": False,
        "budget": BudgetLimits(max_bytes=20_000_000),
        "currency": "EUR",
        "tariff": Tariff(Decimal(8), min_session_bytes=5000, floor_bytes_per_s=300, floor_after_s=300),
        "sent_bytes": 1_500_000,
        "received_bytes": 500_000,
        "price": Decimal("12.34"),
        "counts": (
            LinkCount(link="satellite", test_packets_up=9000, test_bytes_up=1_500_000),
            LinkCount(link="4g", test_packets_up=0, test_bytes_up=0),
        ),
        "way": Verdict.PASS,
        "way_reason": "all packets were counted on satellite, none elsewhere",
        "path_mtu_up": 1412,
        "path_mtu_both": 1412,
        "thresholds_name": "satellite",
        "thresholds": profile("satellite"),
        "facts": {"signal": "5 bars"},
    }
    return MeasuredRun(**{**fields, **changes})


class _Bench:
    """Stages of a run, one after the other, over one network."""

    def __init__(self, net: SimulatedNetwork) -> None:
        self.net = net
        self.text = ""
        self.peer = ReflectorPeer(KEY)

    def stage(self, **plans: TrainPlan | MessagePlan) -> list[Sample]:
        """Run streams beside each other; `_` of a name stands for a blank."""
        recording = Recording()
        streams: list[PacketStream] = []
        for key, plan in plans.items():
            name = key.replace("_", " ")
            if isinstance(plan, TrainPlan):
                streams.append(Train(name, plan, self.peer, self.net, recording.write))
            else:
                streams.append(MessageStream(name, plan, self.peer, self.net, recording.write))
        run(self.net, self.peer, streams, unlimited(self.net))
        self.text += recording.text.getvalue()
        return recording.samples

    def messages(self, name: str, plan: MessagePlan) -> MessageFigures:
        figures = message_figures(self.stage(**{name.replace(" ", "_"): plan}), name)
        assert figures is not None
        return figures


@cache
def idle_text(*, loss: float = 0.0, gap_at_s: float | None = None) -> str:
    """Give the samples of a train alone, over an emulated satellite link."""
    gaps = () if gap_at_s is None else ((gap_at_s, gap_at_s + 70.0),)
    up = LinkShape(rate_bps=352_000, delay_s=0.28, jitter_s=0.02, loss=loss, gaps_s=gaps)
    bench = _Bench(network(up, CERTUS_DOWN))
    bench.stage(idle=TrainPlan(172, 0.25, 150.0))
    return bench.text


@cache
def samples_text() -> str:
    """Give `samples.jsonl` of a whole run over an emulated satellite link."""
    bench = _Bench(network(CERTUS_UP, CERTUS_DOWN))
    bench.stage(idle=TrainPlan(172, 0.25, 150.0))
    bench.stage(load_up=MessagePlan(20_000, 2.0, 20.0), loaded=TrainPlan(172, 0.25, 20.0))
    for octets, rate_hz in ((32, 1.0), (32, 4.0), (512, 10.0)):
        bench.stage(**{f"telemetry_{octets}_{rate_hz:g}": telemetry_plan(octets, rate_hz, 20.0)})
    for image, rate_hz in ((SMALL, 0.2), (SMALL, 1.0), (LARGE, 0.2), (LARGE, 2.0)):
        bench.messages(f"image {image.label} {rate_hz:g}", image_plan(image, rate_hz, 20.0))
    single = bench.messages("rate 1440 0", MessagePlan(1440, 0.2, 20.0))
    assert single.latency is not None
    sustained_rate(
        1440,
        lambda rate: bench.messages(f"rate 1440 {rate:g}", MessagePlan(1440, rate, 10.0)),
        idle_latency_s=single.latency.p50,
        idle_loss=0.0,
    )
    return bench.text


def put_run(folder: Path, run_: MeasuredRun | None = None, text: str | None = None) -> Path:
    """Write a run as the command writes it, in a folder of its name."""
    made = run_ or measured_run()
    place = folder / made.id
    place.mkdir(parents=True)
    (place / SAMPLES_FILE).write_text(samples_text() if text is None else text, encoding="utf-8")
    write_run(place, made)
    return place
