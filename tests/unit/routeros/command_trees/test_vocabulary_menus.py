"""The engine's table of menus and the twin's agree with the trees: names, shapes, first versions, words."""

from dataclasses import dataclass

from holes import SINCE_ABSENT, known
from row_subtests import for_each_row
from trees import EVERY_TREE, TREES, VERSIONS, Tree, offered

from atlantis_netcfg.core.versions import NEWEST_KNOWN, Version
from atlantis_netcfg.emulator.routeros import values
from atlantis_netcfg.emulator.routeros.menus import MODELLED_MENUS, OLD_WORDS
from atlantis_netcfg.emulator.routeros.schema import BOARD_FEATURES, Schema
from atlantis_netcfg.routeros.menus import MENUS, PropertyKind, Shape

_SHAPES = {Shape.LIST: "list", Shape.FIXED: "fixed", Shape.SINGLETON: "settings"}
FIRST_VERSIONS = tuple((Version.parse(tree.version), tree) for tree in EVERY_TREE)
CELLS = [(menu.path, field.name) for menu in MENUS.values() for field in menu.fields]


@dataclass(frozen=True, slots=True)
class Span:
    """Between which versions a name must have come, and gone, going by the trees alone."""

    came: tuple[Version | None, Version | None]
    """Later than the first, not later than the second; (None, None): it was there before the oldest tree."""
    went: tuple[Version | None, Version | None]


def span(seen: list[bool]) -> Span | None:
    """Read one name's history off the trees; None if none shows it."""
    if not any(seen):
        return None
    versions = [version for version, _ in FIRST_VERSIONS]
    first = seen.index(True)
    last = len(seen) - 1 - seen[::-1].index(True)
    came = (None, None) if first == 0 else (versions[first - 1], versions[first])
    went = (None, None) if last == len(seen) - 1 else (versions[last], versions[last + 1])
    return Span(came, went)


def history(path: str, name: str) -> Span | None:
    return span([name in tree.settable(path) for _, tree in FIRST_VERSIONS])


@for_each_row(("path", "name"), CELLS)
def test_since_and_until_of_a_field_match_the_trees(path: str, name: str) -> None:
    field, found = MENUS[path].by_name[name], history(path, name)
    if found is None:
        assert known(path, "set", name)
        return
    after, until = found.came
    if until is None:
        # The oldest tree shows it: what came before 7.16 is not decided by these trees.
        assert field.since is None or field.since <= Version(7, 16)
    else:
        assert field.since is not None
        assert after is not None
        assert after < field.since <= until
    after, until = found.went
    if until is None or (path, name) in SINCE_ABSENT:
        assert field.until is None or field.until > NEWEST_KNOWN
    else:
        assert field.until is not None
        assert after is not None
        assert after < field.until <= until


@for_each_row("path", MENUS)
def test_since_of_a_menu_matches_the_trees(path: str) -> None:
    menu, there = MENUS[path], [tree.has_menu(path) for tree in EVERY_TREE]
    assert all(there) or menu.since is not None
    for version, tree in FIRST_VERSIONS:
        assert tree.has_menu(path) == (menu.since is None or version >= menu.since)


RADIOS = ("/interface/wifi", "/interface/wireless")
"""The trees call these lists, because they also take virtual access points; to us they are the radios of the board."""


@for_each_row("path", MENUS)
@for_each_row("tree", TREES, ids=VERSIONS)
def test_menu_shapes_match_the_trees(path: str, tree: Tree) -> None:
    menu = MENUS[path]
    if menu.readonly:
        return
    assert _SHAPES[menu.shape] == ("fixed" if path in RADIOS else tree.shape(path))
    assert not menu.is_ordered or "move" in tree.commands(path)
    needed = {"list": {"add", "set", "remove", "print"}, "fixed": {"set", "print"}, "settings": {"set", "print"}}
    assert needed[tree.shape(path)] <= tree.commands(path)
    assert MODELLED_MENUS[path].shape.value == tree.shape(path)


REVIEWED_UNORDERED = {
    "/interface/bridge/port": "which port comes first changes nothing that we declare",
    "/ip/dns/static": "only regular expressions are looked up in order, and we declare names",
}
"""Menus that have `move`, and whose order we leave alone."""


def test_menus_with_move_are_ordered_or_reviewed() -> None:
    movable = {path for path in MENUS if "move" in TREES[1].commands(path)}
    ordered = {path for path, menu in MENUS.items() if menu.is_ordered}
    assert movable - ordered == {path for path in movable if path in REVIEWED_UNORDERED}
    assert ordered <= movable


WIDER = {
    ("/ip/cloud", "ddns-enabled"): {"no"},
    ("/ip/firewall/mangle", "connection-nat-state"): {"ein-snat", "ein-dnat"},
}
"""Words that the twin takes although the console of 7.21.5 does not offer them: `no` is how versions before 7.17 spell
off, and of the states of endpoint-independent NAT the manual's page Mangle tells as the page Filter does."""
OLD = {(path, name): set(words.old) for path, names in OLD_WORDS.items() for name, words in names.items()}
"""Words of versions before 7.21.5, which the twin refuses from the version on that renamed them."""
FREE = ("country", "protocol")
"""Last parts of arguments that also take numbers, or names that the console offers in quotes."""


def closed(kind: values.ValueType) -> set[str] | None:
    """Return the words of an enumeration, None for any other kind."""
    while isinstance(kind, values.Not):
        kind = kind.kind
    return set(kind.words) if isinstance(kind, values.Choice | values.Choices) else None


def test_enumerations_of_the_emulator_match_the_console() -> None:
    """Where the console offers a closed set, the twin takes all of it and nothing else."""
    checked, differing = 0, {}
    for path, menu in MODELLED_MENUS.items():
        for arg in menu.args:
            ours, theirs = closed(arg.kind), words(path, arg.name)
            if ours is None or not theirs or arg.name.rpartition(".")[2] in FREE:
                continue
            checked += 1
            if ours != theirs | WIDER.get((path, arg.name), set()) | OLD.get((path, arg.name), set()):
                differing[path, arg.name] = ours ^ theirs
    assert differing == {}
    assert checked > 100


def words(path: str, name: str) -> set[str]:
    found = offered().get(f"{path}/add {name}") or offered().get(f"{path}/set {name}") or []
    return {word.strip('"') for word in found if word not in ("!", ",", "!,")}


def test_countries_and_protocols_of_the_console_are_accepted() -> None:
    for path, menu in MODELLED_MENUS.items():
        for arg in menu.args:
            if arg.name.rpartition(".")[2] in FREE and (ours := closed(arg.kind)) is not None:
                assert words(path, arg.name) <= ours, (path, arg.name)


@for_each_row("path", MENUS)
def test_enumeration_defaults_are_console_values(path: str) -> None:
    twin = MODELLED_MENUS[path].by_name if path in MODELLED_MENUS else {}
    for field in MENUS[path].fields:
        if field.default and field.name in twin and closed(twin[field.name].kind) and words(path, field.name):
            assert set(field.default.split(",")) <= words(path, field.name), field.name


@for_each_row("path", MENUS)
def test_booleans_are_what_the_console_offers_yes_and_no_for(path: str) -> None:
    for field in MENUS[path].fields:
        if words(path, field.name) == {"yes", "no"}:
            assert field.kind in (PropertyKind.BOOLEAN, PropertyKind.FLAG, PropertyKind.TEXT), field.name
        elif field.kind is PropertyKind.BOOLEAN and words(path, field.name):
            raise AssertionError(f"{field.name} is more than yes or no: {sorted(words(path, field.name))}")


EVERY_VERSION = (
    *(
        "6.49.18",
        "7.8",
        "7.9.2",
        "7.10.2",
        "7.11.3",
        "7.12.2",
        "7.13.5",
        "7.14.3",
        "7.15.3",
        "7.16",
        "7.16.2",
        "7.17.1",
    ),
    *("7.18", "7.18.2", "7.19", "7.19.6", "7.20", "7.20.8", "7.21", "7.21.4", "7.21.5", "7.22", "7.23", "7.24"),
)


@for_each_row("version", EVERY_VERSION)
def test_engine_assumes_no_field_that_the_emulator_lacks(version: str) -> None:
    """Between and below the trees the two tables are kept apart; what the engine believes in, the twin must have."""
    schema = Schema(version, ("routeros", "wireless"), BOARD_FEATURES)
    believed = []
    for path, menu in MENUS.items():
        if menu.since is not None and Version.parse(version) < menu.since:
            assert not schema.has_menu(path)
            continue
        assert schema.has_menu(path), path
        if menu.readonly:
            continue
        taken = schema.arguments(path, "add") | schema.arguments(path, "set")
        for field in menu.fields:
            key = known(path, "set", field.name) and field.name in menu.keys
            if field.exists(Version.parse(version)) and field.name not in taken and not key:
                believed.append(f"{path} {field.name}")
    assert believed == []
