"""The highest rate that `provision measure link` says, against links of known rate that lose packets at random."""

from dataclasses import dataclass, replace
from pathlib import Path

import pytest
from example_runs import measured_run
from simulated_network import KEY, network, unlimited

from atlantis_netcfg.emulator.udp_link import HEADERS, LinkShape
from atlantis_netcfg.inventory import load
from atlantis_netcfg.links.qualify.measured_run import Selection
from atlantis_netcfg.links.qualify.record import make_record
from atlantis_netcfg.links.qualify.samples import Sample
from atlantis_netcfg.links.qualify.search import SustainedRate
from atlantis_netcfg.links.qualify.session import ReflectorPeer
from atlantis_netcfg.operations.qualify.measure import CountedTransport, Measurement
from atlantis_netcfg.operations.qualify.plan import build_plan

BEARERS = {bearer.name: bearer for bearer in load(Path(__file__).parents[4] / "inventory").sites["coastal"].bearers}


@dataclass(frozen=True)
class Trial:
    """A search over a link; its queue takes a message whole, and more than the band of the latency."""

    size: int
    bearer: str
    """Whose plan it is."""
    rate_bps: float
    delay_s: float
    loss: float = 0.0
    seed: int = 0
    declared: float = 1.0
    """Of the true rate: where the search begins."""

    @property
    def carries_hz(self) -> float:
        return self.rate_bps / 8 / (self.size + -(-self.size // 1048) * (1200 - 1048 + HEADERS))

    def search(self) -> SustainedRate:
        """Measure as the command does: round trips without load, single messages, then rates."""
        up = LinkShape(self.rate_bps, self.delay_s, 0.01, self.loss, queue_bytes=256_000)
        net, samples = network(up, replace(up, rate_bps=2 * self.rate_bps), 10 * self.seed), list[Sample]()
        declared = BEARERS[self.bearer]
        rate = declared.rate.model_copy(update={"up_kbps": round(self.declared * self.rate_bps / 1000)})
        plan = build_plan(declared.model_copy(update={"rate": rate}), Selection.TELEMETRY)
        measured = Measurement(plan, ReflectorPeer(KEY), CountedTransport(net), unlimited(net), samples.append)
        measured._measure_idle()
        measured._search_rate(self.size)
        (found,) = measured.rates
        (again,) = make_record(measured_run(), samples).highest_rates
        assert again.rate_hz == (None if found.rate_hz is None else pytest.approx(found.rate_hz, rel=1e-4))
        assert again.limited_by is found.limited_by
        return found


LINKS = (
    Trial(200, "satellite", 100_000, 0.35),
    Trial(6_000, "satellite", 352_000, 0.35),
    Trial(20_000, "4g", 600_000, 0.0275),
    Trial(60_000, "4g", 1_000_000, 0.0275),
)


@pytest.mark.smoke("200-0.0", "200-0.01")
@pytest.mark.parametrize("loss", [0.0, 0.01, 0.03])
@pytest.mark.parametrize("link", LINKS, ids=[str(link.size) for link in LINKS])
def test_the_highest_rate_is_within_a_tenth_of_the_truth(link: Trial, loss: float) -> None:
    found = replace(link, loss=loss).search()
    assert found.is_proved, found
    assert found.rate_hz == pytest.approx(link.carries_hz, rel=0.1)


TRIALS = [replace(LINKS[n % 4], loss=n % 7 * 0.005, seed=n, declared=0.6 + n % 11 / 10) for n in range(200)]
"""All sizes, 0 to 3 % loss, declared rates of 0.6 to 1.6 of the true one; seeds are their numbers."""


def test_the_highest_rate_is_within_a_tenth_in_a_sample_of_the_trials() -> None:
    assert [trial for trial in TRIALS[::19] if not is_near(trial.search(), trial.carries_hz)] == []


@pytest.mark.campaign
def test_the_highest_rate_is_within_a_tenth_in_95_of_100_trials() -> None:
    misses = [trial for trial in TRIALS if not is_near(trial.search(), trial.carries_hz)]
    assert len(misses) <= 0.05 * len(TRIALS), misses


def is_near(found: SustainedRate, truth_hz: float) -> bool:
    return found.rate_hz is not None and abs(found.rate_hz - truth_hz) <= 0.1 * truth_hz
