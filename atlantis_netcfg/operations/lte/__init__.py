"""4G units that are not RouterOS, in a run."""
