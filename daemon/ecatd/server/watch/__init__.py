"""Watches a running bus and reports changes: `monitor.py` runs the watches of other modules."""
