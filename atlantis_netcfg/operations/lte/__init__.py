"""4G units without RouterOS in a run."""
