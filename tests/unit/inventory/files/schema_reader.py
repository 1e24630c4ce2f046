"""A reader of the schemas that we did not write: `jsonschema`, and YAML as an editor reads it."""

import json
import re
from pathlib import Path
from typing import Any

import yaml
from jsonschema import Draft202012Validator

from atlantis_netcfg.inventory.json_schema import FOLDER

_MODELINE = re.compile(r"# yaml-language-server: \$schema=(\S+)")


class EditorLoader(yaml.SafeLoader):
    """YAML with `!vault`, and with days as the text they are."""


def _vaulted(loader: yaml.SafeLoader, node: yaml.ScalarNode) -> object:
    return loader.construct_scalar(node)


EditorLoader.add_constructor("!vault", _vaulted)
EditorLoader.yaml_implicit_resolvers = {
    first: [(tag, pattern) for tag, pattern in resolvers if tag != "tag:yaml.org,2002:timestamp"]
    for first, resolvers in yaml.SafeLoader.yaml_implicit_resolvers.items()
}


def files(inventory: Path) -> list[Path]:
    return sorted(path for path in inventory.rglob("*.yml") if FOLDER not in path.parts)


def schema_of(path: Path) -> Path | None:
    first = path.read_text(encoding="utf-8").partition("\n")[0]
    found = _MODELINE.fullmatch(first)
    return (path.parent / found[1]).resolve() if found else None


def problems(path: Path, schema: Path) -> list[str]:
    """What the independent reader says of a file. Raises yaml.YAMLError where it is no YAML."""
    document: Any = yaml.load(path.read_text(encoding="utf-8"), Loader=EditorLoader)  # noqa: S506 - it is a SafeLoader
    checker = Draft202012Validator(json.loads(schema.read_text(encoding="utf-8")))
    return [f"{'/'.join(map(str, error.absolute_path))}: {error.message}" for error in checker.iter_errors(document)]
