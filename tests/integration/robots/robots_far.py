"""Robots at a site, and who listens to them from elsewhere, as programs for network namespaces; in domain 9.

robots_far.py honest|liars|foreign ADDRESS                 until it is ended
robots_far.py discover SECONDS ADDRESS                     prints each robot's findings, and the exit code
robots_far.py watch ADDRESS                                prints `SECONDS NAMESPACE` for each configuration
"""

import json
import sys
import time
from dataclasses import replace

import liars

from atlantis_netcfg.inventory import Inventory, load
from atlantis_netcfg.inventory.model import DdsPath
from atlantis_netcfg.inventory.robots.key_names import KeyNames
from atlantis_netcfg.operations import robots
from atlantis_netcfg.robots.mock import MockRobot
from atlantis_netcfg.robots.network import Publisher, RobotListener, domain, profile
from atlantis_netcfg.robots.observation import judge

FOREIGN = 7
NAMES = ("missing_topic", "wrong_type", "seldom", "often", "stranger", "twice", "twice")
"""Robots that lie, by their namespaces; `away` is declared, and is not there."""
_PARTICIPANTS = 10


def declared() -> Inventory:
    """The shipped pilot, whose DDS goes between the LANs of the sites."""
    shipped = load(liars.SHIPPED)
    assert shipped.pilot.dds is not None
    dds = shipped.pilot.dds.model_copy(update={"over": DdsPath.LAN, "domain": liars.DOMAIN})
    return replace(shipped, pilot=shipped.pilot.model_copy(update={"dds": dds}))


def publish(what: str, address: str) -> None:
    number = FOREIGN if what == "foreign" else liars.DOMAIN
    with domain(number, profile(address, robots.computers_of(declared(), ["coastal"]), _PARTICIPANTS)):
        mocks = _liars() if what == "liars" else _honest(number)
        sys.stdout.write(f"{len(mocks)} robots\n")
        sys.stdout.flush()
        while True:
            next_s = min(each.step(time.monotonic()) for each in mocks)
            time.sleep(min(0.1, max(0.0, next_s - time.monotonic())))


def _liars() -> list[MockRobot]:
    return [liars.robot(name, liars.TEXT.replace("namespace: sparus", f"namespace: {name}")) for name in NAMES]


def _honest(number: int) -> list[MockRobot]:
    sources, names = robots.robots_of(declared())
    return [
        MockRobot(
            each.robot,
            each.text(),
            41.68,
            -8.83,
            liars.TYPES,
            Publisher(number, liars.TYPES),
            names.configuration_topic,
        )
        for each in sources
        if each.robot is not None
    ]


def discover(seconds: float, address: str) -> None:
    declaration = declared()
    sources, names = robots.robots_of(declaration)
    expected = [each.vehicle for each in sources if each.vehicle is not None]
    for name in {*NAMES, "away"} - {"stranger"}:
        sources.append(liars.source(name, liars.TEXT.replace("namespace: sparus", f"namespace: {name}")))
    with domain(liars.DOMAIN, _profile(declaration, address)):
        topic = names.configuration_topic
        observation = RobotListener(liars.DOMAIN, liars.TYPES, topic, address).listen(seconds)
    reports = judge(observation, sources, [*expected, "away"], names)
    found = {each.namespace: [each.state.value, *sorted({one.code for one in each.findings})] for each in reports}
    others = observation.other_domains
    sys.stdout.write(json.dumps({"robots": found, "exit": robots.ending(reports, observation), "others": others}))


def watch(address: str) -> None:
    """Tell each configuration that comes, by the clock that all namespaces share."""
    with domain(liars.DOMAIN, _profile(declared(), address)):
        listener = RobotListener(liars.DOMAIN, liars.TYPES, KeyNames().configuration_topic)
        counts: dict[str, int] = {}
        sys.stdout.write(f"{time.monotonic():.2f} listening\n")
        while True:
            for each in listener.listen(0.1).configurations:
                name, key = each.text.decode().partition("namespace: ")[2].split()[0], each.writer.participant
                if each.writer.messages > counts.get(key, 0):
                    sys.stdout.write(f"{each.writer.last_s:.2f} {name}\n")
                counts[key] = each.writer.messages
            sys.stdout.flush()


def _profile(declaration: Inventory, address: str) -> str:
    return profile(address, robots.peers_of(declaration, ["coastal"]), _PARTICIPANTS)


if __name__ == "__main__":
    if sys.argv[1] == "discover":
        discover(float(sys.argv[2]), sys.argv[3])
    elif sys.argv[1] == "watch":
        watch(sys.argv[2])
    else:
        publish(*sys.argv[1:3])
