"""Which paths and fields community.routeros' `api_modify` takes for a RouterOS version, asked of the collection.

Its table is private to the collection, so this only looks: path to the
names of its fields.
"""

from __future__ import annotations

import json
import sys

from ansible_collections.community.routeros.plugins.module_utils._api_data import PATHS, join_path


def main() -> None:
    """Print one JSON object."""
    known = {}
    for path, data in PATHS.items():
        understood, _ = data.provide_version(sys.argv[1])
        if understood:
            known[join_path(path)] = sorted(data.get_data().fields)
    print(json.dumps(known))


if __name__ == "__main__":
    main()
