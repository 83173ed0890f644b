"""The command `ecatsim`; one file for each group of commands."""
