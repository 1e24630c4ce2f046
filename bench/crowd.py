"""A no-op over many routers: twins in a few processes, one process of ours for all of them."""

from __future__ import annotations

import json
import socket
import sys
from contextlib import ExitStack
from typing import TYPE_CHECKING

from atlantis_netcfg.core.errors import ExitCode
from atlantis_netcfg.emulator.routeros import EmulatorSpec, RouterLink, SiteSpec, spawn
from atlantis_netcfg.inventory import load
from atlantis_netcfg.operations.common.rehearsal import site_spec
from atlantis_netcfg.routeros.render import router
from bench import edits, measure
from bench.declared import CHECKOUT
from bench.figures import Crowd
from bench.job import Command
from bench.many import many, name

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from pathlib import Path

    from atlantis_netcfg.inventory import Inventory

__all__ = ["crowds"]

_PER_PROCESS = 125
"""Twins in one process."""


def crowds(sizes: Sequence[tuple[int, int]], folder: Path) -> Iterator[Crowd]:
    """Measure a no-op over so many routers, of which so many are silent: ships with names and addresses of their own.

    Each size has an inventory of its own, since loading and validating that is part of what a run takes.
    """
    for size, silent in sizes:
        place = folder / f"crowd-{size}-{silent}"
        place.mkdir()
        inventory = many(CHECKOUT / "inventory", place / "inventory", size)
        yield _crowd(load(inventory), inventory, size, silent, place)


def _crowd(declaration: Inventory, inventory: Path, size: int, silent: int, place: Path) -> Crowd:
    names = [f"{name(number)}-router" for number in range(size)]
    with ExitStack() as stack:
        targets = place / "targets"
        # It listens and never accepts: TCP's handshake is all that is heard of it.
        mute = stack.enter_context(socket.create_server(("127.0.0.1", 0)))
        lines = [f"{names.pop(0)}=127.0.0.1:{mute.getsockname()[1]}:{'00' * 32}" for _ in range(silent)]
        for start in range(0, len(names), _PER_PROCESS):
            part = tuple(_finished(declaration, item) for item in names[start : start + _PER_PROCESS])
            home = place / f"twins-{start}"
            home.mkdir()
            twins = stack.enter_context(spawn(SiteSpec(name=f"crowd-{start}", emulators=part), home))
            lines += [f"{entry}={at['host']}:{at['api_ssl']}:{at['pin']}" for entry, at in twins.ready.items()]
        targets.write_text("\n".join(lines), encoding="utf-8")
        argv = (sys.executable, "-m", "bench.engine", str(inventory), str(place / "state"), f"@{targets}")
        ran = measure.run_command(Command(argv, {"ANSIBLE_CONFIG": str(CHECKOUT / "ansible.cfg")}), place)
    unchanged = ran.output.count("no changes needed")
    good = ran.code == (ExitCode.FAILED if silent else ExitCode.DONE) and unchanged == size - silent
    failure = "" if good else f"{size - unchanged} of {size} were not found as in the inventory"
    engine_s = json.loads(ran.output.splitlines()[-1])["engine_s"] if good else 0.0
    return Crowd(size, silent, ran.cost, engine_s, failure)


def _finished(declaration: Inventory, item: str) -> EmulatorSpec:
    """A router that is as declared already, on a link without delay."""
    host = declaration.hosts[item]
    (twin,) = site_spec(declaration, [host]).emulators
    text = router(declaration, host)
    seed = "\n".join(edits.first_script(text, twin.router.management.local))
    ready = twin.router.model_copy(update={"seed": seed})
    return twin.model_copy(update={"router": ready, "link": RouterLink()})
