"""The Debian trees that tests start machines from; `tools/trees [full|campaign]` builds them before the tests do."""

import sys
from pathlib import Path

from atlantis_netcfg.computers.containers import PACKAGES
from atlantis_netcfg.emulator.lab import MachineError, TreeSpec, build_rootfs, why_not
from atlantis_netcfg.inventory import load
from atlantis_netcfg.operations.computers._emulation import tree_spec

BARE = TreeSpec()
GATEWAY = tree_spec(load(Path(__file__).parents[1] / "inventory"))
"""That of a rehearsal of the shipped inventory, so that one tree is built for both."""
CONTAINERS = TreeSpec(packages=tuple(sorted({*GATEWAY.packages, *PACKAGES})))
NETWORK = TreeSpec(packages=("ifupdown", "netplan.io"))
CLOCK = TreeSpec(packages=("chrony", "fake-hwclock", "linux-image-cloud-amd64", "locales", "nftables", "wpasupplicant"))
RADIOS = TreeSpec(packages=("hostapd", "iputils-ping", "iw", "linux-image-amd64", "wpasupplicant"))
TREES = {
    "test": (GATEWAY, BARE),
    "full": (CONTAINERS, GATEWAY, NETWORK, BARE),
    "campaign": (CONTAINERS, GATEWAY, NETWORK, BARE, CLOCK, RADIOS),
}
"""By what is run: `make test`, all tests, or the campaign, which also needs whole computers with a kernel."""


def main(words: list[str]) -> int:
    """Build the trees that are missing; say in one line why machines cannot run here, which is no failure."""
    name = " ".join(words) or "test"
    if name not in TREES:
        sys.stderr.write(f"error: unknown argument `{name}`; type: tools/trees [full|campaign]\n")
        return 3
    if (reason := why_not()) is not None:
        sys.stdout.write(f"      tests of machines are skipped: {reason}\n")
        return 0
    try:
        for spec in TREES[name]:
            build_rootfs(spec)
    except MachineError as error:
        sys.stderr.write(f"error: {error}\n       {error.hint}\n")
        return 3
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
