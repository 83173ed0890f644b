"""Finds settings of a machine that make a bus slow, late or unreachable, and changes some."""
