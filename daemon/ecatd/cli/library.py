"""Commands `generate` and `client-flags`: what programs and models are built from."""

from __future__ import annotations

import argparse
import shlex
from importlib import import_module
from pathlib import Path

from ecatd.client.remote import Remote
from ecatd.model.errors import EcatError

from .output import print_json


def generate(remote: Remote, options: argparse.Namespace) -> None:
    """Writes a Modelica library for the bus."""
    from ecatgen import generate as write_library  # only this command needs the templates

    bus = remote.describe()
    report = write_library(bus, options.name, options.out)
    if options.json:
        print_json({"bus": bus.name, **report.to_dict()})
        return
    print(report.summary())


def client_flags(options: argparse.Namespace) -> None:
    """Prints what a C compiler needs to build a program with the client."""
    for folder in import_module("ecatgen").__path__:
        client = Path(folder) / "_client"
        if client.is_dir():
            break
    else:
        raise EcatError("the C client is not built: install the package (`pip install .`)")
    flags = [f"-I{client / 'include'}", str(client / "lib" / "libecat.a"), "-lm"]
    if options.json:
        print_json({"flags": flags})
    else:
        print(shlex.join(flags))
