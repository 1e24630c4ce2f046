"""Recordings over a real rsync and sshd: cut, resumed, mended, within rate and cap, and nothing else admitted."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest
from gateway_stand import ground, machine, technician  # noqa: F401 - fixtures
from retrieval_stand import FOLDER, KEPT, MB, Ends, ends

if TYPE_CHECKING:
    from gateway_stand import Start

    from atlantis_netcfg.emulator.lab import Lab

pytestmark = [pytest.mark.slow, pytest.mark.namespace, pytest.mark.timeout(300)]


@pytest.fixture
def pair(ground: Lab, machine: Start) -> Ends:  # noqa: F811 - fixtures
    return ends(ground, machine)


def test_a_transfer_is_whole_survives_a_cut_and_is_not_sent_again(pair: Ends) -> None:
    pair.record("bag-1/a.db3", 4 * MB)
    pair.record("bag-1/metadata.yaml", 400)
    pair.record("bag-2/writing.db3", 1000, age_s=1)
    before = pair.digests(pair.gateway, FOLDER)
    start = pair.sent()
    look = pair.start(rate_bps=8 * MB)
    assert (look["files"], look["bytes"], look["writing"]) == (2, 4 * MB + 400, 1)
    pair.until(lambda told: told["wire_bytes"] > 1.5 * MB)
    pair.cut()
    pair.until(lambda told: told["state"] == "waiting")
    pair.cut(up=True)
    told = pair.ended()
    assert (told["state"], told["arrived"]) == ("done", 2), told
    assert told["tries"] >= 1
    sent = pair.sent() - start
    assert 4 * MB < sent < 4 * MB * 1.25, "what had arrived was not sent again"
    assert sent <= told["wire_bytes"] * 1.05, "what is told is not less than what the interface has counted"
    there = pair.digests(pair.centre, KEPT)
    assert there == {name: digest for name, digest in before.items() if not name.startswith("bag-2")}
    assert pair.digests(pair.gateway, FOLDER) == before, "nothing is removed or changed at the source"
    assert pair.ask("look", pattern="*", again=False)["kept"] == 2
