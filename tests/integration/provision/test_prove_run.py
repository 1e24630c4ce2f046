"""`provision prove` against a router that stands at its declared address: consent, pins, and what is left behind."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from quay import Quay, quay

pytestmark = [pytest.mark.slow, pytest.mark.namespace]

STRANGER = "10.99.3.3"
"""The target that coastal declares as one to be refused, as the quay spells it."""


@pytest.fixture
def at(tmp_path: Path) -> Iterator[Quay]:
    """The quay with a router beyond whose satellite the stranger does answer, configured."""
    with quay(tmp_path) as opened:
        (twin,) = opened.spec.twins
        opened.replace("beyond", neighbours=(*twin.router.neighbours, STRANGER))
        opened.adopt()
        opened.configure()
        yield opened


@pytest.mark.smoke
def test_nothing_is_sent_before_somebody_pays_and_nothing_is_left_behind(at: Quay) -> None:
    before = at.export()
    refused = at.provision("prove", "site=coastal", "bearer=satellite", code=4)
    assert "nobody has agreed to pay for this, so nothing was sent: over satellite of coastal" in refused.stderr
    told = at.json("prove", "site=coastal", "--accept-cost", code=6)
    found = {row["target"]: (row["outcome"], row["verdict"]) for row in told["targets"]}
    assert found[STRANGER] == ("refused here", "PASS")
    assert (told["rehearsed"], told["not_rehearsed"]) == (False, [])
    # No resolver answers in the quay's network: the VPN's name is not taken for good.
    names = [one for one in told["findings"] if one["code"].startswith("allow-list-name-")]
    assert [one["verdict"] in ("INCONCLUSIVE", "WARN") for one in names] == [True]

    opened = at.json("prove", "site=coastal", "--open-filter", "--accept-cost", code=6)
    seen = {row["target"]: row["code"] for row in opened["targets"] if row["filter_open"]}
    assert seen == {STRANGER: "only-the-router-enforces"}
    assert 0 < opened["bytes_counted"] < opened["budget_bytes"]
    assert opened["cost"]["payload_bytes"] == opened["bytes_counted"]
    dear = at.provision("prove", "site=coastal", "via=4g", code=4)
    assert "nobody has agreed to pay for this, so nothing was sent: over 4g" in dear.stderr
    assert at.export().splitlines() == before.splitlines()
