"""Action `atlantis.netcfg.minimum_version`: local side of the module of that name, which has the documentation."""

from __future__ import annotations

from atlantis_netcfg.ansible_collections.atlantis.netcfg.plugins.plugin_utils.zipapp_action import ZipappAction


class ActionModule(ZipappAction):
    """Runs the module `minimum_version` from the zipapp installed on the computer."""

    module = "minimum_version"
