"""What stands behind the devices: mechanics and signal sources."""
