"""This computer as a place: the program that listens, in a process of its own."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Mapping

    from atlantis_netcfg.operations.checking._ears import Asked, Heard
    from atlantis_netcfg.probes import Answer

__all__ = ["ask_here"]


async def ask_here(questions: Asked, heard: Heard) -> Mapping[str, Answer]:
    """Ask Listen, Run and Probing on this computer. Raises nothing: what cannot be asked answers NO_PLACE."""
    raise NotImplementedError
