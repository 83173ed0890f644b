"""What stands behind the devices: mechanics and waveforms."""
