"""Runs python-can's own tests on buses of ecatd: `python_can_own.py TESTS BUS SLAVE SLAVE`.

TESTS is the folder `test` of python-can's source. The last line of the output is a document that
says how many tests of each class ran, and what failed.
"""

import importlib.util
import json
import sys
import unittest
from pathlib import Path
from typing import Any

PACKAGE = "python_can_tests"
"""The name under which the folder is loaded: others have a package `test`, too, such as Python."""
LEFT_OUT = (
    # Terminals have no CAN FD.
    *("test_fd_message", "test_fd_message_with_brs"),
    # They are about how long python-can sleeps.
    *("test_timestamp", "test_send_periodic_duration"),
)


def load(folder: Path, name: str) -> Any:
    """A module of the folder."""
    if PACKAGE not in sys.modules:
        spec = importlib.util.spec_from_file_location(
            PACKAGE, folder / "__init__.py", submodule_search_locations=[str(folder)]
        )
        assert spec is not None
        assert spec.loader is not None
        sys.modules[PACKAGE] = package = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(package)
    return importlib.import_module(f"{PACKAGE}.{name}")


def on_buses(base: Any, name: str, one: str, two: str) -> type[unittest.TestCase]:
    """Tests of python-can between two channels of ecatd."""
    places = {"INTERFACE_1": "ecatd", "INTERFACE_2": "ecatd", "CHANNEL_1": one, "CHANNEL_2": two}
    patience = {"TIMEOUT": 60.0}  # theirs is 0.1, for machines that do nothing else
    return type(name, (base,), {**places, **patience, **dict.fromkeys(LEFT_OUT)})


def filtering(base: Any, channel: str) -> type[unittest.TestCase]:
    """Those of filters, which have a bus of their own."""
    import can

    def set_up(self: Any) -> None:
        self.bus = can.Bus(interface="ecatd", channel=channel)

    return type("Filters", (base,), {"setUp": set_up})


def main(tests: str, bus: str, left: str, right: str) -> None:
    folder = Path(tests)
    load(folder, "config").TEST_CAN_FD = False
    back, filters = load(folder, "back2back_test"), load(folder, "test_message_filtering")
    one, two = f"{bus}/{left}", f"{bus}/{right}"
    classes = (
        on_buses(back.Back2BackTestCase, "OneChannel", one, one),
        on_buses(back.Back2BackTestCase, "TwoTerminals", one, two),
        on_buses(back.TestThreadSafeBus, "Threads", one, one),
        filtering(filters.TestMessageFiltering, one),
    )
    found = {}
    for tested in classes:
        suite = unittest.defaultTestLoader.loadTestsFromTestCase(tested)
        result = unittest.TextTestRunner(sys.stdout, verbosity=2).run(suite)
        found[tested.__name__] = {
            "passed": result.testsRun - len(result.skipped),
            "wrong": [str(test) for test, _ in result.failures + result.errors],
        }
    print(json.dumps(found))


main(*sys.argv[1:])
