"""`roles/<role>/meta/argument_specs.yml`, made from the model: the role's contract for Ansible and for `ansible-doc`.

Ansible checks types and choices with it, nothing else; what must hold is checked by `validate` before Ansible starts.
`python -m atlantis_netcfg.declaration.argument_specs` writes the files; a test holds them equal to the model.
"""

from __future__ import annotations

import ast
import inspect
import sys
from enum import Enum
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

import yaml
from pydantic_core import PydanticUndefined

from atlantis_netcfg.core.secret import Secret
from atlantis_netcfg.declaration import _schema
from atlantis_netcfg.declaration.model import Gateway, LteRouter, Pilot, Router, SatelliteTerminal, Site, VpnServer

if TYPE_CHECKING:
    from collections.abc import Mapping

    from pydantic import BaseModel
    from pydantic.fields import FieldInfo

ROLES: Mapping[str, tuple[str, Mapping[str, type[BaseModel]]]] = {
    "routeros": (
        "Bring RouterOS devices to their declared state",
        {"pilot": Pilot, "site": Site, "device": Router},
    ),
    "lte": (
        "Bring 4G units of other makes than MikroTik to what is declared of their SIM, or check it",
        {"pilot": Pilot, "site": Site, "device": LteRouter},
    ),
    "gateway_base": (
        "Give gateway computers their locale, name, time, SSH by key, firewall, bounded journal and watchdog",
        {"pilot": Pilot, "site": Site, "device": Gateway},
    ),
    "openvpn_client": (
        "Make gateway computers members of the VPN, with the identities that they were handed",
        {"pilot": Pilot, "site": Site, "device": Gateway},
    ),
    "gateway_ros2": (
        "Install ROS 2 on gateway computers from the declared archive, and let a listener hear a talker",
        {"pilot": Pilot, "site": Site, "device": Gateway},
    ),
    "gateway_interop": (
        "Build the interoperability library with its examples, and run the data gateway as a service",
        {"pilot": Pilot, "site": Site, "device": Gateway},
    ),
    "gateway_dds": (
        "Lay down the DDS profiles of gateway computers, and the environment that names the one in use",
        {"pilot": Pilot, "site": Site, "device": Gateway},
    ),
    "openvpn_server": (
        "Run the server of the VPN with its members and its firewall, from the declaration and the authority's record",
        {"pilot": Pilot, "site": Site, "device": VpnServer},
    ),
    "satellite_terminal": (
        "Compare what is declared of satellite terminals with the evidence",
        {"pilot": Pilot, "site": Site, "device": SatelliteTerminal},
    ),
}
"""Role -> what it is for, and the variables that it takes."""
_HEADER = """\
# Made from atlantis_netcfg/declaration by `python -m atlantis_netcfg.declaration.argument_specs`: change that.
---
"""
_TYPES = {int: "int", float: "float", bool: "bool"}


def text(role: str) -> str:
    """The role's argument_specs.yml."""
    purpose, variables = ROLES[role]
    options = {
        name: {"type": "dict", "required": True, "description": sentence(model.__doc__), "options": _options(model)}
        for name, model in variables.items()
    }
    specs = {"argument_specs": {"main": {"short_description": purpose, "options": options}}}
    return _HEADER + yaml.dump(specs, Dumper=_Dumper, sort_keys=False, width=120, allow_unicode=True)


def write(roles: Path) -> list[Path]:
    """Write the files of all roles below `roles`."""
    written = []
    for role in ROLES:
        path = roles / role / "meta" / "argument_specs.yml"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text(role), encoding="utf-8")
        written.append(path)
    return written


def _options(model: type[BaseModel]) -> dict[str, Any]:
    docs = field_docs(model)
    return {name: _option(field, docs.get(name)) for name, field in model.model_fields.items()}


def _option(field: FieldInfo, doc: str | None) -> dict[str, Any]:
    annotation = field.annotation
    item = _schema.item_of(annotation)
    model = _schema.model_of(annotation if item is None else item)
    plain = _schema.unwrap(annotation if item is None else item)
    local = plain.__doc__ if model is not None or (isinstance(plain, type) and issubclass(plain, Enum)) else None
    about = doc or local or _schema.expected_type(annotation)
    option: dict[str, Any] = {"type": _type(annotation), "description": sentence(about)}
    if field.is_required():
        option["required"] = True
    elif (default := _default(field)) is not None:
        option["default"] = default
    if item is not None:
        option["elements"] = _type(item)
    if words := _schema.choices_of(annotation if item is None else item):
        option["choices"] = list(words)
    if _schema.unwrap(annotation) is Secret:
        option["no_log"] = True
    if model is not None:
        option["options"] = _options(model)
    return option


def _type(annotation: Any) -> str:  # noqa: ANN401 - a type, whatever it is
    if _schema.item_of(annotation) is not None:
        return "list"
    if _schema.model_of(annotation) is not None:
        return "dict"
    words = _schema.choices_of(annotation)
    plain = type(words[0]) if words else _schema.unwrap(annotation)
    return _TYPES.get(plain, "str")


def _default(field: FieldInfo) -> object:
    default = field.default
    if default is PydanticUndefined or _schema.model_of(field.annotation) is not None:
        return None
    if isinstance(default, Enum):
        return default.value
    return list(default) if isinstance(default, tuple) else default


@cache
def field_docs(model: type[BaseModel]) -> dict[str, str]:
    """The strings below the fields of a model and of what it inherits from."""
    docs: dict[str, str] = {}
    for cls in reversed(model.__mro__):
        if not cls.__module__.startswith(f"{_schema.MODEL}."):
            continue
        (definition,) = ast.parse(inspect.getsource(cls)).body
        body = definition.body if isinstance(definition, ast.ClassDef) else []
        for field, below in pairwise(body):
            if not isinstance(below, ast.Expr) or not isinstance(below.value, ast.Constant):
                continue
            if isinstance(field, ast.AnnAssign) and isinstance(field.target, ast.Name):
                docs[field.target.id] = str(below.value.value)
    return docs


def meaning(model: type[BaseModel], name: str) -> str:
    """What a key is for: its own words, else those of the block or choice that it holds. Empty: nobody has said."""
    annotation = model.model_fields[name].annotation
    item = _schema.item_of(annotation)
    inner = _schema.unwrap(annotation if item is None else item)
    is_ours = isinstance(inner, type) and inner.__module__.startswith(f"{_schema.MODEL}.")
    words = field_docs(model).get(name) or (inspect.getdoc(inner) if is_ours else None)
    return sentence(words) if words else ""


def sentence(words: str | None) -> str:
    """One paragraph that begins like a sentence and ends like one."""
    plain = " ".join((words or "").split())
    return plain[:1].upper() + plain[1:] + ("" if plain.endswith(".") else ".")


class _Dumper(yaml.SafeDumper):
    """Indents lists, as yamllint wants it."""

    def increase_indent(self, flow: bool = False, indentless: bool = False) -> None:  # noqa: ARG002, FBT001, FBT002
        super().increase_indent(flow, indentless=False)


if __name__ == "__main__":
    for made in write(Path(sys.argv[1]) if len(sys.argv) > 1 else Path("roles")):
        print(made)  # noqa: T201 - a tool for developers
