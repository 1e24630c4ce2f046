"""`provision robot`: robots' configuration files, robots detected on the network, and mock robots."""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.cli.base import syntax
from atlantis_netcfg.cli.base.output import json_text
from atlantis_netcfg.core.errors import ExitCode
from atlantis_netcfg.core.language import translate
from atlantis_netcfg.core.messages import arg, join, msg

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from atlantis_netcfg.inventory import Finding, Inventory
    from atlantis_netcfg.inventory.robots.key_names import KeyNames
    from atlantis_netcfg.inventory.robots.reading import RobotSource
    from atlantis_netcfg.operations.robots import MockPlace
    from atlantis_netcfg.robots.mock import MockRobot
    from atlantis_netcfg.robots.observation import RobotObservation, RobotReport
    from atlantis_netcfg.robots.recording import BagRecorder
    from atlantis_netcfg.robots.replay import Bag, BagPlayer

ROBOT_VALIDATE = syntax.CommandSpec(
    "robot validate",
    "check the configuration files of robots",
    words=(
        syntax.Word("file", "robot files as received from the partner (one or several)", many=True, bare=True),
        syntax.Word("vehicle", "only the file of this vehicle, in robots/ of the inventory", example="sparus"),
        syntax.INVENTORY,
    ),
    flags=(syntax.JSON,),
    details=(
        "No robot is contacted. Without a file and a vehicle, every file in robots/ of the inventory is checked. "
        "Exit code 0: no errors; 3: errors found; 7: no file found. What a robot actually publishes is not checked."
    ),
)
_DAY_S = 86_400


def run_robot_validate(arguments: syntax.Arguments) -> ExitCode:
    """Run `robot validate`: print the content of each robot's file, or list every error."""
    from atlantis_netcfg.inventory import InventoryInvalid
    from atlantis_netcfg.inventory.robots.reading import NO_ROBOT_CONTACTED, key_names

    inventory = _inventory(arguments)
    names, findings = key_names(inventory)
    sources = _sources(arguments, inventory, names)
    findings += [finding for source in sources for finding in source.findings]
    if findings and not arguments.flag("json"):
        raise InventoryInvalid(findings, NO_ROBOT_CONTACTED)
    code = ExitCode.USAGE if findings else ExitCode.DONE
    if arguments.flag("json"):
        print(
            json_text(
                {
                    "exit": int(code),
                    "errors": _findings_as_json(findings),
                    "robots": [_as_json(each) for each in sources],
                }
            )
        )
    else:
        _print_sources(sources)
    return code


def _sources(arguments: syntax.Arguments, inventory: Inventory, names: KeyNames) -> list[RobotSource]:
    """Read the requested files. Raises UsageError and NoMatchError."""
    from pathlib import Path

    from atlantis_netcfg.core.errors import NoMatchError, UsageError
    from atlantis_netcfg.inventory.findings import suggest
    from atlantis_netcfg.inventory.loader import shown_path
    from atlantis_netcfg.inventory.robots.reading import FOLDER, read_declared, read_given

    files, vehicle = arguments.many("file"), arguments.optional("vehicle")
    if files and vehicle is not None:
        raise UsageError("a file and `vehicle=` cannot be used together", hint="remove one of them")
    for name in files:
        if name in inventory.vehicles and not Path(name).exists():
            raise UsageError(f"no such file: `{arg(name)}`", hint=f"run `provision robot validate vehicle={arg(name)}`")
    if vehicle is not None and vehicle not in inventory.vehicles:
        raise UsageError(f"no such vehicle: `{arg(vehicle)}`", hint=suggest(vehicle, inventory.vehicles, none=""))
    if files:
        return read_given(map(Path, files), inventory, names)
    sources = [each for each in read_declared(inventory, names) if vehicle in {None, each.vehicle}]
    if not sources:
        folder = shown_path(inventory.root / FOLDER)
        where = f"{folder}/{vehicle}.yml" if vehicle is not None else f"{folder}/<vehicle>.yml"
        raise NoMatchError(f"{arg(where)} does not exist", hint="put the robot's file there (see docs/robots.md)")
    return sources


def _print_sources(sources: Sequence[RobotSource]) -> None:
    from atlantis_netcfg.inventory import report

    for source in sources:
        for line in _source_lines(source):
            print(line)
    if warnings := [finding for source in sources for finding in source.warnings]:
        print(translate(report(warnings, "in robot files", warnings=True)))
    count = msg("1 robot file" if len(sources) == 1 else f"{arg(len(sources))} robot files")
    print(translate(f"{arg(count)}: no errors. What a robot actually publishes was not checked."))


def _source_lines(source: RobotSource) -> Iterator[str]:
    from collections import Counter

    from atlantis_netcfg.inventory.loader import shown_path
    from atlantis_netcfg.links.cost import size

    robot = source.robot
    if robot is None:
        return
    whose = msg(f"vehicle {arg(source.vehicle)}" if source.vehicle else "no vehicle of this inventory")
    yield translate(f"{arg(shown_path(source.file))}: {arg(robot.namespace)}, {arg(whose)}")
    topics = Counter(topic.kind.value for topic in robot.topics())
    commands = Counter(kind.value for kind, _, _ in robot.every_command())
    rows = (
        (translate("topics"), topics.total(), _counts(topics)),
        (translate("commands"), commands.total(), _counts(commands)),
        (translate("videos"), len(robot.video), join(", ", (stream.label for stream in robot.video))),
    )
    for word, count, words in rows:
        yield f"  {count:>3} {word:<9} {words}".rstrip()
    executor = robot.mission_executor.action
    plans = msg(
        f"planning by the action {arg(robot.full_name(executor))}"
        if executor
        else "planning by a function of its own program"
    )
    yield translate(f"      {arg(plans)}")
    yield translate(
        f"      before registration it sends its configuration at 1 Hz: {arg(size(source.size * _DAY_S))} a day"
    )


ADDRESS = syntax.Word("address", "this computer's address in the robot network, if not detected")

ROBOT_DISCOVER = syntax.CommandSpec(
    "robot discover",
    "listen for robots at a site and compare them with their files",
    words=(
        syntax.Word("site", "site whose LAN or VPN this computer is connected to", is_required=True, example="coastal"),
        syntax.Word("for", "duration, from 5 seconds to 1 hour (default: 30 s)", example="30s"),
        syntax.Word(
            "from",
            "listen on this gateway or control centre, over SSH",
            example="scc-control",
        ),
        ADDRESS,
        syntax.Word("record", "record all messages to this new folder (rosbag2)", example="bags/quay"),
        syntax.Word("save", "write the robot file of this vehicle from what was received", example="lauv"),
        syntax.INVENTORY,
    ),
    flags=(syntax.JSON, syntax.ACCEPT_COST, syntax.ASK_VAULT_PASS),
    details=(
        "Runs on this computer without ROS, and sends only DDS announcements, about 0.3 MB a minute. It receives "
        "only ROS 2 topics in the pilot's domain. A recording contains the robots' tokens, so its folder is "
        "private. It stops at 1 GB. Exit code 0: every robot tested there was received and matches its file; 6: "
        "a robot is missing or differs, an unknown one or none at all was received, or the recording ended early."
    ),
)


def run_robot_discover(arguments: syntax.Arguments) -> ExitCode:
    """Run `robot discover`: listen, and print the robots detected."""
    from dataclasses import replace

    from atlantis_netcfg.cli.base.passphrase import vault_of
    from atlantis_netcfg.operations import robots

    vault = vault_of(arguments)
    inventory, site = replace(_inventory(arguments), decrypt=vault.decrypt), arguments.word("site")
    _require_site(inventory, site)
    seconds = robots.seconds_of(arguments.optional("for") or "30s")
    record = _record(arguments, inventory)
    namespace = arguments.optional("save")
    if namespace is not None or arguments.has_flag(syntax.ASK_VAULT_PASS):
        _ = vault.secrets  # whoever has no password is told before half a minute is over
    try:
        observation, reports = _listen(arguments, inventory, site, seconds, record)
    except KeyboardInterrupt:
        if not arguments.flag("json"):
            _tell_recording(record)
        raise
    code = robots.ending(reports, observation)
    if record is not None and record.reason:
        code = ExitCode.CHECKS_FAILED
    if not arguments.flag("json"):
        _tell_heard(observation, reports, robots.dds_of(inventory).domain)
        _tell_recording(record)
    robot_file = robots.save(inventory, namespace, observation, vault.encrypt) if namespace is not None else None
    if arguments.flag("json"):
        more: dict[str, object] = {"saved": None if robot_file is None else str(robot_file)}
        if record is not None:
            more["recording"] = record.as_dict()
        print(json_text({"exit": int(code), "errors": [], **_heard_as_json(observation, reports), **more}))
    elif robot_file is not None:
        print(translate(f"{arg(robot_file)} was written, with its token encrypted: review it before you keep it"))
    return code


def _record(arguments: syntax.Arguments, inventory: Inventory) -> BagRecorder | None:
    """Return the recorder, if a recording was requested. Raises UsageError."""
    from atlantis_netcfg.core.errors import UsageError
    from atlantis_netcfg.operations import robots

    folder = arguments.optional("record")
    if folder is None:
        return None
    if arguments.optional("from") is not None:
        raise UsageError("`record=` works only on this computer, and `from=` names another", hint="remove one of them")
    return robots.recorder(inventory, folder)


def _tell_heard(observation: RobotObservation, reports: Sequence[RobotReport], number: int) -> None:
    for report in reports:
        for line in _report_lines(report):
            print(line)
    count = len(observation.participants)
    print(translate(f"participants of domain {arg(number)} received in {arg(observation.seconds):.0f} s: {arg(count)}"))
    if observation.program == "rclpy":
        print(translate("received with ROS 2's own library, which was never tested here: docs/robots.md"))
    if not count:
        print(translate("this proves nothing: is a robot switched on, in this network and in this domain?"))


def _tell_recording(record: BagRecorder | None) -> None:
    from atlantis_netcfg.inventory.loader import shown_path
    from atlantis_netcfg.links.cost import size

    if record is None:
        return
    if record.messages:
        print(
            translate(
                f"recorded in {arg(shown_path(record.folder))}: {arg(record.messages)} messages, "
                f"{arg(size(record.octets))}"
            )
        )
    elif not record.reason:
        print(translate("nothing was recorded: no message of a known type was received"))
    if record.reason:
        print(translate(f"the recording ended early: {arg(record.reason)}"))


def _listen(
    arguments: syntax.Arguments, inventory: Inventory, site: str, seconds: int, record: BagRecorder | None
) -> tuple[RobotObservation, list[RobotReport]]:
    """Listen here, or on the computer given by `from=`. Raises UsageError, ListenError."""
    from atlantis_netcfg.core.errors import UsageError
    from atlantis_netcfg.inventory.findings import suggest
    from atlantis_netcfg.inventory.model import ServerComputer
    from atlantis_netcfg.operations import robots
    from atlantis_netcfg.operations.robots import remote

    address, place = arguments.optional("address"), arguments.optional("from")
    if place is None:
        _pay(arguments, inventory, site, seconds, lambda: robots.listening_address(inventory, site, address))
        return robots.discover(inventory, site, seconds, address, record)
    if address is not None:
        raise UsageError("`address=` belongs to this computer, and `from=` names another", hint="remove one of them")
    if place not in inventory.hosts:
        computers = [host.name for host in inventory.hosts.values() if isinstance(host.device, ServerComputer)]
        raise UsageError(f"`from={arg(place)}` is not a host of the inventory", hint=suggest(place, computers, none=""))
    host = inventory.hosts[place]
    device = remote.listening_computer(inventory, host)
    _pay(arguments, inventory, site, seconds, lambda: str(device.address))
    observation = remote.listen_there(inventory, host, seconds, sites=[site])
    return observation, robots.compare(inventory, site, observation)


def _pay(
    arguments: syntax.Arguments, inventory: Inventory, site: str, seconds: int, address: Callable[[], str]
) -> None:
    """Ask for consent if listening brings the robots' topics over a metered link."""
    from atlantis_netcfg.cli.base.consent import pay
    from atlantis_netcfg.links.cost import CostRefusal
    from atlantis_netcfg.operations.robots.listening_cost import listening_cost

    cost, gateway = listening_cost(inventory, site, seconds, address), inventory.computer_of(site)
    if cost is None:
        return
    place = f"`from={gateway.name}`" if gateway is not None else site
    hint = msg(f"run the same command with `--accept-cost`, or listen at the site: {arg(place)}")
    if cost.over_cap:
        hint = msg(f"listen at the site: {arg(place)}")
    try:
        if cost.over_cap:
            raise cost.refusal()
        pay([cost.words], is_accepted=arguments.flag("accept-cost"), as_json=arguments.flag("json"))
    except CostRefusal as error:
        raise CostRefusal(str(error), hint=hint) from None


def _report_lines(report: RobotReport) -> Iterator[str]:
    whose = msg(f", vehicle {arg(report.vehicle)}" if report.vehicle else "")
    yield f"{report.verdict.value:<13}{report.namespace}: {translate(report.state.value)}{whose}"
    for writer in report.topics:
        rate = "?" if writer.rate_hz is None else f"{writer.rate_hz:.2f}"
        yield f"    {rate:>6} Hz {writer.size_bytes:>7} B  {writer.topic}"
    for finding in report.findings:
        yield f"  {finding.verdict.value:<13}{translate(finding.message)}"
        if finding.hint:
            yield f"  {'':<13}{translate(finding.hint)}"


def _heard_as_json(observation: RobotObservation, reports: Sequence[RobotReport]) -> dict[str, object]:
    return {
        "seconds": round(observation.seconds, 1),
        "program": observation.program,
        "participants": observation.participants,
        "robots": [
            {
                "namespace": report.namespace,
                "state": report.state.value,
                "vehicle": report.vehicle,
                "verdict": report.verdict.value,
                "topics": {
                    writer.topic: {
                        "type": writer.type,
                        "rate_hz": None if writer.rate_hz is None else round(writer.rate_hz, 2),
                        "bytes": writer.size_bytes,
                        "messages": writer.messages,
                        "reliable": writer.reliable,
                    }
                    for writer in report.topics
                },
                "findings": [
                    {"verdict": each.verdict.value, "code": each.code, "message": each.message, "hint": each.hint}
                    for each in report.findings
                ],
            }
            for report in reports
        ],
    }


_LOOP = syntax.Flag("loop", "restart the recording when it ends")

ROBOT_MOCK = syntax.CommandSpec(
    "robot mock",
    "simulate a robot, or replay a recording, to test a control centre",
    words=(
        syntax.Word("vehicle", "only these robots (default: all of the inventory)", many=True, example="sparus"),
        syntax.Word("site", "publish to this site (default: this computer only)", example="coastal"),
        syntax.Word("for", "duration, from 5 seconds to 1 hour (default: until Ctrl-C)", example="5m"),
        syntax.Word("bag", "recording to replay with its timing: rosbag2 folder (sqlite3)", example="bags/quay"),
        ADDRESS,
        syntax.INVENTORY,
    ),
    flags=(_LOOP,),
    details=(
        "Runs on this computer without ROS, with ROS 2 names and types. The robot moves in a circle off Viana do "
        "Castelo, whatever the command. A boolean used in a condition changes every minute; all others are "
        "false. A command takes 3 seconds, each step of a plan 1 second; the reported status is always 0, "
        "because its values are unknown. Senders of commands and plans need "
        "RMW_IMPLEMENTATION=rmw_cyclonedds_cpp; every ROS 2 can read the topics. The tokens in the robot files "
        "are published: use example tokens. A replay publishes every message of a known type, including commands "
        "that a robot would obey: use `site=` only where there is no robot. Time stamps are not changed, so "
        "`robot discover` reports them as stale."
    ),
)


def run_robot_mock(arguments: syntax.Arguments) -> ExitCode:
    """Publish and answer until the time is over."""
    from collections import Counter
    from contextlib import suppress

    from atlantis_netcfg.core.errors import UsageError
    from atlantis_netcfg.inventory.findings import suggest
    from atlantis_netcfg.operations import robots

    inventory, site = _inventory(arguments), arguments.optional("site")
    if site is not None:
        _require_site(inventory, site)
    for vehicle in arguments.many("vehicle"):
        if vehicle not in inventory.vehicles:
            hint = suggest(vehicle, inventory.vehicles, none="")
            raise UsageError(f"no such vehicle: `{arg(vehicle)}`", hint=hint)
    span = arguments.optional("for")
    seconds = robots.seconds_of(span) if span else None
    place, bag = robots.mock_place(inventory, site, arguments.optional("address")), arguments.optional("bag")
    if bag is not None:
        return _replay(arguments, inventory, bag, place, seconds)
    if arguments.flag("loop"):
        raise UsageError("`--loop` requires a recording", hint="add it: `bag=FOLDER`")
    robots_here: list[MockRobot] = []

    def watch(mocks: Sequence[MockRobot]) -> None:
        if not robots_here:
            robots_here.extend(mocks)
            names = join(", ", (each.robot.name for each in mocks))
            print(translate(f"at {arg(place.address)}, in domain {arg(robots.dds_of(inventory).domain)}: {arg(names)}"))
            _tell_limits(mocks)
        _tell_goals(mocks)

    with suppress(KeyboardInterrupt):
        robots.mock(inventory, arguments.many("vehicle"), place, seconds, watch)
    _tell_goals(robots_here)
    for each in robots_here:
        counts = sum((action.counts for action in each.actions), Counter())
        print(
            translate(
                f"  {arg(each.robot.name)}: "
                f"{arg(sum(each.message_counts.values()))} messages on {arg(len(each.message_counts))} topics"
            )
        )
        accepted_count, refused_count, unreadable = (counts[word] for word in ("accepted", "refused", "unreadable"))
        print(
            translate(
                f"  {arg(each.robot.name)}: goals accepted {arg(accepted_count)}, refused {arg(refused_count)}, "
                f"invalid {arg(unreadable)}"
            )
        )
    return ExitCode.DONE if robots_here else ExitCode.NOTHING


def _tell_limits(mocks: Sequence[MockRobot]) -> None:
    for line in (line for each in mocks for line in each.limits()):
        print(f"  {translate(line)}")
    print(translate("Ctrl-C stops it"), flush=True)


def _tell_goals(mocks: Sequence[MockRobot]) -> None:
    for action in (action for each in mocks for action in each.actions):
        while action.notices:
            print(f"  {action.name}: {translate(action.notices.popleft())}", flush=True)


def _replay(
    arguments: syntax.Arguments, inventory: Inventory, bag: str, place: MockPlace, seconds: float | None
) -> ExitCode:
    from contextlib import suppress

    from atlantis_netcfg.core import printable
    from atlantis_netcfg.core.errors import UsageError
    from atlantis_netcfg.operations import robots

    if arguments.many("vehicle"):
        raise UsageError("a recording and `vehicle=` cannot be used together", hint="remove one of them")
    players: list[BagPlayer] = []

    def tell(contents: Bag, player: BagPlayer) -> None:
        players.append(player)
        names = join(", ", sorted({*contents.robots.values()} - {""})) or translate(
            "the recording does not identify a robot"
        )
        number = robots.dds_of(inventory).domain
        print(printable.line(translate(f"at {arg(place.address)}, in domain {arg(number)}: {arg(names)}")))
        print(translate(f"{arg(len(contents.topics))} topics, {arg(contents.seconds):.0f} s; Ctrl-C stops it"))
        for topic, kind in contents.left_out.items():
            print(printable.line(translate(f"skipped: {arg(topic)}, unknown type {arg(kind)}")), flush=True)

    with suppress(KeyboardInterrupt):
        robots.replay(inventory, bag, place, seconds, tell, loop=arguments.flag("loop"))
    for player in players:
        print(translate(f"  {arg(player.sent.total())} messages on {arg(len(player.sent))} topics"))
    return ExitCode.DONE if players else ExitCode.NOTHING


def _inventory(arguments: syntax.Arguments) -> Inventory:

    from atlantis_netcfg.core import paths
    from atlantis_netcfg.inventory import load

    return load(paths.inventory_folder(arguments.optional("inventory")))


def _require_site(inventory: Inventory, site: str) -> None:
    from atlantis_netcfg.inventory import choose

    choose(inventory, site)


def _counts(counter: dict[str, int]) -> str:
    return join(", ", (f"{word.replace('_', ' ')} {count}" for word, count in counter.items()))


def _findings_as_json(findings: Sequence[Finding]) -> list[dict[str, object]]:
    import dataclasses

    return [dataclasses.asdict(finding) for finding in findings]


def _as_json(source: RobotSource) -> dict[str, object]:
    robot = source.robot
    return {
        "file": str(source.file),
        "vehicle": source.vehicle,
        "namespace": robot.name if robot is not None else None,
        "bytes": source.size,
        "topics": {topic.name: topic.message_type for topic in robot.topics()} if robot is not None else {},
        "actions": {action.name: action.action_type for action in robot.actions()} if robot is not None else {},
        "errors": _findings_as_json(source.findings),
        "warnings": _findings_as_json(source.warnings),
    }
