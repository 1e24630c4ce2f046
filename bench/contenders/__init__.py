"""Those who are measured: one file each."""

from __future__ import annotations

from typing import TYPE_CHECKING

from bench.contenders.collection import Collection
from bench.contenders.librouteros import Librouteros
from bench.contenders.napalm import Napalm
from bench.contenders.netmiko import Netmiko
from bench.contenders.ours import Ours

if TYPE_CHECKING:
    from bench.job import Contender

__all__ = ["ALL"]

ALL: tuple[Contender, ...] = (Ours(), Collection(), Librouteros(), Napalm(), Netmiko())
