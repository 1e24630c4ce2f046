"""Which address a member gets."""

from __future__ import annotations

from ipaddress import IPv4Address, IPv4Network
from typing import TYPE_CHECKING

import pytest
from authority_stand import stand, wish

from atlantis_netcfg.vpn.authority.model import AddressTaken, PoolFull

if TYPE_CHECKING:
    from pathlib import Path

FOUR = IPv4Network("10.8.16.0/29")


def test_the_ends_of_a_pool_are_nobody_s(tmp_path: Path) -> None:
    made = stand(tmp_path)
    with made.signing() as signer:
        issued = signer.issue([wish(f"d{number}", pool=FOUR) for number in range(6)], made.deliver)
        assert [str(one.member.address) for one in issued] == [f"10.8.16.{number}" for number in range(1, 7)]
        with pytest.raises(PoolFull, match=r"no address is left for `iqua-d6` in 10.8.16.0/29"):
            signer.issue([wish("d6", pool=FOUR)], made.deliver)
        for end in ("10.8.16.0", "10.8.16.7", "10.8.16.8"):
            with pytest.raises(AddressTaken, match="is no device's address of"):
                signer.issue([wish("d6", pool=FOUR, address=IPv4Address(end))], made.deliver)


def test_reserved_and_declared_addresses_are_not_given_away(tmp_path: Path) -> None:
    made = stand(tmp_path)
    declared = wish("c", pool=FOUR, address=IPv4Address("10.8.16.2"))
    with made.signing() as signer:
        issued = signer.issue(
            [wish("a", pool=FOUR), wish("b", pool=FOUR), declared], made.deliver, reserved=[IPv4Address("10.8.16.1")]
        )
        assert [str(one.member.address) for one in issued] == ["10.8.16.3", "10.8.16.4", "10.8.16.2"]
        with pytest.raises(AddressTaken, match=r"10.8.16.3 of `iqua-d` is in use by `iqua-a`"):
            signer.issue([wish("d", address=IPv4Address("10.8.16.3"))], made.deliver)
        twice = [wish(name, address=IPv4Address("10.8.16.6")) for name in ("d", "e")]
        with pytest.raises(AddressTaken, match=r"10.8.16.6 of `iqua-e` is in use by `iqua-d`"):
            signer.issue(twice, made.deliver)
    assert len(made.identities) == 3


def test_an_address_rests_until_the_pool_is_used_up_and_the_server_has_confirmed(tmp_path: Path) -> None:
    made = stand(tmp_path)
    pool = IPv4Network("10.8.16.0/30")
    with made.signing() as signer:
        signer.issue([wish("a", pool=pool)], made.deliver)
        signer.revoke(["iqua-a"], "lost")
        assert str(signer.issue([wish("b", pool=pool)], made.deliver)[0].member.address) == "10.8.16.2"
        with pytest.raises(PoolFull):
            signer.issue([wish("c", pool=pool)], made.deliver)
        with pytest.raises(AddressTaken, match="in use by `iqua-a`"):
            signer.issue([wish("c", address=IPv4Address("10.8.16.1"))], made.deliver)
    made.authority.settled(["iqua-a"])
    with made.signing() as signer:
        assert str(signer.issue([wish("c", pool=pool)], made.deliver)[0].member.address) == "10.8.16.1"
        with pytest.raises(PoolFull):
            signer.issue([wish("d", pool=pool)], made.deliver)


@pytest.mark.parametrize(("pool", "count"), [("10.8.16.4/31", 2), ("10.8.16.4/32", 1)])
def test_pools_too_small_to_have_ends(pool: str, count: int, tmp_path: Path) -> None:
    made = stand(tmp_path)
    with made.signing() as signer:
        wishes = [wish(f"d{number}", pool=IPv4Network(pool)) for number in range(count)]
        issued = signer.issue(wishes, made.deliver)
        assert str(issued[0].member.address) == "10.8.16.4"
        with pytest.raises(PoolFull):
            signer.issue([wish("more", pool=IPv4Network(pool))], made.deliver)
