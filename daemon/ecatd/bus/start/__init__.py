"""From an interface to a bus in OP: `bring_up.py` has the order, the other modules the steps."""
