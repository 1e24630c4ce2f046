"""A real record of a real site: paid for first, kept beside the other records, and honest about who did not answer."""

from pathlib import Path

import pytest
from quay import ROUTER, Quay, fresh_quay

pytestmark = [pytest.mark.slow, pytest.mark.namespace]

HERE = ("report", "as-built", "site=coastal", f"device={ROUTER}")
at = pytest.fixture(fresh_quay)


def test_metered_link_needs_consent_before_anything_is_sent(at: Quay) -> None:
    done = at.provision(*HERE, "via=satellite", code=4)
    assert "the cost was not accepted, so nothing was sent: over metered link satellite of coastal" in done.stderr
    assert int(at.do("counters")["connections"]) == 0
    assert not list(at.state.glob("real/coastal/asbuilt/*"))
    paid = at.json(*HERE, "via=satellite", "--accept-cost", code=0)
    assert " EUR" in paid["costs"]["satellite"]
    assert int(at.do("counters")["connections"]) == 1
    assert paid["spent"][ROUTER]["round_trips"] == 5


@pytest.mark.smoke
def test_replaced_or_unreachable_device_is_reported(at: Quay) -> None:
    at.configure()
    first = at.json(*HERE, code=0)
    assert (first["rehearsed"], first["since"]) == (False, None)
    assert Path(first["kept"]).parent == at.state / "real" / "coastal" / "asbuilt"
    (router,) = (device for device in first["devices"] if device["name"] == ROUTER)
    assert router["facts"]["confirmed"]["origin"] == "stored"
    at.replace("spare")
    stranger = at.provision(*HERE, code=6).stdout
    assert f"{ROUTER}: router, NOT REACHED" in stranger
    assert "its last known values, read on" in stranger
    assert "SPARE" not in stranger
    at.adopt()
    adopted = at.provision(*HERE, code=0).stdout
    serial = router["facts"]["serial"]["value"]
    assert f"{ROUTER}: serial number changed from {serial} to SPARE" in adopted
    assert f"{ROUTER}: TLS certificate changed from" in adopted
