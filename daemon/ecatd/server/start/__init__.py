"""The start of a bus, from an interface to OP. `bring_up.py` runs the steps of other modules."""
