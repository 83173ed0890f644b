"""Faults of frames. The slave controllers carry them out, exactly in their cycles."""
