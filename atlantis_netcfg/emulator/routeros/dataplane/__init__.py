"""The data plane of an emulated router: a network namespace of Linux that carries packets as its current rows say."""
