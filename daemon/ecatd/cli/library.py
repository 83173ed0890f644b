"""Command `generate`: from the live bus to a Modelica library."""

from __future__ import annotations

import argparse

from ecatd.client.remote import Remote

from .output import print_json


def generate(remote: Remote, options: argparse.Namespace) -> None:
    """Writes a Modelica library for the bus."""
    from ecatgen import generate as write_library  # only this command needs the templates

    bus = remote.describe()
    report = write_library(bus, options.name, options.out)
    if options.json:
        print_json(report.to_dict())
        return
    print(report.summary())
