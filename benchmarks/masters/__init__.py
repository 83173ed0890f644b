"""Who exchanges process data while it is measured: workers, and the whole daemon."""
