"""The as-built record: what each device of a site reports about itself, saved, compared and printed.

Every value has its origin: read in this run, stored from an earlier one (with its time), or from the inventory. A
device that did not respond is listed with its last known values, none of which count as green.
"""
