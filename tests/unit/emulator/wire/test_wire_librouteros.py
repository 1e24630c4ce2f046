"""A client that we did not write, on real sockets and in real time."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import librouteros
import pytest
from librouteros.exceptions import FatalError, TrapError
from wire_helpers import PASSWORD, router_spec, trusting

from atlantis_netcfg.emulator.routeros import ControlError, EmulatorSpec, RunningSite, SiteSpec


@pytest.fixture
def site(tmp_path: Path) -> Iterator[RunningSite]:
    old = router_spec(version="7.16").model_copy(update={"name": "old"})
    spec = SiteSpec(name="coastal", emulators=(EmulatorSpec(router=router_spec()), EmulatorSpec(router=old)))
    with RunningSite(spec, tmp_path) as running:
        yield running


def connect(site: RunningSite, name: str = "router", *, password: str = PASSWORD, tls: bool = False) -> Any:  # noqa: ANN401
    where = site.ready[name]
    return librouteros.connect(
        where["host"],
        "provision",
        password,
        port=where["api_ssl" if tls else "api"],
        encoding="utf-8",
        ssl_wrapper=trusting().wrap_socket if tls else None,
    )


@pytest.mark.parametrize("tls", [False, True])
@pytest.mark.parametrize("name", ["router", "old"])
def test_login_add_print_and_a_trap(site: RunningSite, name: str, *, tls: bool) -> None:
    api = connect(site, name, tls=tls)
    pools = api.path("ip", "pool")
    number = pools.add(name="p", ranges="10.0.0.2-10.0.0.9")
    assert number.startswith("*")
    assert [pool["name"] for pool in pools] == ["p"]
    with pytest.raises(TrapError, match="pool with such name exists"):
        pools.add(name="p", ranges="10.0.1.2-10.0.1.9")
    pools.remove(number)
    assert [row for row in pools if row] == []
    assert site.do(name, "counters")["logins"] == 1
    api.close()


def test_wrong_password(site: RunningSite) -> None:
    with pytest.raises(TrapError, match="invalid user name or password"):
        connect(site, password="guess")


def test_rawcmd_quit_is_fatal(site: RunningSite) -> None:
    with pytest.raises(FatalError, match="session terminated on request"):
        tuple(connect(site).rawCmd("/quit"))


def test_control_commands_reach_the_emulator(site: RunningSite) -> None:
    assert site.ready["router"] == site.do("router", "info")
    assert site.do("router", "console", words=["/ip/pool/add", "=name=c", "=ranges=10.0.0.2-10.0.0.9"])[0][0] == "!done"
    assert "name=c" in site.do("router", "export", menu="/ip/pool")
    assert "name=c" not in site.do("old", "export")
    site.do("router", "arm", fault={"do": "drop", "match": "/login"})
    with pytest.raises((ConnectionResetError, librouteros.exceptions.ConnectionClosed)):
        connect(site)


@pytest.mark.parametrize(
    ("twin", "do", "arguments", "words"),
    [
        ("routr", "gap", {"seconds": 1}, "no twin is called 'routr'"),
        ("router", "explode", {}, "twins do not know 'explode'"),
        ("router", "gap", {}, "missing a required argument: 'seconds'"),
        ("router", "link", {"delay": 1}, "Extra inputs are not permitted"),
        ("router", "console", {"words": ["/quit"], "user": "nobody"}, "router has no user 'nobody'"),
        ("router", "arm", {"fault": {"do": "sulk"}}, "Input should be"),
    ],
)
def test_unknown_control_commands_are_refused(
    site: RunningSite, twin: str, do: str, arguments: dict[str, Any], words: str
) -> None:
    with pytest.raises(ControlError, match=words):
        site.do(twin, do, **arguments)
