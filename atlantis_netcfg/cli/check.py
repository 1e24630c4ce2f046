"""`provision check`: the pre-test checklist of a site, probed, confirmed by people, signed, reported."""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.cli._arguments import ACCEPT_COST, ASK_VAULT_PASS, INVENTORY, JSON, VIA, Command, Flag, Word

if TYPE_CHECKING:
    from atlantis_netcfg.cli._arguments import Arguments
    from atlantis_netcfg.core.errors import ExitCode

COMMAND = Command(
    "check",
    "go through the pre-test checklist of a site: what a program sees, what people confirm, who signs",
    words=(
        Word("site", "the site", required=True, example="coastal"),
        Word("vehicle", "only these vehicles", many=True, example="sparus"),
        Word(
            "endpoint",
            "only these columns of Table 3, the Ethernet beside it, or the site's own checks",
            many=True,
            choices=("wifi", "acoustic", "satellite", "usbl", "rc_rf", "4g", "gps", "ethernet", "site"),
        ),
        Word("phase", "only what is due there", many=True, choices=("bench", "quay", "in-water")),
        Word("break", "rehearsal: break these things first, for training", many=True, example="rogue-dhcp"),
        VIA,
        INVENTORY,
    ),
    flags=(
        Flag("answers", "take consents and confirmations from this file, and ask nobody", takes="FILE"),
        Flag("anew", "begin again, where an interrupted checklist would go on"),
        Flag("sign-as", "sign with this name when nothing is open, without asking", takes="NAME"),
        Flag("rehearse", "the same with emulated vehicles and devices of the site"),
        ACCEPT_COST,
        ASK_VAULT_PASS,
        JSON,
    ),
    details=(
        "Each result and each answer is kept at once; type the same again to go on after a break. Nothing is sent into "
        "the water, and nothing is paid for, without a person's word. Exit code 0: all is green or taken on somebody's "
        "word, 6: something is not, or is open, 7: nothing was checked."
    ),
)


def run(arguments: Arguments) -> ExitCode:
    """Work out the list, open its book, look and ask, tell."""
    from atlantis_netcfg.cli._checking.sitting import run_check

    return run_check(arguments)
