"""ATLANTIS provisioning toolkit: from boxes of hardware to a verified maritime-robotics test site.

An inventory declares the pilot; pure planners compare it with what was observed on the devices; one executor applies
the difference under the device's own protection and reports what it read back. Every package below does one of these
steps, and data flows one way: `inventory` -> capability package (`routeros`, `links`, `computers`) -> `runs`, events.
"""

__version__ = "0.1.0"
