"""Secrets are vaulted, and what is an example is known to be one."""

from __future__ import annotations

from ipaddress import AddressValueError, IPv4Address, IPv4Network
from typing import TYPE_CHECKING

from pydantic import BaseModel

from atlantis_netcfg.core.secret import EXAMPLE_PREFIX, Secret
from atlantis_netcfg.declaration._draft import Draft, Part, Rule
from atlantis_netcfg.declaration._yaml import SealedSecret
from atlantis_netcfg.declaration.findings import Finding

if TYPE_CHECKING:
    from collections.abc import Iterator

DOCUMENTATION = tuple(IPv4Network(net) for net in ("192.0.2.0/24", "198.51.100.0/24", "203.0.113.0/24"))
"""RFC 5737."""
_EXAMPLE_NAMES = ("example", "example.com", "example.net", "example.org", "test", "invalid")
"""RFC 2606."""


def in_clear(draft: Draft) -> Iterator[Finding]:
    """A real secret never stands readable in a file that goes into git."""
    for part, model in _holders(draft):
        for path, secret in _secrets(model):
            vaulted = isinstance(draft.nodes[part].at(*path).value, Secret)
            if not vaulted and not secret.is_example:
                name = str(path[-1])
                message = f"`{name}` stands in clear text"
                yield draft.wrong(part, path, message, f"ansible-vault encrypt_string --stdin-name {name}")


def printable(draft: Draft) -> Iterator[Finding]:
    """A secret can be typed on a console."""
    for part, model in _holders(draft):
        for path, secret in _secrets(model):
            if not isinstance(secret, SealedSecret) and not (secret.reveal() and secret.reveal().isprintable()):
                message = f"`{path[-1]}` is empty, or has a line break or another control character"
                yield draft.wrong(part, path, message, "make another one")


def _holders(draft: Draft) -> Iterator[tuple[Part, BaseModel]]:
    """Every part that may hold a secret."""
    if draft.pilot is not None:
        yield Part("pilot"), draft.pilot
    for host, device in draft.devices.items():
        yield Part("device", host), device


def _secrets(model: BaseModel, path: tuple[str | int, ...] = ()) -> Iterator[tuple[tuple[str | int, ...], Secret]]:
    for name in type(model).model_fields:
        value = getattr(model, name)
        for step, inner in (
            [((name, index), item) for index, item in enumerate(value)]
            if isinstance(value, tuple)
            else [((name,), value)]
        ):
            if isinstance(inner, Secret):
                yield (*path, *step), inner
            elif isinstance(inner, BaseModel):
                yield from _secrets(inner, (*path, *step))


def examples_left(draft: Draft) -> Iterator[Finding]:
    """`example_values: false` is true: nothing that was shipped as an example is left."""
    if draft.pilot is None or draft.pilot.example_values:
        return
    where = draft.where(Part("pilot"), "example_values")
    for node in draft.nodes.values():
        for scalar in node.scalars():
            if what := _example(scalar.value):
                message = f"{what} is still an example, but `example_values` is false ({where})"
                hint = "write the real value, or set `example_values: true`"
                yield Finding.at(scalar.mark, message, hint)


def _example(value: object) -> str | None:
    text = value if isinstance(value, str) else ""
    if text.startswith(EXAMPLE_PREFIX):
        return f"what begins with {EXAMPLE_PREFIX}"
    if any(text.lower().rstrip(".").endswith(f".{name}") or text.lower() == name for name in _EXAMPLE_NAMES):
        return f"{text} (a name of RFC 2606)"
    try:
        address = IPv4Address(text.partition("/")[0].strip())
    except AddressValueError:
        return None
    if any(address in block for block in DOCUMENTATION):
        return f"{text.strip()} (a documentation address, RFC 5737)"
    return None


RULES: tuple[Rule, ...] = (in_clear, printable, examples_left)
