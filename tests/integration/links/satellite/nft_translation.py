"""The product's translation into nftables, of a rendered text instead of an emulated router's rows."""

from atlantis_netcfg.emulator.routeros.dataplane import ruleset
from atlantis_netcfg.routeros.rsc import Export


def translate(export: Export) -> ruleset.NftRuleset:
    """Raises ValueError for a row that Linux cannot stand for."""
    rows = [
        ruleset.FirewallRow(row.menu, {name: str(value) for name, value in row.values})
        for row in export.statements
        if row.menu in ruleset.MENUS
    ]
    lists = {row.get(name): () for row in rows for name in ("src-address-list", "dst-address-list") if row.get(name)}
    names = ruleset.RowReferences(
        interface_lists=_grouped(export, "/interface/list/member", "interface"),
        address_lists={
            **{name.removeprefix("!"): () for name in lists},
            **_grouped(export, "/ip/firewall/address-list", "address"),
        },
    )
    result = ruleset.translate(rows, names)
    if result.limits:
        raise ValueError("; ".join(result.limits))
    return result


def _grouped(export: Export, menu: str, column: str) -> dict[str, tuple[str, ...]]:
    found: dict[str, list[str]] = {}
    for row in export.statements:
        if row.menu == menu:
            found.setdefault(str(row.get("list")), []).append(str(row.get(column)))
    return {name: tuple(values) for name, values in found.items()}
