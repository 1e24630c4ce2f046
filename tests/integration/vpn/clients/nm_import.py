"""What NetworkManager makes of profiles: PLUGIN FILE… to JSON lines; run by the system's Python, which has gi.

The plugin is the one that `nmcli connection import` and the settings of desktops load; no daemon takes part.
"""

import json
import sys
from typing import Any

import gi  # type: ignore[import-not-found] # the system's Python has it, ours has not

gi.require_version("NM", "1.0")
from gi.repository import NM  # type: ignore[import-not-found] # noqa: E402 - after the version was chosen


def main(library: str, *profiles: str) -> None:
    plugin = NM.VpnEditorPlugin.load(library, "org.freedesktop.NetworkManager.openvpn")
    for profile in profiles:
        told: dict[str, Any] = {}
        connection = plugin.import_(profile)
        connection.get_setting_vpn().foreach_data_item(told.__setitem__)
        sys.stdout.write(json.dumps({"id": connection.get_id(), **told}) + "\n")


if __name__ == "__main__":
    main(*sys.argv[1:])
