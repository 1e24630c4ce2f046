"""`provision site=S --rehearse --profile RUN`: the emulated devices are behind the link that a run has measured."""

import json
import os
from pathlib import Path

import preforked
import pytest

from atlantis_netcfg.links.qualify.profile import DirectionProfile, LinkProfile, write_profile

_RUN = "4g-20261126T022248Z"
_ONE_WAY_S = 0.4
"""Ten times what te4sea's 4G is declared to take."""


@pytest.mark.slow
def test_rehearsal_uses_the_measured_link_and_says_so(tmp_path: Path) -> None:
    way = DirectionProfile(
        delays_s=(_ONE_WAY_S,), loss=0.0, duplicates=0.0, reordered=0.0, reorder_s=0.0, rate_bps=None, mtu=None
    )
    profile = LinkProfile(
        run=_RUN, site="te4sea", link="4g", kind="lte", emulated=False, recorded_s=60, interval_s=0.25,
        packet_octets=200, packets=240, split="", up=way, down=way, gaps=(),
    )  # fmt: skip
    kept = tmp_path / "real" / "te4sea" / "qualify" / _RUN
    kept.mkdir(parents=True)
    write_profile(kept, profile)
    typed = ("site=te4sea", "device=te4sea-router", "--rehearse", "--yes", "--profile", _RUN)
    environment = {**os.environ, "ATLANTIS_STATE": str(tmp_path)}
    done = preforked.run((*typed, "--json"), env=environment)
    assert done.returncode == 0, done.stderr
    router = json.loads(done.stdout)["devices"]["te4sea-router"]
    assert router["second_pass"] == 0
    seconds = {name: again["seconds"] for name, again in router["bearers"].items()}
    assert router["bearers"]["4g"]["round_trips"] == 5
    assert seconds["4g"] >= 5 * 2 * _ONE_WAY_S
    assert seconds["lan"] < 2 * _ONE_WAY_S, "the others are as in the inventory"
    assert router["not_rehearsed"][0] == f"link 4g in its current state: this was a replay of run {_RUN}"
