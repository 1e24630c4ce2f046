"""What every part of the declaration shares: strict models, and the syntax of the values in them."""

from __future__ import annotations

import re
from ipaddress import IPv4Address, IPv4Interface, IPv4Network
from typing import Annotated, Any

from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, PlainSerializer

from atlantis_netcfg.secret import MASK, Secret

__all__ = ["Address", "HostName", "Interface", "MacAddress", "Model", "Name", "Network", "SecretText"]


class Model(BaseModel):
    """A part of the declaration: unknown keys are errors, values never change after loading."""

    model_config = ConfigDict(extra="forbid", frozen=True, arbitrary_types_allowed=True)


def _text(value: Any) -> Any:  # noqa: ANN401 - pydantic hands over whatever YAML held
    if not isinstance(value, str):
        raise ValueError("write it as text")  # noqa: TRY004 - pydantic reports ValueError, not TypeError
    return value.strip()


def _secret(value: Any) -> Any:  # noqa: ANN401 - as above
    return Secret(_text(value)) if not isinstance(value, Secret) else value


def _mac(value: str) -> str:
    if not re.fullmatch(r"(?:[0-9A-Fa-f]{2}:){5}[0-9A-Fa-f]{2}", value):
        raise ValueError("a MAC address is six pairs of hex digits, like 02:00:5E:00:53:01")
    if int(value[:2], 16) & 1:
        raise ValueError("this is a multicast MAC address; a device has an even first byte")
    return value.upper()


def _name(value: str) -> str:
    if not re.fullmatch(r"[a-z0-9](?:[a-z0-9-]{0,30}[a-z0-9])?", value):
        raise ValueError("a name has lower-case letters, digits and hyphens inside, 32 at most")
    return value


Address = Annotated[IPv4Address, BeforeValidator(_text)]
Network = Annotated[IPv4Network, BeforeValidator(_text)]
Interface = Annotated[IPv4Interface, BeforeValidator(_text)]
MacAddress = Annotated[str, AfterValidator(_mac)]
"""An EUI-48 address, upper case, as RouterOS prints it."""
Name = Annotated[str, AfterValidator(_name)]
"""A name of ours (site, bearer, vehicle): an RFC 1123 label of at most 32 characters."""
HostName = Annotated[str, AfterValidator(_name)]
"""The inventory's name of a host."""
SecretText = Annotated[Secret, BeforeValidator(_secret), PlainSerializer(lambda _: MASK, return_type=str)]
