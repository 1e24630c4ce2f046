"""Templates to desired text: what a device should contain, in the syntax that technicians read on it.

A template (`templates/` of the checkout) only loops and decides. What it prints is prepared in a view, a frozen object
that is a pure function of the inventory. Misspelled names in a template are errors, never empty text.
"""

from __future__ import annotations

from atlantis_netcfg.routeros.render._cpe import CpeView, cpe, cpe_prerequisites, cpe_view, radio_name
from atlantis_netcfg.routeros.render._environment import environment, get_template_cache, nft_comment, template_folder
from atlantis_netcfg.routeros.render._links import LteView, lte, lte_link, lte_prerequisites, lte_view
from atlantis_netcfg.routeros.render._router import prerequisites, router, router_view
from atlantis_netcfg.routeros.render._switch import switch, switch_prerequisites
from atlantis_netcfg.routeros.render.view import Prerequisite, RadioView, RenderError, RouterView

__all__ = [
    "CpeView",
    "LteView",
    "Prerequisite",
    "RadioView",
    "RenderError",
    "RouterView",
    "cpe",
    "cpe_prerequisites",
    "cpe_view",
    "environment",
    "get_template_cache",
    "lte",
    "lte_link",
    "lte_prerequisites",
    "lte_view",
    "nft_comment",
    "prerequisites",
    "radio_name",
    "router",
    "router_view",
    "switch",
    "switch_prerequisites",
    "template_folder",
]
