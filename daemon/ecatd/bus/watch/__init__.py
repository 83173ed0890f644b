"""What is watched while the bus runs, and told: `monitor.py` brings it together."""
