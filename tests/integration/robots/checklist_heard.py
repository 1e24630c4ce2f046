"""A real checklist's robots' items, asked on this computer at the site's LAN of a namespace: prints the verdicts."""

import asyncio
import json
import sys
from dataclasses import replace
from pathlib import Path

from atlantis_netcfg.checklist import Scope, plan
from atlantis_netcfg.checklist.report import ItemKind
from atlantis_netcfg.checklist.runner import RealTransport, examine
from atlantis_netcfg.inventory import load
from atlantis_netcfg.operations.common.request import Mode, Request


def main(state: Path) -> None:
    shipped = load(Path(__file__).parents[3] / "inventory")
    # Only who asks takes the addresses for real ones: the robots' files are full of examples.
    declaration = replace(shipped, pilot=shipped.pilot.model_copy(update={"example_values": False}))
    entries = [
        entry
        for entry in plan(shipped, "coastal", Scope(endpoints=("robot",))).entries
        if entry.item.kind is not ItemKind.PERSON
    ]
    ears = RealTransport(declaration, "coastal", Request(state=state, mode=Mode.DRIFT))
    items = asyncio.run(examine(entries, ears, lambda _: None, state=lambda: state))
    rows = {item.id: [item.verdict.value, item.message, *(each.value for each in item.evidence)] for item in items}
    sys.stdout.write(json.dumps(rows))


if __name__ == "__main__":
    main(Path(sys.argv[1]))
