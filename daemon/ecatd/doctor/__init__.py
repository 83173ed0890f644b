"""Looks at a machine for what makes a bus slow, late or unreachable, and mends some of it."""
