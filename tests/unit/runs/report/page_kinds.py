"""One example of every kind of HTML page that the product writes."""

from collections.abc import Callable, Mapping
from functools import cache
from pathlib import Path

import checklist_example
from asbuilt_examples import GATEWAY, away, port, record, router, terminal
from example_runs import measured_run, samples_text
from handout_mint import identity
from survey_examples import point, survey

from atlantis_netcfg.checklist.report import _pages as checklist_pages
from atlantis_netcfg.inventory import Inventory, load
from atlantis_netcfg.links.qualify.record import make_record
from atlantis_netcfg.links.qualify.samples import read
from atlantis_netcfg.records.asbuilt import pages as asbuilt_pages
from atlantis_netcfg.records.qualify import pages as qualify_pages
from atlantis_netcfg.records.qualify.plots import plots
from atlantis_netcfg.records.survey.page import render_page
from atlantis_netcfg.vpn.enrolment_package import contents

ROOT = Path(__file__).parents[4]


@cache
def _inventory() -> Inventory:
    return load(ROOT / "inventory")


def checklist() -> bytes:
    return checklist_pages.html(checklist_example.example(), checklist_example.files())


def as_built() -> bytes:
    devices = (router("EXAMPLE1", port(neighbours=(GATEWAY,))), terminal(), away(name="coastal-cpe"))
    return asbuilt_pages.html(record(*devices, rehearsed=True), "0123456789abcdef" * 4)


def qualified_link() -> bytes:
    samples = [*read(samples_text().splitlines(keepends=True))]
    made = make_record(measured_run(), samples)
    return qualify_pages.html(made, plots(made, samples))


def coverage() -> bytes:
    places = ((41.6864, -8.8388, -84.0), (41.69, -8.85, -112.0), (41.7, -8.86, None))
    points = (
        point(number, latitude=latitude, longitude=longitude, rsrp_dbm=level)
        for number, (latitude, longitude, level) in enumerate(places, start=1)
    )
    return render_page(survey(*points, emulated=True))


def enrolment() -> bytes:
    return contents(_inventory(), identity(), contact="Example Person, +00 000, vpn@example.org")[
        "README.html"
    ].encode()


PAGES: Mapping[str, Callable[[], bytes]] = {
    "checklist": checklist,
    "as-built": as_built,
    "qualify": qualified_link,
    "survey": coverage,
    "enrolment": enrolment,
}
REHEARSALS = ("checklist", "as-built", "qualify", "survey")
VERDICTS = {"checklist": "ERROR", "as-built": "NOT REACHED", "qualify": "PASS"}
