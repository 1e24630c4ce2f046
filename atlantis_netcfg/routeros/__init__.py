"""The RouterOS engine: desired text against observed rows gives a plan; a plan is applied under the device's safe mode.

Text and rows are compared by a table of menus and one generic planner without I/O. The executor takes safe mode, writes
layer by layer, proves from a new session that the device is still reachable and as declared, then releases or unrolls.
What counts is what was read back: after a run the second plan is empty, or the run failed.
"""
