"""Robots' files parsed into models or into all of their errors, and the rules that hold between robots."""

from __future__ import annotations

from dataclasses import dataclass, replace
from datetime import datetime
from typing import TYPE_CHECKING
from zoneinfo import ZoneInfo

from atlantis_netcfg.core.errors import NoMatchError, UsageError
from atlantis_netcfg.core.messages import arg, msg
from atlantis_netcfg.inventory import _yaml, loader
from atlantis_netcfg.inventory.examples import examples_in
from atlantis_netcfg.inventory.findings import Finding, InventoryInvalid, Mark, choices, suggest
from atlantis_netcfg.inventory.model import Guest
from atlantis_netcfg.inventory.model.robot import RobotFile, TopicKind
from atlantis_netcfg.inventory.robots.key_names import KeyNames, read_key_names

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Sequence
    from pathlib import Path

    from atlantis_netcfg.inventory.inventory import Inventory

FOLDER = "robots"
"""Folder in the inventory with `<vehicle>.yml` for each robot, `keys.yml`, and `interfaces/` with message types."""
NO_ROBOT_CONTACTED = "in robots' files; no robot was contacted"
_KEYS = "keys.yml"
_MINE_ALONE = 0o077
_Path = tuple[str | int, ...]


@dataclass(frozen=True, slots=True)
class RobotSource:
    """A robot's file as it was read, with its parsed model and its findings."""

    file: Path
    node: _yaml.Node
    """Content of the file, with our keys."""
    size: int
    """Size of the file in bytes; the robot publishes it at 1 Hz until it is registered (report, 3.4)."""
    vehicle: str | None
    """Vehicle of the file; None: the inventory has no such vehicle."""
    robot: RobotFile | None
    """Parsed content; None: errors in the file prevent parsing."""
    key_of: Callable[[_Path], str]
    """Returns the file's own name of the key at a path."""
    findings: tuple[Finding, ...] = ()
    warnings: tuple[Finding, ...] = ()

    def text(self) -> str:
        """Return the file's text as the robot publishes it."""
        return self.file.read_text(encoding="utf-8-sig")

    @property
    def token_is_sealed(self) -> bool:
        """Whether the token is still encrypted in the vault and so cannot be compared."""
        return self.robot is None or isinstance(self.robot.token, _yaml.SealedSecret)

    def with_token(self, decrypt: _yaml.Decrypt | None) -> RobotSource:
        """Return a copy with the token decrypted, if the vault's password is known."""
        robot = self.robot
        if decrypt is None or robot is None or not isinstance(robot.token, _yaml.SealedSecret):
            return self
        try:
            token = robot.token.decrypt_with(decrypt)
        except UsageError:
            return self
        return replace(self, robot=robot.model_copy(update={"token": token}))

    def wrong(self, path: _Path, message: str, hint: str) -> Finding:
        """Return a finding at a value; for a block, at its key."""
        return Finding.at(self.mark(path), message, hint)

    def mark(self, path: _Path) -> Mark:
        """Return the position of a value; for a block, the position of its key."""
        node = self.node.at(*path)
        return node.place if isinstance(node.value, dict | list) else node.mark

    def label(self, path: _Path) -> str:
        """Return a key's name for a message, as this file spells it, in backticks."""
        return f"`{self.key_of(path)}`"


def key_names(inventory: Inventory) -> tuple[KeyNames, list[Finding]]:
    """Read the partners' key names of an inventory; return them with the findings."""
    path = inventory.root / FOLDER / _KEYS
    if not path.exists():
        return KeyNames(), []
    node, _, findings = _parse(path)
    names, wrong = read_key_names(node) if node is not None else (KeyNames(), [])
    return names, findings + wrong


def robot_files(inventory: Inventory) -> dict[str, Path]:
    """Return each robot's file by vehicle name, including files whose name no vehicle has."""
    paths = sorted((inventory.root / FOLDER).glob("*.yml"))
    return {path.stem: path for path in paths if path.name != _KEYS}


def read_declared(inventory: Inventory, names: KeyNames) -> list[RobotSource]:
    """Read every robot file of the inventory, with findings per file and between the files."""
    sources = [_read(path, inventory, names, vehicle) for vehicle, path in robot_files(inventory).items()]
    return _with_namespaces_compared(sources)


def read_given(files: Iterable[Path], inventory: Inventory, names: KeyNames) -> list[RobotSource]:
    """Read partners' files; a file with the namespace of an inventory robot is a newer file of that robot."""
    source_by_file = {source.file.resolve(): source for source in read_declared(inventory, names)}
    vehicle_by_name = {source.robot.name: source.vehicle for source in source_by_file.values() if source.robot}
    sources = []
    for path in files:
        source = source_by_file.get(path.resolve()) or _read(path, inventory, names, None)
        vehicle = source.vehicle or (vehicle_by_name.get(source.robot.name) if source.robot else None)
        sources.append(replace(source, vehicle=vehicle))
    return _with_namespaces_compared(sources)


def past_guests(inventory: Inventory) -> dict[str, str]:
    """Return guests whose last day has passed in the pilot's time zone, with that day (ISO date)."""
    today = datetime.now(ZoneInfo(inventory.pilot.time_zone)).date().isoformat()
    guests = {key: each for key, each in inventory.vehicles.items() if isinstance(each, Guest)}
    return {key: guest.until for key, guest in guests.items() if guest.until < today}


def load_robots(inventory: Inventory) -> tuple[list[RobotSource], KeyNames]:
    """Read every robot of an inventory; raise InventoryInvalid with the errors of all, so only warnings remain."""
    names, findings = key_names(inventory)
    sources = read_declared(inventory, names)
    findings += [finding for source in sources for finding in source.findings]
    if findings:
        raise InventoryInvalid(findings, NO_ROBOT_CONTACTED)
    return [source.with_token(inventory.decrypt) for source in sources], names


def read_published(data: bytes, names: KeyNames) -> tuple[RobotFile | None, str]:
    """Parse a configuration published by a robot (YAML or JSON); return None and the first error if it is invalid."""
    if len(data) > loader.LARGEST:
        return None, "it is larger than 1 MB"
    node, findings = _yaml.parse(data, "line", None)
    if node is None or not isinstance(node.value, dict):
        return None, str(findings[0]) if findings else "it contains no keys"
    root, findings = names.translate(node)
    robot, _, wrong = loader.build(root, RobotFile, "it", names.key_of)
    findings = sorted((*findings, *wrong))
    return (robot, "") if robot is not None and not findings else (None, str(findings[0]))


def _with_namespaces_compared(sources: Sequence[RobotSource]) -> list[RobotSource]:
    """Add a finding where two robots share a namespace: each would execute the other's commands unnoticed."""
    first: dict[str, RobotSource] = {}
    result = []
    for source in sources:
        there = first.setdefault(source.robot.name, source) if source.robot is not None else source
        if there is not source:
            mark = there.mark(("namespace",))
            message = msg(f"another robot has this namespace: {arg(mark.file)}:{arg(mark.line)}")
            finding = source.wrong(("namespace",), message, "give each robot its own namespace")
            source = replace(source, findings=(*source.findings, finding))  # noqa: PLW2901 - the same with its error
        result.append(source)
    return result


def _parse(path: Path) -> tuple[_yaml.Node | None, int, list[Finding]]:
    """Read and parse one file (at most 1 MB and 100 levels); raise NoMatchError if it cannot be read."""
    file_name = loader.shown_path(path)
    try:
        data = loader.content(path)
    except OSError as error:
        reason = (error.strerror or "no reason given").lower()
        raise NoMatchError(
            f"{arg(file_name)} cannot be read: {arg(reason)}", hint=f"check it: ls -ld {arg(file_name)}"
        ) from None
    if len(data) > loader.LARGEST:
        hint = "a robot publishes its configuration every second: remove what the control centre does not read"
        return None, len(data), [Finding.at(Mark(file_name, 1, 1), "the file is larger than 1 MB", hint)]
    node, findings = _yaml.parse(data, file_name, None)
    return node, len(data), findings


def _read(path: Path, inventory: Inventory, names: KeyNames, vehicle: str | None) -> RobotSource:
    """Read one robot file; `vehicle` is set for files of the inventory."""
    root, size, findings = _parse(path)
    start = Mark(loader.shown_path(path), 1, 1)
    if vehicle is not None and vehicle not in inventory.vehicles:
        findings.append(
            Finding.at(start, msg(f"no such vehicle: `{arg(vehicle)}`"), suggest(vehicle, inventory.vehicles, none=""))
        )
    if root is not None and not isinstance(root.value, dict):
        findings.append(Finding.at(root.mark, "a robot's file contains keys, each with a value", "write `key: value`"))
    elif root is None and not findings:
        hint = msg(f"write `{arg(names.key_of(('namespace',)))}:` and the other keys")
        findings.append(Finding.at(start, "the file is empty", hint))
    if root is None or not isinstance(root.value, dict):
        return RobotSource(path, _yaml.Node(start, None), size, vehicle, None, names.key_of, tuple(sorted(findings)))
    root, clashes = names.translate(root)
    robot, node, wrong = loader.build(root, RobotFile, path.name, names.key_of)
    source = RobotSource(path, node, size, vehicle, robot, names.key_of)
    warnings: list[Finding] = []
    if robot is not None:
        rules = _OF_THE_INVENTORY if vehicle is not None else _OF_A_PARTNER
        wrong += [finding for rule in (*_RULES, *rules) for finding in rule(source, robot, inventory)]
        warnings += [finding for rule in _WARNINGS for finding in rule(source, robot, inventory)]
        if vehicle is None:
            warnings += file_is_private(source, robot)
    return replace(source, findings=tuple(sorted((*findings, *clashes, *wrong))), warnings=tuple(sorted(warnings)))


def require_one_alternative(source: RobotSource, robot: RobotFile, _: Inventory) -> Iterator[Finding]:
    """Require exactly one alternative: topic or library for the pose, action or callback for the mission executor."""
    blocks = {"pose": (robot.pose.topic, "topic", robot.pose.library, "library")}
    executor = robot.mission_executor
    blocks["mission_executor"] = (executor.action, "action", executor.callback, "callback")
    for block, (name, key, flag, other) in blocks.items():
        if (name is None) is not flag:
            first, second = (source.label((block, word)) for word in (key, other))
            whose = source.label((block,))
            message = msg(
                f"{arg(whose)} has both {arg(first)} and {arg(second)}"
                if flag
                else f"{arg(whose)} has neither {arg(first)} nor {arg(second)}"
            )
            yield source.wrong((block,), message, "write one of them")


def names_once(source: RobotSource, robot: RobotFile, _: Inventory) -> Iterator[Finding]:
    """Require unique topics, actions and command labels within one file."""
    first_paths: dict[tuple[str, str], _Path] = {}
    rows = [("topic", topic.name, topic.path) for topic in robot.topics()]
    rows += [("action", action.name, action.path) for action in robot.actions()]
    rows += [
        ("label", command.label, ("commands", kind.value, index, "label"))
        for kind, index, command in robot.every_command()
    ]
    for sort, name, path in rows:
        there = first_paths.setdefault((sort, name), path)
        if there is not path:
            message = msg(
                f"the {arg(sort)} `{arg(name)}` is already in this file, in line {arg(source.mark(there).line)}"
            )
            yield source.wrong(path, message, "remove one, or give each its own")


def conditions(source: RobotSource, robot: RobotFile, _: Inventory) -> Iterator[Finding]:
    """Require that a command's condition is a boolean topic that the robot publishes."""
    full = {topic.name: topic.kind for topic in robot.topics()}
    booleans = [name for name, kind in full.items() if kind is TopicKind.BOOLEAN]
    for kind, index, command in robot.every_command():
        if command.condition is None or (name := robot.full_name(command.condition.topic)) in booleans:
            continue
        path = ("commands", kind.value, index, "condition", "topic")
        key = source.label(("telemetry", "booleans"))
        message = msg(f"a condition needs a topic of {arg(key)}, but `{arg(name)}` is not there")
        if name in full:
            there = source.label(("telemetry", full[name].value))
            message = msg(f"a condition needs a topic of {arg(key)}, but `{arg(name)}` is under {arg(there)}")
        none = msg(f"put it under {arg(key)}")
        hint = (
            msg(f"available: {arg(choices(booleans))}")
            if name in full and booleans
            else suggest(name, booleans, none=none)
        )
        yield source.wrong(path, message, hint)


def token_is_vaulted(source: RobotSource, robot: RobotFile, inventory: Inventory) -> Iterator[Finding]:
    """Require that a real token is encrypted, since the file goes into git, and that example tokens are marked so."""
    key = source.key_of(("token",))
    if not isinstance(robot.token, _yaml.SealedSecret) and not robot.token.is_example:
        hint = f"ansible-vault encrypt_string --stdin-name {key}"
        yield source.wrong(("token",), msg(f"`{arg(key)}` is in clear text"), hint)
    if not inventory.pilot.example_values:
        for example in examples_in([source.node]):
            mark = Mark(example.file, example.line, example.column)
            message = msg(f"`{arg(example.key)}` is still an example, but `example_values` of the pilot is false")
            yield Finding.at(mark, message, "write the real value, and delete the mark `# EXAMPLE`")


def token_is_real(source: RobotSource, robot: RobotFile, _: Inventory) -> Iterator[Finding]:
    """Report a token that is still the example value."""
    if not isinstance(robot.token, _yaml.SealedSecret) and robot.token.is_example:
        message = msg(f"{arg(source.label(('token',)))} is still an example")
        yield source.wrong(("token",), message, "write the token that the control centre expects of this robot")


def file_is_private(source: RobotSource, robot: RobotFile) -> Iterator[Finding]:
    """Report a file with a clear-text token that other users of this computer can read."""
    if isinstance(robot.token, _yaml.SealedSecret) or robot.token.is_example:
        return
    if source.file.stat().st_mode & _MINE_ALONE:
        message = msg(f"other users of this computer can read {arg(source.label(('token',)))}")
        yield source.wrong(("token",), message, f"chmod 600 {loader.shown_path(source.file)}")


def units(source: RobotSource, robot: RobotFile, _: Inventory) -> Iterator[Finding]:
    """Require a unit for every number, so that an operator knows what it means."""
    for index, topic in enumerate(robot.telemetry.numbers):
        if topic.unit is None:
            path = ("telemetry", "numbers", index)
            message = msg(f"the number `{arg(topic.topic)}` has no {arg(source.label((*path, 'unit')))}")
            yield source.wrong((*path, "topic"), message, "write it, or 1 for a number without a unit")


def costs_are_of_topics(source: RobotSource, robot: RobotFile, inventory: Inventory) -> Iterator[Finding]:
    """Require that the vehicle's `telemetry:` in the inventory, used to judge links, names topics of its robot."""
    vehicle = inventory.vehicles.get(source.vehicle or "")
    topic_names = [topic.name for topic in robot.topics()]
    for item in vehicle.telemetry if vehicle is not None else ():
        if robot.full_name(item.topic) not in topic_names:
            message = msg(
                f"`telemetry:` of the vehicle {arg(source.vehicle)} has `{arg(item.topic)}`, this file does not"
            )
            hint = suggest(robot.full_name(item.topic), topic_names, none="correct one of the two")
            yield source.wrong(("telemetry",), message, hint)


_RULES = (require_one_alternative, names_once, conditions)
_OF_THE_INVENTORY = (token_is_vaulted,)
_OF_A_PARTNER = (token_is_real,)
_WARNINGS = (units, costs_are_of_topics)
