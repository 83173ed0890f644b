"""Plants: motors, FMUs and waveforms."""
