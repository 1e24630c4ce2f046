"""JSON schemas of the inventory's files, built from the model, for `# yaml-language-server: $schema=`.

A schema sees one file, and of a text only its form: `provision inventory validate` checks conditions between files.
`python -m atlantis_netcfg.inventory.json_schema` writes the included ones; a test compares them with the model.
"""

from __future__ import annotations

import inspect
import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from annotated_types import MaxLen
from pydantic import BaseModel, TypeAdapter

from atlantis_netcfg.inventory import _schema
from atlantis_netcfg.inventory._hosts import KIND_GROUPS
from atlantis_netcfg.inventory.field_docs import key_description, sentence
from atlantis_netcfg.inventory.model import Guest, Name, Partner, Pilot, Site, Vehicle
from atlantis_netcfg.inventory.model.robot import RobotFile
from atlantis_netcfg.inventory.robots.key_names import KEY, key_paths

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

FOLDER = ".schema"
"""Folder in the inventory; Ansible and our loader ignore names that begin with a dot."""
_DRAFT = "https://json-schema.org/draft/2020-12/schema"
_ANSIBLE: Mapping[str, Any] = {"^ansible_": {}}
"""Ansible's own variables are allowed in addition to ours."""
_FILES: Mapping[str, tuple[str, type[BaseModel], bool]] = {
    "pilot": ("pilot", Pilot, False),
    "partners": ("partners", Partner, True),
    "vehicles": ("vehicles", Vehicle, True),
    "guests": ("guests", Guest, True),
    "site": ("site", Site, False),
    **{kind: ("device", model, False) for kind, model in _schema.DEVICES.items()},
}
"""Schema to the variable of its file, its model, and whether the file contains several of them by name."""


def schemas() -> dict[str, dict[str, Any]]:
    """Return all schemas by file name, without `.json`."""
    return {
        "hosts": _hosts(),
        "robot": _robot(),
        "robot_keys": _robot_keys(),
        **{name: _variable(*row) for name, row in _FILES.items()},
    }


def texts() -> dict[str, str]:
    """Return the schema files: name to contents."""
    return {
        f"{name}.json": json.dumps(schema, indent=1, ensure_ascii=False) + "\n" for name, schema in schemas().items()
    }


def modeline(schema: str, depth: int) -> str:
    """Return the schema comment for a file `depth` folders below the inventory."""
    return f"# yaml-language-server: $schema={'../' * depth}{FOLDER}/{schema}.json"


def write(inventory: Path) -> list[Path]:
    """Write the schemas into an inventory; return their paths."""
    folder = inventory / FOLDER
    folder.mkdir(exist_ok=True)
    paths = []
    for name, text in texts().items():
        path = folder / name
        path.write_text(text, encoding="utf-8")
        paths.append(path)
    return paths


def _definitions(model: type[BaseModel]) -> dict[str, Any]:
    """Return the schemas of a model and its nested models, with descriptions of the keys."""
    inner = model.model_json_schema(mode="validation", ref_template="#/$defs/{model}")
    defs = {**inner.pop("$defs", {}), model.__name__: inner}
    for inner_model in _models(model):
        _describe(inner_model, defs[inner_model.__name__])
    return defs


def _robot() -> dict[str, Any]:
    """Return the schema of a robot's file, whose keys are at the top level: it is not Ansible's."""
    defs = _definitions(RobotFile)
    return {"$schema": _DRAFT, "title": "robot", **defs.pop(RobotFile.__name__), "$defs": defs}


def _robot_keys() -> dict[str, Any]:
    theirs = {"type": "string", "pattern": f"^{KEY}$"}
    names = {"enum": sorted(set(key_paths(RobotFile)))}
    keys = {"type": ["object", "null"], "propertyNames": names, "additionalProperties": theirs}
    ignore_schema = {"type": "array", "items": {"type": "string"}}
    words = "How the partners' files call the keys of a robot, and which of theirs are not read."
    return {
        "$schema": _DRAFT,
        "title": "robot keys",
        "description": words,
        **_block({"keys": keys, "ignored": ignore_schema, "configuration_topic": {"type": "string", "pattern": "^/"}}),
    }


def _variable(variable: str, model: type[BaseModel], many: bool) -> dict[str, Any]:  # noqa: FBT001 - a row of the table
    block: dict[str, Any] = {"$ref": f"#/$defs/{model.__name__}"}
    if many:
        names = _pattern_of(Name)
        block = {"type": ["object", "null"], "propertyNames": {"pattern": names}, "additionalProperties": block}
    return {
        "$schema": _DRAFT,
        "title": variable,
        "description": sentence(inspect.getdoc(model)),
        "type": "object",
        "properties": {variable: block},
        "patternProperties": dict(_ANSIBLE),
        "required": [variable],
        "additionalProperties": False,
        "$defs": _definitions(model),
    }


def _pattern_of(annotation: Any) -> str:  # noqa: ANN401 - a type
    return str(TypeAdapter(annotation).json_schema()["pattern"])


def _models(model: type[BaseModel], seen_models: set[type[BaseModel]] | None = None) -> Iterator[type[BaseModel]]:
    """Yield the model and its nested models, each once."""
    seen_models = set() if seen_models is None else seen_models
    if model in seen_models:
        return
    seen_models.add(model)
    yield model
    for field in model.model_fields.values():
        item = _schema.item_of(field.annotation)
        inner = _schema.model_of(field.annotation if item is None else item)
        if inner is not None:
            yield from _models(inner, seen_models)


def _describe(model: type[BaseModel], schema: dict[str, Any]) -> None:
    """Replace pydantic's key titles by the descriptions."""
    schema.pop("title", None)
    schema["description"] = sentence(inspect.getdoc(model))
    for name, entry in schema["properties"].items():
        entry.pop("title", None)
        if words := key_description(model, name):
            entry["description"] = words
        for bound in model.model_fields[name].metadata:
            if isinstance(bound, MaxLen) and entry.get("type") == "string":
                entry["maxLength"] = bound.max_length


def _hosts() -> dict[str, Any]:
    host = {"type": ["object", "null"], "patternProperties": dict(_ANSIBLE), "additionalProperties": False}
    names = {"pattern": _pattern_of(Name)}
    hosts = {"type": ["object", "null"], "propertyNames": names, "additionalProperties": host}
    group = _block({"hosts": hosts, "vars": host})
    sites = {"type": "object", "propertyNames": names, "minProperties": 1, "additionalProperties": group}
    groups = _block(
        {"sites": _block({"children": sites, "vars": host}, "children"), **dict.fromkeys(KIND_GROUPS, group)}
    )
    groups["required"] = ["sites"]
    everything = _block({"children": groups, "vars": host}, "children")
    schema = _block({"all": everything}, "all")
    words = "Every host of the pilot: once under its site, once under what it is."
    return {"$schema": _DRAFT, "title": "hosts", "description": words, **schema}


def _block(properties: Mapping[str, Any], *required_keys: str) -> dict[str, Any]:
    kind: Any = "object" if required_keys else ["object", "null"]
    block = {"type": kind, "properties": dict(properties), "additionalProperties": False}
    return {**block, "required": list(required_keys)} if required_keys else block


if __name__ == "__main__":
    for schema_path in write(Path(sys.argv[1]) if len(sys.argv) > 1 else Path("inventory")):
        print(schema_path)  # noqa: T201 - a tool for developers
