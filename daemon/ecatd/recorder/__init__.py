"""The flight recorder: writes incidents, each a file with all that was known around a trigger."""
