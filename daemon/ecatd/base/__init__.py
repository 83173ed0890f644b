"""What all parts use and nothing else is needed for: errors, files, processes, the log, paths."""
