"""What the checks of a site advise is typed as it stands, beside whatever is broken."""

from collections.abc import Callable
from datetime import timedelta
from typing import Any

import pytest
from hints_said import advised, said
from own_broken import BROKEN
from own_world import NOW, World, own_steps
from test_hints_of_vpn import GATEWAY, ROUTER, Laptop, laptop

from atlantis_netcfg.core.errors import ExitCode, NetcfgError
from atlantis_netcfg.emulator.routeros.spec import Validity
from atlantis_netcfg.inventory import Host
from atlantis_netcfg.operations.vpn.router import InstalledIdentity
from atlantis_netcfg.routeros.apply import Status

pytestmark = pytest.mark.slow

__all__ = ["laptop"]
RENEWED = (
    "`provision vpn renew name={name}` creates a new one, and `provision vpn install device={name}` installs "
    "it on the router"
)
ACCEPTED = (
    "`provision vpn renew name={name}` creates a new one, `provision vpn accept file=FILE` accepts it on "
    "another laptop, and `provision site={site} device={name}` installs it"
)


class NothingBehindIt(NetcfgError):
    """No device stands behind an address here."""

    exit = ExitCode.NOTHING


@pytest.fixture
def reached(laptop: Laptop) -> list[str]:
    """The devices that a command would have asked or changed."""
    names: list[str] = []

    def look(opened: Any) -> None:  # noqa: ANN401 - a session
        names.extend(host.name for host in opened.hosts)
        raise NothingBehindIt(f"{opened.site} is asked")

    def install(_declaration: object, host: Host, *_: object, **__: object) -> InstalledIdentity:
        names.append(host.name)
        return InstalledIdentity(host.name, Status.UNCHANGED, ExitCode.DONE, "unchanged")

    def adoption(_arguments: object, _declaration: object, host: Host, *_: object) -> None:
        names.append(host.name)
        raise NothingBehindIt(f"{host.name} is looked for")

    laptop.monkeypatch.setattr("atlantis_netcfg.cli.links.read_links", look)
    laptop.monkeypatch.setattr("atlantis_netcfg.operations.vpn.router.install", install)
    laptop.monkeypatch.setattr("atlantis_netcfg.cli.adopt._adoption", adoption)
    laptop.type(*ROUTER)
    laptop.type(*GATEWAY)
    return names


def hints(world: World) -> str:
    """All that the checks advise there."""
    found = [world.judged(step) for step in own_steps() if not step.unless]
    if world.script:
        assert world.device.run(world.caller, ["/safe-mode/unroll"])[-1].kind == "!done"
    return "\n".join(one.hint for judged in found for one in judged.findings if one.hint)


def telling(code: str) -> World:
    """The first of the broken sites of which that is told."""
    for broken in BROKEN.values():
        if any(line.split(" ")[1].rstrip(":") == code for lines in broken().findings().values() for line in lines):
            return broken()
    raise AssertionError(code)


def expiring() -> World:
    soon = Validity(since=NOW - timedelta(days=300), until=NOW + timedelta(days=9))
    world = World()
    return World(around={**world.around, "validity": {**world.around["validity"], "atlantis-vpn": soon}})


def identity_expiring() -> World:
    pc = World().pc
    soon = {"not_before": NOW - timedelta(days=300), "not_after": NOW + timedelta(days=9)}
    certificates = {path: tuple(one.model_copy(update=soon) for one in held) for path, held in pc.certificates.items()}
    return World(pc=pc.model_copy(update={"certificates": certificates}))


LINKS = ["coastal-router", "coastal-cpe", "coastal-4g", "coastal-sat", "coastal-gateway"]
SITUATIONS: dict[str, tuple[Callable[[], World], str, int, list[str]]] = {
    "clock": (
        lambda: telling("not-synchronised"),
        (
            "check that {} can reach the time servers of the inventory; `provision links site={}` shows whether any "
            "link is up"
        ),
        7,
        LINKS,
    ),
    "a better link": (
        lambda: telling("better-unknown"),
        "check `provision links site={}` when the devices respond again",
        7,
        LINKS,
    ),
    "no link": (
        lambda: telling("no-default-route"),
        (
            "check with `provision links site={}` that a link is up; then apply the site's configuration, which "
            "restores its routes"
        ),
        7,
        LINKS,
    ),
    "lossy": (lambda: telling("server-lossy"), "check `provision links site={}`", 7, LINKS),
    "data lost": (BROKEN["a message is lost"], "check `provision links site={}`", 7, LINKS),
    "another computer": (
        BROKEN["another computer has the control centre's address"],
        "each VPN address belongs to one member: `provision vpn status` shows who has it",
        0,
        [],
    ),
    "factory name": (
        lambda: telling("factory-name"),
        "`provision device adopt site={} device=NAME` gives a new device its name, user and certificate",
        7,
        ["coastal-router"],
    ),
    "no tunnel": (
        lambda: telling("router-no-tunnel"),
        "`provision vpn install device={}`, then `provision site={}`",
        0,
        ["coastal-router"],
    ),
    "tunnel down": (
        lambda: telling("router-tunnel-down"),
        "`provision vpn status` shows whether its identity is known; check its log for the server's reason",
        0,
        [],
    ),
    "another address": (
        lambda: telling("router-tunnel-address"),
        "`provision vpn sync` makes the server assign each member its address",
        0,
        [],
    ),
    "silent": (
        lambda: telling("server-silent"),
        "check whether the VPN server is running: `provision vpn status` queries it",
        0,
        [],
    ),
    "no identity": (
        lambda: telling("identity-unreadable"),
        "`provision site={} device={}` installs it; only root may read it",
        0,
        [],
    ),
    "a certificate of the router": (expiring, RENEWED, 0, ["coastal-router"]),
    "an identity of the gateway": (identity_expiring, ACCEPTED, 0, []),
}


@pytest.mark.smoke("clock", "silent")
@pytest.mark.parametrize("name", SITUATIONS)
def test_advised_commands_work_when_typed(name: str, laptop: Laptop, reached: list[str]) -> None:
    world, hint, code, devices = SITUATIONS[name]
    commands = advised(said(hints(world()), hint))
    assert commands
    for words in commands:
        laptop.follow([word.replace("NAME", "coastal-router") for word in words], code)
    assert reached == devices
    if any(words[-1] == "device=coastal-gateway" for words in commands):
        assert laptop.plays == [(["coastal-gateway"], True)]
