"""The screen of `ecatctl top`: `feed` asks the daemon in threads, the others draw."""
