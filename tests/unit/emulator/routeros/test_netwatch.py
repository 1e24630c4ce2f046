"""Netwatch, check-gateway and scripts of netwatch, on a clock turned by hand (`network/failover.py`)."""

import pytest
from twin_bench import Bench, make

HOST = "10.10.0.1"
LINK = "/ip address add address=10.10.0.2/24 interface=ether1\n"


def watched(row: str, **spec: str) -> Bench:
    router = make(**spec)
    router.script(LINK + f"/tool netwatch add name=w host={HOST} {row}")
    return router


def wait(router: Bench, seconds: float) -> None:
    router.now += seconds
    router.device.tick()


def status(router: Bench, name: str = "status") -> str | None:
    return router.value("/tool/netwatch", name, "?name=w")


def logged(router: Bench) -> list[str]:
    rows = router.device.run(router.caller, ["/log/print"])
    return [word.removeprefix("=message=") for row in rows for word in row.words if word.startswith("=message=say ")]


SAYS = ' up-script="/log info message=\\"say up\\"" down-script="/log info message=\\"say down\\""'


def test_simple_probe_changes_with_each_reply_and_runs_scripts_once() -> None:
    router = watched("interval=5s timeout=1s type=simple" + SAYS)
    wait(router, 2.9)
    assert status(router) == "unknown"
    wait(router, 0.2)
    assert status(router) == "up"
    router.device.silence([HOST])
    wait(router, 5.5)
    assert status(router) == "up"
    wait(router, 0.6)
    assert status(router) == "down"
    router.device.silence([])
    wait(router, 60)
    assert (status(router), status(router, "failed-tests")) == ("up", "1")
    assert logged(router) == ["say up", "say down", "say up"]


def test_icmp_probe_counts_packets_and_passes_them_to_the_script() -> None:
    router = watched(
        "interval=30s packet-count=4 packet-interval=5s timeout=1s type=icmp"
        ' test-script=":if (\\$\\"response-count\\" = 2)'
        ' do={/log info message=\\"say half\\"} else={/log info message=\\"say else\\"}"'
    )
    wait(router, 3 + 5.1)
    router.device.silence([HOST])
    wait(router, 11)
    assert (status(router), status(router, "response-count"), status(router, "loss-count")) == ("up", "2", "2")
    assert logged(router) == ["say half"]
    wait(router, 30)
    assert (status(router), status(router, "response-count")) == ("down", "0")
    assert logged(router) == ["say half", "say else"]


def test_overdue_probes_are_all_counted() -> None:
    router = watched("interval=5s timeout=1s type=simple")
    wait(router, 3 + 100)
    assert status(router, "done-tests") == "21"


def test_setting_or_enabling_a_row_restarts_it() -> None:
    router = watched("interval=5s type=simple" + SAYS)
    wait(router, 10)
    router.script("/tool netwatch disable [find name=w]")
    assert status(router) == "unknown"
    wait(router, 60)
    router.script("/tool netwatch enable [find name=w]")
    assert status(router) == "unknown"
    wait(router, 3.1)
    assert status(router) == "up"
    router.script("/tool netwatch set [find name=w] interval=6s")
    assert status(router) == "unknown"
    wait(router, 3.1)
    assert logged(router) == ["say up"] * 3


def test_startup_delay_applies_after_a_reboot() -> None:
    router = watched("interval=5s startup-delay=30s type=simple")
    wait(router, 10)
    router.device.reboot()
    router.caller = router.session()
    wait(router, 32)
    assert status(router) == "unknown"
    wait(router, 2)
    assert status(router) == "up"


def test_initial_up_can_be_ignored() -> None:
    router = watched("interval=5s type=simple ignore-initial-up=yes" + SAYS)
    wait(router, 10)
    assert (status(router), logged(router)) == ("up", [])
    router.device.silence([HOST])
    wait(router, 10)
    assert logged(router) == ["say down"]


def test_a_script_may_read_and_write_and_no_more() -> None:
    router = watched('interval=5s type=simple up-script="/user add name=x group=full"')
    wait(router, 10)
    assert router.count("/user") == len(make().spec.users) + 1
    messages = [line for row in router.say("/log/print") for line in [row] if "not enough permissions" in line]
    assert len(messages) == 1


def test_missing_route_counts_as_no_reply() -> None:
    router = watched("interval=5s timeout=1s type=simple")
    wait(router, 10)
    router.script("/interface ethernet disable ether1")
    wait(router, 10)
    assert status(router) == "down"


CHECKED = (
    LINK
    + "/ip route add gateway=10.10.0.1 check-gateway={check} comment=r\n"
    + "/ip route add gateway=10.10.0.1 dst-address=10.9.0.0/16 comment=also"
)


def active(router: Bench, comment: str = "r") -> bool:
    return router.value("/ip/route", "active", f"?comment={comment}") == "true"


@pytest.mark.parametrize("check", ["ping", "arp"])
def test_check_gateway_drops_a_next_hop_after_two_failures(check: str) -> None:
    router = make()
    router.script(CHECKED.format(check=check))
    wait(router, 1)
    router.device.silence([HOST])
    wait(router, 19)
    assert active(router)
    wait(router, 2)
    assert not active(router)
    assert not active(router, "also")
    router.device.silence([])
    wait(router, 10)
    assert active(router)
    assert active(router, "also")


def test_single_failure_is_reset_by_the_next_reply() -> None:
    router = make()
    router.script(CHECKED.format(check="ping"))
    for _ in range(5):
        router.device.silence([HOST])
        wait(router, 10)
        router.device.silence([])
        wait(router, 10)
        assert active(router)


def test_check_gateway_settings_exist_from_7_21() -> None:
    router = make(version="7.21.5")
    router.script(CHECKED.format(check="ping") + "\n/routing settings set check-gateway-ping-interval=30s")
    router.script("/routing settings set check-gateway-ping-count=3")
    wait(router, 1)
    router.device.silence([HOST])
    wait(router, 85)
    assert active(router)
    wait(router, 10)
    assert not active(router)


def test_routes_without_check_gateway_stay_active() -> None:
    router = make()
    router.script(CHECKED.format(check="none"))
    router.device.silence([HOST])
    wait(router, 300)
    assert active(router)
