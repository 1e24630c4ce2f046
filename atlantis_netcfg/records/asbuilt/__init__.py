"""The record of what is built: what each device of a site says of itself, kept, compared and printed.

Every value says where it is from: read in this run, stored from an earlier one (with its time), or declared. A device
that did not answer is listed with its last known values, and nothing of it is green.
"""
