"""Plays rounds of faults, each from its seed; one JSON line a round on stdout. Has to be in a network of its own.

`python -P -m campaign --folder DIR --references DIR SEED...`; `tests/campaign/test_faults.py` starts it.
"""

import argparse
import json
import sys
import traceback
from pathlib import Path

from campaign.judge import Stranger
from campaign.rounds import Player
from campaign.site import Stage


def main() -> int:
    """Play every seed, also after one has failed."""
    parser = argparse.ArgumentParser(prog="campaign")
    parser.add_argument("--folder", type=Path, required=True, help="what rounds leave when they fail")
    parser.add_argument(
        "--references", type=Path, required=True, help="configured devices, made once for all processes"
    )
    parser.add_argument("seeds", type=int, nargs="+")
    given = parser.parse_args()
    given.folder.mkdir(parents=True, exist_ok=True)
    with Stage(given.folder) as stage, Stranger(given.folder) as stranger:
        player = Player(stage, stranger, given.references)
        for seed in given.seeds:
            try:
                record = player.play(seed)
            except Exception:  # noqa: BLE001 - the other seeds are played nevertheless
                record = {"seed": seed, "violations": [f"the driver failed: {traceback.format_exc()}"]}
            sys.stdout.write(json.dumps(record) + "\n")
            sys.stdout.flush()
    return 0


if __name__ == "__main__":
    sys.exit(main())
