"""Action `atlantis.netcfg.clock`: stands before the module of that name, which documents it."""

from __future__ import annotations

from atlantis_netcfg.ansible_collections.atlantis.netcfg.plugins.plugin_utils.thin import Thin


class ActionModule(Thin):
    """The module `clock`, run out of the tool that the gateway keeps."""

    module = "clock"
