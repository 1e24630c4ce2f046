"""`docs/inventory.md`: every key of an inventory, built from the model; examples are the included values.

`python -m atlantis_netcfg.inventory.key_reference` writes the page; a test compares it with the model.
"""

from __future__ import annotations

import inspect
import sys
from enum import Enum
from ipaddress import IPv4Address, IPv4Network
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, get_args, get_origin

from annotated_types import Ge, Gt, Le, MaxLen, MinLen
from pydantic import BaseModel, BeforeValidator

from atlantis_netcfg.core.secret import Secret
from atlantis_netcfg.inventory import _schema
from atlantis_netcfg.inventory._yaml import Node, parse
from atlantis_netcfg.inventory.field_docs import key_description, sentence
from atlantis_netcfg.inventory.model import Guest, Partner, Pilot, Site, Vehicle
from atlantis_netcfg.inventory.model.robot import RobotFile

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from pydantic.fields import FieldInfo

_Key = tuple[type[BaseModel], str]
_INTRODUCTION = """\
# The inventory, key by key

Made from the model by `python -m atlantis_netcfg.inventory.key_reference`: change that, not this page.

How to make an inventory, mark its examples and encrypt its secrets: [prepare your own site](own-site.md).

| file | what it holds |
|---|---|
| `hosts.yml` | every host once under its site, once under what it is |
| `group_vars/all/pilot.yml` | [`pilot`](#pilot): what holds for every site |
| `group_vars/all/partners.yml` | [`partners`](#partners): who joins through the VPN |
| `group_vars/all/vehicles.yml` | [`vehicles`](#vehicles): the robots |
| `group_vars/all/guests.yml` | [`guests`](#guests): visiting robots, written by `provision robot invite` |
| `group_vars/SITE.yml` | [`site`](#site): address plan and links of a place |
| `host_vars/HOST.yml` | `device`: one box, by its `kind` |
| `robots/VEHICLE.yml` | [`robot`](#robot): what the robot of a vehicle tells the control centre ([page](robots.md)) |
| `evidence/`, `keys/` | files that terminals have exported, and keys of package archives |

- Editors that know `# yaml-language-server: $schema=…` in the first line of a file complete and check the keys. Schemas
  are in `.schema/` of the inventory. Set `yaml.customTags: ["!vault scalar"]` in the editor. A schema checks one file;
  only `provision inventory validate` compares files.
- The column *example* shows the value of the shipped inventory, if it has the key. No value is a recommendation.
"""
_UNITS = (
    ("_bytes_per_s", "bytes/s"),
    ("_per_mb", "currency/10⁶ bytes"),
    ("_bytes", "bytes"),
    ("_minutes", "min"),
    ("_percent", "%"),
    ("_kbps", "kbit/s"),
    ("_mbps", "Mbit/s"),
    ("_mhz", "MHz"),
    ("_hz", "Hz"),
    ("_eur", "EUR"),
    ("_dbm", "dBm"),
    ("_dbi", "dBi"),
    ("_mb", "10⁶ bytes"),
    ("_ms", "ms"),
    ("_s", "s"),
    ("_m", "m"),
    ("latitude", "°"),
    ("longitude", "°"),
    ("baud", "bit/s"),
)
_FORMS: Mapping[str, str] = {
    "CommandCondition.value": "true",
    "RetrievalRobot.folder": "/home/recorder/bags",
    "RetrievalRobot.host_key": "ssh-ed25519 AAAA…",
    "Ssh.host_key": "ssh-ed25519 AAAA…",
    "aliases": "[SENSE]",
    "apn": "internet.example",
    "archive": "backend.tar",
    "arguments": "--port 18082",
    "backup_file": "vesselink-2026-11-21.bin",
    "backup_sha256": "64 hex digits",
    "by": "Ana Silva",
    "command": "bin/data-gateway config/gateway.yml",
    "data": "/srv/backend",
    "device": "/dev/ttyUSB0",
    "dns_name": "weather.example.org",
    "fingerprint": "64 hex digits",
    "expect": "NTPSynchronized=yes",
    "firmware": "1.23",
    "host": "coastal-gateway",
    "host_key": "SHA256:…",
    "interface": "eth0",
    "key": "EXAMPLE-key",
    "key_file": "archive.asc",
    "mirror": "https://mirror.example.org/ros2",
    "ros1_mirror": "https://mirror.example.org/ros",
    "mac": '"02:00:5E:00:01:10"',
    "master_uri": '"http://192.0.2.30:11311"',
    "model": "Thales VesseLINK",
    "name": "sparus-control",
    "package": "ros-foxy-ros-core",
    "packages": "[ros-foxy-rviz2]",
    "partner": "iqua",
    "password": "EXAMPLE-password",
    "peers": "[]",
    "people": "[B. Pilot]",
    "pin": "!vault |",
    "replaces": "[/etc/netplan/50-cloud-init.yaml]",
    "robot": "sparus",
    "router_port": "ether4",
    "sees": "[sparus]",
    "seen_by": "coastal-router",
    "secret": "EXAMPLE-secret",
    "seen_on": '"2026-11-21"',
    "serial": "/dev/ttyUSB2",
    "sha256": "64 hex digits",
    "shared_key_until": '"2027-03-31"',
    "signed_by": "[C. Officer]",
    "site": "coastal",
    "ssid": "EXAMPLE-NETWORK",
    "source": "https://images.example.org/board.img.xz",
    "table3_deviation": "the partner has added a modem",
    "token": "EXAMPLE-token",
    "topic": "sparus/pose",
    "topics": "[/girona500/pose]",
    "type": "std_msgs/msg/String",
    "unit": "V",
    "until": '"2026-12-31"',
    "tested_at": "[coastal]",
    "to": "scc-control",
    "user": "provision",
    "value": "harbour",
    "version": '"0.9.2-1*"',
}
"""Example values where the shipped inventory has none and the type does not show one."""


class _BlockOfKeys(NamedTuple):
    title: str
    model: type[BaseModel]
    words: str


def text(inventory: Path) -> str:
    """Render the page; `inventory` is the included example inventory."""
    examples = _examples(inventory)
    blocks = list(_blocks())
    titles = {block.model: block.title for block in blocks}
    parts = [_INTRODUCTION]
    for block in blocks:
        parts.append(f"\n## {block.title}\n\n{block.words}\n\n| key | type | unit | default | meaning | example |")
        parts.append("|---|---|---|---|---|---|")
        parts += [_row(block.model, name, titles, examples) for name in block.model.model_fields]
    return "\n".join(parts) + "\n"


def _blocks() -> Iterator[_BlockOfKeys]:
    """Yield every model once, under the first key that contains it; nested ones follow."""
    seen_models: set[type[BaseModel]] = set()
    roots: list[tuple[str, type[BaseModel]]] = [
        ("pilot", Pilot),
        ("partners", Partner),
        ("vehicles", Vehicle),
        ("guests", Guest),
        ("site", Site),
    ]
    roots += [(f"device: {kind}", model) for kind, model in _schema.DEVICES.items()]
    roots.append(("robot", RobotFile))
    for title, model in roots:
        yield from _walk_blocks(title, model, seen_models)


def _walk_blocks(title: str, model: type[BaseModel], seen_models: set[type[BaseModel]]) -> Iterator[_BlockOfKeys]:
    if model in seen_models:
        return
    seen_models.add(model)
    many = "One such block for each name. " if title in {"partners", "vehicles", "guests"} else ""
    yield _BlockOfKeys(title, model, many + " ".join(sentence(inspect.getdoc(model)).split()))
    for name, field in model.model_fields.items():
        inner = _schema.model_of(_unwrap_item(field.annotation))
        if inner is not None:
            yield from _walk_blocks(f"{title.removeprefix('device: ')}.{name}", inner, seen_models)


def _unwrap_item(annotation: Any) -> Any:  # noqa: ANN401 - a type
    item = _schema.item_of(annotation)
    return annotation if item is None else item


def _row(model: type[BaseModel], name: str, titles: Mapping[type[BaseModel], str], examples: Mapping[_Key, str]) -> str:
    field = model.model_fields[name]
    inner = _schema.model_of(_unwrap_item(field.annotation))
    example = f"[below](#{_anchor(titles[inner])})" if inner is not None else f"`{example_of(model, name, examples)}`"
    cells = (f"`{name}`", _type(field), _unit(name, field), _default(field), key_description(model, name), example)
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"


def _anchor(title: str) -> str:
    return "".join(letter for letter in title.lower().replace(" ", "-") if letter.isalnum() or letter in "-_")


def _type(field: FieldInfo) -> str:
    item = _schema.item_of(field.annotation)
    words = _kind_of_text(field) or _type_name(field.annotation if item is None else item)
    bounds = _bounds(field)
    return f"list of: {words}{bounds}" if item is not None else f"{words}{bounds}"


def _kind_of_text(field: FieldInfo) -> str:
    """Return the kind of text that the field's validator accepts."""
    parts = [*field.metadata, *_annotations(field.annotation)]
    names = [getattr(part.func, "__name__", "") for part in parts if isinstance(part, BeforeValidator)]
    return next((_TEXTS[name] for name in names if name in _TEXTS), "")


_TEXTS: Mapping[str, str] = {
    "_name": "name",
    "_mac": "MAC address",
    "_dns_name": "DNS name",
    "_port": "factory name of a port",
    "_day": "day",
    "_sha256": "SHA-256",
    "_fingerprint": "SHA-256 of a certificate",
    "_host_key": "SHA-256 of an SSH key",
    "_currency": "currency (ISO 4217)",
    "_ros_name": "name in ROS",
    "_ros_type": "type of a ROS message",
    "_video_link": "link",
    "_ssh_key": "public SSH key",
    "_url": "address of a server",
}


def _type_name(annotation: Any) -> str:  # noqa: ANN401 - a type
    plain = _schema.unwrap(annotation)
    if words := _schema.choices_of(plain):
        return "one of " + ", ".join(f"`{word}`" for word in words)
    if _schema.model_of(plain) is not None:
        return "block"
    if get_origin(plain) is dict:
        return "block"
    return _TYPES.get(plain, "text")


_TYPES: Mapping[Any, str] = {
    IPv4Address: "address",
    IPv4Network: "network",
    int: "whole number",
    float: "number",
    bool: "`true` or `false`",
    Secret: "secret",
}


def _bounds(field: FieldInfo) -> str:
    bounds = [*field.metadata, *_annotations(field.annotation)]
    low = next((f"{bound.ge:g} or more" for bound in bounds if isinstance(bound, Ge)), "")
    low = next((f"more than {bound.gt:g}" for bound in bounds if isinstance(bound, Gt)), low)
    high = next((f"at most {bound.le:g}" for bound in bounds if isinstance(bound, Le)), "")
    high = next((f"at most {bound.max_length} characters" for bound in bounds if isinstance(bound, MaxLen)), high)
    low = next((f"at least {bound.min_length}" for bound in bounds if isinstance(bound, MinLen)), low)
    words = ", ".join(part for part in (low, high) if part)
    return f" ({words})" if words else ""


def _annotations(annotation: Any) -> Iterator[object]:  # noqa: ANN401 - a type
    """Yield the constraints inside `… | None` or a list."""
    for part in get_args(annotation):
        for inner in getattr(part, "__metadata__", ()):
            yield from getattr(inner, "metadata", None) or (inner,)
        if not hasattr(part, "__metadata__"):
            yield from _annotations(part)


def _unit(name: str, field: FieldInfo) -> str:
    if _schema.unwrap(_unwrap_item(field.annotation)) not in {int, float} and not _is_number(field):
        return ""
    return next((unit for end, unit in _UNITS if name == end or (end[0] == "_" and name.endswith(end))), "")


def _is_number(field: FieldInfo) -> bool:
    return any(isinstance(word, int) for word in _schema.choices_of(field.annotation))


def _default(field: FieldInfo) -> str:
    if field.is_required():
        return "**required**"
    default = field.default
    if default is None or default == ():
        return "none"
    if isinstance(default, BaseModel):
        return "its defaults"
    if isinstance(default, Enum):
        return f"`{default.value}`"
    return f"`{_render(default)}`"


def _render(value: object) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, tuple | list):
        return "[" + ", ".join(_render(item) for item in value) + "]"
    return f"{value:g}" if isinstance(value, float) else str(value)


def example_of(model: type[BaseModel], name: str, examples: Mapping[_Key, str]) -> str:
    """Return an example value; empty if there is none."""
    field = model.model_fields[name]
    if (model, name) in examples:
        return examples[model, name]
    if (form := _FORMS.get(f"{model.__name__}.{name}", _FORMS.get(name))) is not None:
        return form
    if not field.is_required() and field.default not in (None, ()) and not isinstance(field.default, BaseModel):
        default = field.default
        return _render(default.value if isinstance(default, Enum) else default)
    if words := _schema.choices_of(_unwrap_item(field.annotation)):
        return str(words[0])
    return _EXAMPLES.get(_schema.unwrap(_unwrap_item(field.annotation)), "")


_EXAMPLES: Mapping[Any, str] = {
    IPv4Address: "10.64.1.1",
    IPv4Network: "10.64.1.0/24",
    bool: "true",
    int: "30",
    float: "10",
}


def _examples(inventory: Path) -> dict[_Key, str]:
    """Return the first value of each key in the included inventory."""
    result: dict[_Key, str] = {}
    for path in sorted((inventory / "group_vars").rglob("*.yml")) + sorted((inventory / "host_vars").glob("*.yml")):
        root, _ = parse(path.read_bytes(), path.name, None)
        for variable, node in root.keys.items() if root is not None else ():
            _collect(node, variable, result)
    for path in sorted((inventory / "robots").glob("*.yml")):
        root, _ = parse(path.read_bytes(), path.name, None)
        if root is not None and path.name != "keys.yml":
            _walk(root, RobotFile, result)
    return result


def _collect(node: Node, variable: str, examples: dict[_Key, str]) -> None:
    single: Mapping[str, type[BaseModel]] = {"pilot": Pilot, "site": Site}
    named_models: Mapping[str, type[BaseModel]] = {"partners": Partner, "vehicles": Vehicle}
    if variable in named_models:
        for below in node.keys.values():
            _walk(below, named_models[variable], examples)
    elif variable in single:
        _walk(node, single[variable], examples)
    else:
        _walk(node, _schema.DEVICES[str(node.keys["kind"].value)], examples)


def _walk(node: Node, model: type[BaseModel], examples: dict[_Key, str]) -> None:
    for name, value in node.keys.items():
        inner = _schema.model_of(_unwrap_item(model.model_fields[name].annotation))
        nodes = value.value if isinstance(value.value, list) else [value]
        if inner is not None:
            for below in nodes:
                _walk(below, inner, examples)
        elif value.value is not None and value.value != []:
            value_text = (
                "[" + ", ".join(item.text for item in nodes) + "]" if isinstance(value.value, list) else value.text
            )
            examples.setdefault((model, name), _quote(value_text, value))


def _quote(value_text: str, node: Node) -> str:
    """Quote a text that YAML would otherwise read as another type."""
    return f'"{value_text}"' if not isinstance(node.value, list) and not node.plain and node.text else value_text


if __name__ == "__main__":
    checkout = Path(sys.argv[1]) if len(sys.argv) > 1 else Path()
    page = checkout / "docs" / "inventory.md"
    page.write_text(text(checkout / "inventory"), encoding="utf-8")
    print(page)  # noqa: T201 - a tool for developers
