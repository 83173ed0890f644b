"""The masters that are measured, in worker processes or as a whole daemon."""
